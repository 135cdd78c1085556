"""What is remembered is bounded, empty in a copy, and the same for several threads as for one."""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import joint_log, raven_swings

from gpcorrect.discrepancy.recording.dataset import REMEMBERED_BYTES, Dataset
from gpcorrect.discrepancy.recording.replay_memory import Remembered, ReplayMemory
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.sim import machine_of, model_from_dict, plant, simulate
from gpcorrect.sim.effects import (
    Backlash,
    CableCoupling,
    CableStretch,
    CoulombFriction,
    Effect,
    GainError,
    HomingOffset,
    Payload,
)

TWO_JOINTS = {"arm": "joints", "joints": [1, 2], "joint_types": "RR"}


def test_what_was_not_asked_for_longest_is_forgotten_and_the_newest_stays() -> None:
    arrays = [np.full(10, float(i)) for i in range(5)]
    few = Remembered[np.ndarray](3 * arrays[0].nbytes)
    for i, array in enumerate(arrays):
        assert few.keep(i, array) is array
    assert [few.get(i) is not None for i in range(5)] == [False, False, True, True, True]
    assert few.get(2) is arrays[2]
    few.keep(5, np.full(10, 5.0))
    assert [few.get(i) is not None for i in range(6)] == [False, False, True, False, True, True]
    large = few.keep("large", np.zeros(1000))
    assert few.get("large") is large
    assert all(few.get(i) is None for i in range(6))
    assert copy.deepcopy(few).get("large") is None


@pytest.fixture
def hasty() -> Iterator[None]:
    """Let threads take turns as often as they can."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-7)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("hasty")
def test_threads_see_what_one_would_though_nothing_is_remembered_for_long() -> None:
    """What had just been kept was gone when it was read."""
    prepared = prepare_data(joint_log(3), model_from_dict(TWO_JOINTS), np.random.default_rng(0))
    rng = np.random.default_rng(1)
    sets: list[tuple[Effect, ...]] = [
        (HomingOffset(1, size), Backlash(2, abs(size)), CableCoupling(2, source=1, coefficient=size))
        for size in rng.normal(scale=0.01, size=120)
    ]
    alone = [prepared.dataset.predict(effects) for effects in sets]
    short = ReplayMemory(loops=Remembered(1))
    scene = replace(prepared.dataset.scene, memory=short)
    dataset = replace(prepared.dataset, scene=scene, memory=Remembered(1))
    with ThreadPoolExecutor(8) as threads:
        found = list(threads.map(dataset.predict, sets + sets))
    for a, b in zip(alone + alone, found, strict=True):
        np.testing.assert_array_equal(a, b)


def swung(*, tracked: bool = False) -> Dataset:
    """Ten motions of an arm whose controller is known, and has friction; a tracker or encoders see it."""
    controller = {"kp": [300.0, 300.0, 3000.0], "kd": [15.0, 15.0, 150.0], "feedforward": "rigid-body"}
    model = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 100, "controller": controller})
    log = simulate(machine_of(model).with_effects(CoulombFriction(2, torque=0.2)), raven_swings(5, 10, 3.0), seed=7)
    if not tracked:
        log = replace(log, external_jp=log.measured_jp, tracker_cp=None)
    return prepare_data(log, model, np.random.default_rng(0)).dataset


@pytest.fixture(scope="module")
def raven() -> Dataset:
    return swung()


@pytest.mark.parametrize(
    ("base", "moved"),
    [
        ((), (CoulombFriction(2, torque=0.2),)),
        ((), (Payload("all", 0.1),)),
        ((CoulombFriction(2, torque=0.2),), (CoulombFriction(2, torque=0.21),)),
        (
            (CoulombFriction(2, torque=0.2), CableStretch(2, 300.0)),
            (CoulombFriction(2, torque=0.2), CableStretch(2, 310.0)),
        ),
        ((Payload("all", 0.1), HomingOffset(3, 1e-3)), (Payload("all", 0.102), HomingOffset(3, 1e-3))),
        ((GainError(1, 0.1, 0.1),), (GainError(1, 0.12, 0.1),)),
    ],
)
def test_what_differs_little_from_a_set_is_seen_in_one_pass(
    raven: Dataset,
    base: tuple[Effect, ...],
    moved: tuple[Effect, ...],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs: list[int] = []
    follow = plant.follow
    monkeypatch.setattr(plant, "follow", lambda *given: runs.append(1) or follow(*given))
    dataset = replace(raven, scene=replace(raven.scene, memory=ReplayMemory()), memory=Remembered(REMEMBERED_BYTES))
    there = dataset.predict(base, near=base)
    runs.clear()
    change = dataset.predict(moved, near=base) - there
    in_one_pass = len(runs)
    exact = dataset.predict(moved) - dataset.predict(base)
    assert len(runs) - in_one_pass >= 2 * in_one_pass
    assert np.linalg.norm(change - exact) < 0.05 * np.linalg.norm(exact)


def test_loops_are_remembered_up_to_their_bytes(raven: Dataset) -> None:
    """A loop counts what it made; with room for two and a half the third takes the first one's place."""
    first = ReplayMemory()
    replace(raven, scene=replace(raven.scene, memory=first), memory=Remembered(REMEMBERED_BYTES)).predict(
        (GainError(1, 0.1),)
    )
    driven = next(iter(first.loops._known.values()))
    assert driven.nbytes >= 6 * driven.q.nbytes
    memory = ReplayMemory(loops=Remembered(int(2.5 * driven.nbytes)))
    dataset = replace(raven, scene=replace(raven.scene, memory=memory), memory=Remembered(REMEMBERED_BYTES))
    for gain in (0.1, 0.2, 0.3, 0.4):
        dataset.predict((GainError(1, gain),))
    assert len(memory.loops._known) == 2


def test_a_tracker_sees_in_one_pass_what_differs_little_from_a_set() -> None:
    dataset = swung(tracked=True)
    base, moved = ((Payload("all", mass), CableStretch(2, 300.0)) for mass in (0.1, 0.102))
    seen = np.array([c.signal.startswith("tracker") for c in dataset.scene.channels])
    change = (dataset.predict(moved, near=base) - dataset.predict(base, near=base))[:, seen]
    exact = (dataset.predict(moved) - dataset.predict(base))[:, seen]
    assert seen.any()
    assert 0 < np.linalg.norm(change - exact) < 0.05 * np.linalg.norm(exact)
