from __future__ import annotations

import json

import numpy as np
import pytest
from rigid_planted import Planted, differences, noisy, planted, rotations, signal, with_outliers
from scipy.spatial.transform import Rotation

from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid import fit_pose, register
from gpcorrect.rigid.select import hold_out_units
from gpcorrect.robust import medians_of
from gpcorrect.types import IntArray, PoseSignal

KINDS = ["identity", "pose", "marker", "separate"]


def world_of(kind: str, rng: np.random.Generator, n: int = 400) -> tuple[Planted, IntArray]:
    """Noisy pairs of the kind in trajectories of twenty samples."""
    exact = planted(kind, n, rng)
    return Planted(noisy(exact.observed, rng, 0.001, 0.02), exact.command, exact.truth), np.arange(n) // 20


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.0, 0.1])
def test_auto_finds_the_planted_kind(kind: str, share: float, rng: np.random.Generator) -> None:
    """The kind that made the data is chosen and recovered, gross errors or not."""
    world, trajectory = world_of(kind, rng)
    observed = with_outliers(world.observed, rng.permutation(400)[: int(400 * share)], rng)
    found = register(observed, world.command, trajectory, "auto")
    assert found.model.kind == kind
    assert differences(found.model, world.truth)["angle"] < 0.02
    assert [c.kind for c in found.candidates] == KINDS


@pytest.mark.parametrize("kind", ["identity", "position"])
def test_auto_registers_positions_alone(kind: str, rng: np.random.Generator) -> None:
    """Of a tracker of positions the frames are registered unless they already agree."""
    world, trajectory = world_of(kind, rng)
    found = register(PoseSignal(world.observed.position), world.command, trajectory, "auto")
    assert found.model.kind == kind
    assert found.observability is None
    assert all(np.isnan(c.rotation_deg) for c in found.candidates)


def test_auto_finds_a_lever_arm_from_commanded_positions(rng: np.random.Generator) -> None:
    """Where orientations are observed but not commanded, a marker still shows in the positions."""
    world, trajectory = world_of("marker", rng)
    found = register(world.observed, PoseSignal(world.command.position), trajectory, "auto")
    assert found.model.kind == "marker"
    assert np.linalg.norm(found.model.offset - world.truth.offset) < 0.002


def test_auto_says_what_it_refused(rng: np.random.Generator) -> None:
    """A marker that cannot be observed falls back to a simpler model, and the reason is in the report."""
    exact = planted("pose", 400, rng, swing_rad=0.0)
    found = register(noisy(exact.observed, rng, 0.001, 0.02), exact.command, np.arange(400) // 20, "auto")
    assert found.model.kind == "pose"
    assert "marker was refused: The tool hardly rotated" in found.reason
    assert not found.observability.observable
    refused = next(c for c in found.candidates if c.kind == "marker")
    assert refused.refused
    assert refused.to_dict()["score"] is None


@pytest.mark.parametrize("seed", range(3))
def test_wrong_orientations_do_not_turn_a_wide_workspace(seed: int) -> None:
    """Over a metre, orientations that err by tens of degrees leave the pose's positions as good as those alone."""
    rng = np.random.default_rng(seed)
    exact = planted("pose", 300, rng, swing_rad=0.3)
    wide = PoseSignal(0.5 * rng.uniform(-1, 1, (300, 3)), exact.observed.quaternion)
    command = exact.truth.apply(wide)
    bent = Rotation.from_rotvec(0.5 * np.sin(3 * wide.position + rng.uniform(0, 6, 3)))
    observed = noisy(signal(wide.position, bent * rotations(wide)), rng, 0.002, 0.01)
    candidates = {c.kind: c for c in register(observed, command, np.arange(300) // 20, "auto").candidates}
    assert candidates["pose"].position_mm < 1.1 * candidates["separate"].position_mm


def test_held_out_errors_are_of_data_not_seen(rng: np.random.Generator) -> None:
    """The reported errors of the pose are those of folds fitted without the trajectories they judge."""
    world, trajectory = world_of("pose", rng, n=200)
    found = register(world.observed, world.command, trajectory, "none")
    medians = np.empty(10)
    for fold in range(5):
        held = trajectory // 2 == fold
        mapped = fit_pose(world.observed[~held], world.command[~held]).apply(world.observed[held])
        errors = np.linalg.norm(mapped.position - world.command.position[held], axis=1)
        medians[2 * fold : 2 * fold + 2] = np.median(errors.reshape(2, 20), axis=1)
    assert found.candidates[1].position_mm == pytest.approx(1e3 * np.median(medians), rel=1e-9)


def test_none_and_solve_do_as_they_are_told(rng: np.random.Generator) -> None:
    """The paper's registration is made even of marker data when asked for, the marker even of plain data."""
    marker, trajectory = world_of("marker", rng)
    plain, _ = world_of("pose", rng)
    none = register(marker.observed, marker.command, trajectory, "none")
    assert none.model.to_dict() == fit_pose(marker.observed, marker.command).to_dict()
    solve = register(plain.observed, plain.command, trajectory, "solve")
    assert solve.model.kind == "marker"
    assert np.linalg.norm(solve.model.offset) < 0.001


def test_solve_refuses_what_is_not_observable(rng: np.random.Generator) -> None:
    """A marker asked for without enough rotation is an error, not a guess."""
    world = planted("marker", 100, rng, axes=1)
    with pytest.raises(DegenerateError, match="one axis only"):
        register(world.observed, world.command, np.arange(100) // 10, "solve")


def test_auto_never_hides_behind_the_identity(rng: np.random.Generator) -> None:
    """When nothing but the identity could be tried, the reason is raised."""
    line = PoseSignal(np.arange(100.0)[:, None] * np.ones(3))
    with pytest.raises(DegenerateError, match="on one line"):
        register(line, PoseSignal(line.position + 1.0), np.arange(100) // 10, "auto")


def test_same_data_same_choice_and_json(rng: np.random.Generator) -> None:
    """Two runs report the same to the last bit, and the report passes through JSON."""
    world, trajectory = world_of("marker", rng, n=100)
    first, second = (register(world.observed, world.command, trajectory, "auto").to_dict() for _ in range(2))
    assert first == second
    assert json.loads(json.dumps(first, allow_nan=False)) == first


def test_one_trajectory_is_held_out_in_contiguous_blocks() -> None:
    """Blocks of a single recording are contiguous and nearly equal; many trajectories are left whole."""
    blocks = hold_out_units(np.zeros(103, dtype=np.int64))
    assert (np.diff(blocks) >= 0).all()
    assert np.ptp(np.bincount(blocks)) <= 1
    assert blocks.max() == 9
    whole = hold_out_units(np.repeat([7, 3, 9, 1, 5], 4))
    np.testing.assert_array_equal(whole, np.repeat(np.arange(5), 4))


def test_auto_chooses_from_one_trajectory(rng: np.random.Generator) -> None:
    """A single long motion is enough to tell a marker from a plain registration."""
    world, _ = world_of("marker", rng)
    assert register(world.observed, world.command, np.zeros(400, dtype=np.int64), "auto").model.kind == "marker"


def test_too_few_samples_to_leave_some_out_are_refused(rng: np.random.Generator) -> None:
    """With five samples "auto" has nothing to judge by, while "none" still registers."""
    world = planted("pose", 5, rng)
    with pytest.raises(DegenerateError, match="at least 6 samples, got 5"):
        register(world.observed, world.command, np.zeros(5, dtype=np.int64), "auto")
    assert register(world.observed, world.command, np.zeros(5, dtype=np.int64), "none").model.kind == "pose"


def test_bad_options_and_lengths_are_refused(rng: np.random.Generator) -> None:
    """An unknown option and a missing trajectory number are named."""
    world = planted("pose", 10, rng)
    with pytest.raises(DataError, match="none, solve, auto"):
        register(world.observed, world.command, np.zeros(10, dtype=np.int64), "maybe")
    with pytest.raises(DataError, match="10 samples need a trajectory each, got 9"):
        register(world.observed, world.command, np.zeros(9, dtype=np.int64), "none")


def test_medians_of_labels_are_those_of_each_label() -> None:
    """Of odd and even numbers of values; one that is missing takes its label's median with it."""
    label = np.array([1, 0, 1, 2, 0, 1, 1, 2, 2])
    values = np.array([4.0, 1.0, 2.0, 7.0, 2.0, 9.0, 3.0, np.nan, 1.0])
    expected = [np.median(values[label == k]) for k in range(3)]
    np.testing.assert_array_equal(medians_of(values, label), expected)
