"""The next run: it is one that tells the two apart, and where none does, the sensor is named."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from discrepancy_core import joint_log
from discrepancy_support import nominal

from gpcorrect.discrepancy.advice import Site, advise, planned_runs
from gpcorrect.discrepancy.naming.posterior import Alternative, Explanation, Level, Named
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.discrepancy.search.candidates import Candidate, FittedEffect, all_candidates
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Run
from gpcorrect.sim.effects.geometry import HomingOffset
from gpcorrect.sim.joint_motion import joint_motion_log


@pytest.fixture(scope="module")
def scene() -> Scene:
    log = joint_motion_log(nominal(), 8, 6.0, seed=2)
    return build_scene(log, nominal(), np.ones(len(log), dtype=np.bool_))


def candidate(scene: Scene, name: str, joint: int = 1) -> Candidate:
    return next(c for c in all_candidates(scene) if c.name == name and c.joint == joint)


def question(own: Candidate, rival: Candidate | None, level: Level = Level.SET, u: float = 1.0) -> Named:
    """Return an effect of `u` times its start, that cannot be distinguished from a rival (or from nothing)."""
    nothing = Alternative(Explanation.NOTHING, 0.4, "nothing")
    other = nothing if rival is None else Alternative.of(rival, 0.4)
    mine = Alternative.of(own, 0.6)
    return Named(FittedEffect(own, u * np.array(own.start)), level, 0.6, 50.0, (mine, other), ())


def noises(scene: Scene) -> tuple[ChannelNoise, ...]:
    return tuple(ChannelNoise(1e-3, 5e-4, 0.2) for _ in scene.channels)


def test_an_offset_and_a_drift_are_distinguished_by_a_run_of_their_descriptions(scene: Scene) -> None:
    """The advised run is one that either description recommends, and brings enough evidence with the rival refitted."""
    own, rival = candidate(scene, "homing_offset"), candidate(scene, "drift")
    advice = advise(scene, (), [question(own, rival)], noises(scene)).experiment
    assert advice is not None
    recommended = {run.value for c in (own, rival) for run in c.kind.about.separating_runs}
    assert advice.run.split(":")[0] in recommended
    assert advice.separates == (own.label, rival.label)
    assert advice.expected_nats > SETTINGS.advice.enough
    assert advice.minutes > 0


def test_nothing_is_advised_when_nothing_is_open(scene: Scene) -> None:
    """An exact name, or no name at all, asks for no run."""
    own = candidate(scene, "homing_offset")
    assert advise(scene, (), [], noises(scene)).experiment is None
    assert advise(scene, (), [question(own, None, Level.EXACT)], noises(scene)).experiment is None


def test_an_effect_too_small_for_any_run_asks_for_a_sensor(scene: Scene) -> None:
    """Where no run brings three nats, the two are called equivalent and a sensor is named."""
    advice = advise(
        scene, (), [question(candidate(scene, "transmission_ratio"), None, u=1e-4)], noises(scene)
    ).experiment
    assert advice is not None
    assert advice.expected_nats < SETTINGS.advice.enough
    assert not advice.decisive
    assert "equivalent" in advice.run
    assert "measure" in advice.run


@pytest.mark.parametrize(
    ("error", "why"), [(DataError("the loop is unstable."), "the loop is unstable"), (ValueError("5 > 3"), "5 > 3")]
)
def test_what_cannot_be_advised_is_said_and_why(
    scene: Scene, error: Exception, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error in a run that nobody recorded is a remark on the two that it would tell apart."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("gpcorrect.discrepancy.advice.simulate", fail)
    own, rival = candidate(scene, "homing_offset"), candidate(scene, "drift")
    advice = advise(scene, (), [question(own, rival)], noises(scene))
    assert (advice.experiment, advice.plans) == (None, ())
    (remark,) = advice.remarks
    assert f"would tell {own.label} from {rival.label}" in remark
    assert why in remark


def test_an_answer_stands_where_advice_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """An effect is named all the same, and the report says what could not be advised."""

    def ask(named: Sequence[Named]) -> tuple[Named, Alternative]:
        return named[0], named[0].alternatives[-1]

    def fail(*_: object, **__: object) -> None:
        raise DataError("the loop is unstable.")

    monkeypatch.setattr("gpcorrect.discrepancy.advice._question", ask)
    monkeypatch.setattr("gpcorrect.discrepancy.advice._best", fail)
    found = find_discrepancy(nominal(), joint_log(4, HomingOffset(2, offset=0.01)))
    assert [e.name for e in found.effects] == ["homing_offset"]
    assert found.next_experiment is None
    assert "the loop is unstable" in found.to_report()["provenance"]["remarks"][-1]


def test_the_evidence_grows_with_the_effect(scene: Scene) -> None:
    """A larger effect promises more nats, about with its square."""
    own = candidate(scene, "transmission_ratio")
    small, large = (advise(scene, (), [question(own, None, u=u)], noises(scene)).experiment for u in (0.01, 0.02))
    assert small is not None
    assert large is not None
    assert large.expected_nats == pytest.approx(4 * small.expected_nats, rel=0.05)


@pytest.mark.parametrize("column", [0, None])
def test_runs_stay_in_the_range_and_begin_and_end_at_rest(column: int | None) -> None:
    """No advised path leaves where the joints have been, and every one starts and stops without a jump."""
    ranges = np.array([[-0.4, 0.2], [0.1, 0.15], [-1.0, 1.0]])
    site = Site(ranges, "RPR", column, 50.0, loads=True, servo=True)
    made = planned_runs(site, list(Run))
    assert len(made) >= 9
    for planned in made:
        for plan, gain in planned.plans:
            assert (plan.q >= ranges[:, 0] - 1e-9).all()
            assert (plan.q <= ranges[:, 1] + 1e-9).all()
            assert gain > 0
            assert np.abs(np.diff(plan.q[:2], axis=0)).max() < 1e-3
            assert np.abs(np.diff(plan.q[-2:], axis=0)).max() < 1e-9


def test_what_cannot_be_simulated_is_not_advised() -> None:
    """Without masses no payload is swapped, without a servo model no gain is changed."""
    site = Site(np.array([[-1.0, 1.0], [-1.0, 1.0]]), "RR", 0, 50.0, loads=False, servo=False)
    kinds = {planned.run for planned in planned_runs(site, list(Run))}
    assert not kinds & {Run.LOAD_SWAP, Run.GAIN_CHANGE, Run.TWO_INSERTIONS}
    assert Run.SPEED_LADDER in kinds
