"""Recordings whose stamps jitter or whose rows are lost: the servo loop runs on a clock of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import EVERY, IN_SERVO, SERVO_MODEL, fine

from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.discrepancy.naming.posterior import Alternative, Level, Named, like_steps
from gpcorrect.discrepancy.naming.weigh import Own, Rival, Weighed, left_to_steps
from gpcorrect.discrepancy.outcome.sentences import verdict_sentences
from gpcorrect.discrepancy.recording import scene as scene_module
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.commanded import with_joint_paths
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.candidates import FittedEffect, all_candidates
from gpcorrect.discrepancy.search.linearisation import refine
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.discrepancy.search.state import start_search, view_of
from gpcorrect.errors import DataError
from gpcorrect.sim import machine_of
from gpcorrect.sim.effects import (
    CableStretch,
    CommandDelay,
    CoulombFriction,
    Effect,
    InertiaError,
    IntegralAction,
    Payload,
    VelocityFilter,
    ViscousFriction,
)
from gpcorrect.sim.effects.base import SIDES
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

SMALL = 1e-5  # rad, beside milliradians of the hidden effects


def taken(rows: IntArray) -> CalibrationLog:
    """Return these rows of the fine recording."""
    return fine().select(np.isin(np.arange(len(fine())), rows))


def even() -> IntArray:
    """Return the rows of a log at 100 Hz."""
    return np.arange(0, len(fine()), EVERY)


def scene(log: CalibrationLog) -> Scene:
    """Return a log beside the model."""
    log, _ = with_joint_paths(log, machine_of(SERVO_MODEL).body)
    every: BoolArray = np.ones(len(log), dtype=np.bool_)
    return build_scene(log, SERVO_MODEL, every)


def motor_errors(log: CalibrationLog, effects: tuple[Effect, ...] = IN_SERVO) -> FloatArray:
    """Return how far the first two motors are from the simulated loop, root mean square, rad."""
    built = scene(log)
    assert [c.name for c in built.channels[:2]] == ["measured_jp_1", "measured_jp_2"]
    size: FloatArray = np.sqrt(np.nanmean(built.residual(effects)[:, :2] ** 2, axis=0))
    return size


def test_rows_taken_early_and_late_change_nothing() -> None:
    """Up to two fifths of a step: the loop is read where they were taken, and says the same as on an even clock."""
    rng, rows = np.random.default_rng(2), even()
    moved = np.clip(rows + rng.integers(-2, 3, len(rows)), 0, len(fine()) - 1)
    uneven, on_clock = scene(taken(moved)), scene(taken(rows))
    assert uneven.stamps is not None
    assert on_clock.stamps is None
    np.testing.assert_array_equal(uneven.time, taken(moved).time)
    assert (motor_errors(taken(moved)) < 1e-4).all()
    # The first rows of one are on the move: its motions' beginnings, a sixteenth of them, are left out.
    np.testing.assert_allclose(motor_errors(taken(moved), ()), motor_errors(taken(rows), ()), rtol=1 / 16)


@pytest.mark.parametrize("jitter", [5e-4, 1e-3, 2e-3])
def test_rows_only_stamped_early_and_late_change_nothing(jitter: float) -> None:
    """Samples of an even clock: they are put back on it, for the command would be rough on their stamps."""
    log, rng = taken(even()), np.random.default_rng(3)
    late = np.clip(rng.exponential(jitter, len(log)), 0.0, 8e-3)
    late = np.where(np.diff(log.time + late, append=np.inf) > 0, late, 0.0)  # stamps rise
    stamped = scene(replace(log, time=log.time + late))
    assert stamped.stamps is None
    assert any("even clock" in remark for remark in stamped.remarks)
    steps = np.diff(stamped.time)[np.diff(log.trajectory) == 0]
    np.testing.assert_allclose(steps, 0.01, rtol=1e-3)
    np.testing.assert_allclose(motor_errors(replace(log, time=log.time + late)), motor_errors(log), atol=SMALL)


@pytest.mark.parametrize("lost", ["here and there", "a third of a second", "only measured"])
def test_rows_that_are_lost_leave_the_loop_as_it_is(lost: str) -> None:
    """One row of twenty, thirty in a row, or motor positions alone: what is left is explained as well as before."""
    rows, rng = even(), np.random.default_rng(3)
    keep = rng.random(len(rows)) > 0.05 if lost == "here and there" else np.ones(len(rows), dtype=np.bool_)
    keep[400:430] = lost != "a third of a second"
    log = taken(rows[keep])
    if lost == "only measured":
        measured = np.array(log.measured_jp)
        measured[400:430] = np.nan
        log = replace(log, measured_jp=measured)
    assert (motor_errors(log) < motor_errors(taken(rows)) + SMALL).all()
    assert (motor_errors(log, ()) > 10 * motor_errors(log)).all()


def test_a_long_hole_begins_a_motion_anew() -> None:
    """Two seconds without a row: the loop starts again behind them, and its first half second there is not compared."""
    rows = even()
    log = taken(np.delete(rows, slice(300, 500)))
    whole, cut = scene(taken(rows)), scene(log)
    assert len(np.unique(cut.run_of_row())) == len(np.unique(whole.run_of_row())) + 1
    motors = np.isfinite(cut.observed[:, :3]).all(axis=1)
    assert list(np.flatnonzero(~motors)) == list(range(300, 350))
    assert np.isfinite(cut.observed[:, 3:]).all()
    assert (motor_errors(log) < motor_errors(taken(rows)) + SMALL).all()


def test_a_hole_in_which_the_arm_stands_ends_no_motion() -> None:
    """What has a memory keeps it over two seconds without a row, when the arm is where it was."""
    log = taken(even())
    later = np.where(np.arange(len(log)) >= 300, log.time + 2.0, log.time)
    whole, paused = scene(log), scene(replace(log, time=later))
    assert len(np.unique(paused.run_of_row())) == len(np.unique(whole.run_of_row()))


def test_motions_that_begin_on_the_move_are_compared_once_the_servo_has_settled() -> None:
    """Whether the arm moved with the first command, or stood, is in no log: half a second is left out."""
    number = np.arange(len(fine()))
    log = fine().select(np.isin(number, even()) & (number % 4000 >= 1500))
    settled = _since_its_start(log) >= 0.5
    built = scene(log)
    np.testing.assert_array_equal(np.isfinite(built.observed[:, :3]).all(axis=1), settled)
    assert np.isfinite(built.observed[:, 3:]).all()
    unmeasured = scene(replace(log, measured_jp=None))
    np.testing.assert_array_equal(np.isfinite(unmeasured.observed[:, :3]).all(axis=1), settled)
    assert np.isfinite(scene(taken(even())).observed).all()


@pytest.mark.parametrize(("elsewhere", "left_out"), [(0.0, False), (2e-3, True)])
def test_motors_that_stand_elsewhere_as_motions_begin_are_compared_once_the_servo_has_settled(
    elsewhere: float, left_out: bool
) -> None:
    """A controller that held with another torque as it begins: its way back was a gain error, EXACT."""
    log = taken(even())
    noise = np.random.default_rng(2).normal(0.0, 2e-4, log.measured_jp.shape)
    since = _since_its_start(log)
    way_back = elsewhere * np.exp(-since / 0.05)[:, None] * [1.0, 0.0, 0.0]
    moved = replace(log, measured_jp=scene(log).predict()[:, :3] + noise + way_back)
    compared = np.isfinite(scene(moved).observed[:, :3]).all(axis=1)
    np.testing.assert_array_equal(compared, (since >= 0.5) | (not left_out))


def _since_its_start(log: CalibrationLog) -> FloatArray:
    start = np.array([log.time[log.trajectory == k].min() for k in range(int(log.trajectory.max()) + 1)])
    since: FloatArray = log.time - start[log.trajectory]
    return since


def test_of_motions_in_which_no_servo_settles_nothing_is_said_of_the_motors() -> None:
    """Two fifths of a second of every second, on the move: no row can be compared, and it is not NONE for that."""
    log = taken(even())
    bits = log.select((log.time % 1.0 > 0.3) & (log.time % 1.0 < 0.7))
    built = scene(replace(bits, trajectory=np.unique(np.floor(bits.time), return_inverse=True)[1].astype(np.int64)))
    assert built.plan is None
    assert built.unclocked
    assert any("no motion lasts" in remark for remark in built.remarks)


def test_friction_is_simulated_once_for_both_sides_where_nothing_behind_feels_which(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Behind a cable that stretches it is another thing on either side of it."""
    built, runs = scene(taken(even())), []
    simulated = scene_module.follow_command
    monkeypatch.setattr(scene_module, "follow_command", lambda *given: runs.append(given) or simulated(*given))
    motor, joint = (CoulombFriction(1, torque=0.5, side=side) for side in SIDES)
    np.testing.assert_array_equal(built.predict([motor]), built.predict([joint]))
    assert len(runs) == 1
    stretch = CableStretch(1, 500.0)
    apart = built.predict([motor, stretch]) - built.predict([joint, stretch])
    assert len(runs) == 2  # that of the motor was made
    assert np.median(np.abs(apart[:, 3])) == pytest.approx(0.5 / 500.0, rel=0.05)  # outside encoder of joint 1


def test_where_neither_clock_is_right_no_loop_is_run() -> None:
    """Messages that come in bunches, and commands that are noise: the answer is that effects in the servo stay open."""
    log, rng = taken(even()), np.random.default_rng(4)
    bunches = replace(log, time=np.repeat(log.time[::4], 4) + np.tile([0.0, 2e-4, 4e-4, 6e-4], len(log) // 4))
    shaken = log.setpoint_jp + rng.normal(0.0, 0.05, (len(log), 3))
    noisy = replace(log, time=log.time + rng.uniform(-3e-3, 3e-3, len(log)), setpoint_jp=shaken)
    for odd in (bunches, noisy):
        built = scene(odd)
        assert built.plan is None
        assert built.unclocked
        assert any("uneven" in remark for remark in built.remarks)


def test_without_a_clock_nothing_is_said_of_the_motors() -> None:
    """They were compared with nothing: what would be NONE by an even clock is INCONCLUSIVE by stamps in bunches."""
    log, rng = fine((), runs=12, hz=50.0), np.random.default_rng(6)
    even_one = replace(
        log, tracker_cp=None, external_jp=log.external_jp + rng.normal(0.0, [1e-4, 1e-4, 1e-5], (len(log), 3))
    )
    bunched = np.concatenate(
        [t[::4].repeat(4)[: len(t)] + np.arange(len(t)) % 4 * 2e-4 for t in np.split(log.time, 12)]
    )
    levels = [find_discrepancy(SERVO_MODEL, one).level for one in (even_one, replace(even_one, time=bunched))]
    assert levels == ["NONE", "INCONCLUSIVE"]


@pytest.mark.parametrize(("delay", "named"), [(0.001, False), (0.005, True)])
def test_a_late_command_is_named_unless_it_is_a_matter_of_steps(delay: float, named: bool) -> None:
    """A step of the servo, by which two programs may differ, is in the model and has no name; five of them have one."""
    log = fine((CommandDelay("all", delay),), runs=12, hz=50.0)
    rng = np.random.default_rng(6)
    noisy = replace(log, external_jp=log.external_jp + rng.normal(0.0, [1e-4, 1e-4, 1e-5], log.external_jp.shape))
    found = find_discrepancy(SERVO_MODEL, replace(noisy, tracker_cp=None))
    assert found.level in (("EXACT",) if named else ("NONE", "INCONCLUSIVE"))
    assert [e.name for e in found.effects] == (["command_delay"] if named else [])
    (late,) = [*found.effects, *found.verdict.of_steps]
    assert late.parameters["delay"].value == pytest.approx(delay, rel=0.05)
    assert [e.about.name for e in found.model.effects] == ["command_delay"]


@pytest.mark.parametrize(("inertia", "named"), [(-0.005, False), (0.05, True)])
def test_an_inertia_is_named_unless_it_is_a_matter_of_steps(inertia: float, named: bool) -> None:
    """The step times the gain on speed, 0.012 kg m^2 here, is what two ways to step a loop may differ by."""
    log = fine((InertiaError(1, inertia),), runs=12, hz=50.0)
    noise = np.random.default_rng(6).normal(0.0, [1e-4, 1e-4, 1e-5], log.external_jp.shape)
    found = find_discrepancy(SERVO_MODEL, replace(log, external_jp=log.external_jp + noise, tracker_cp=None))
    assert found.level in (("EXACT",) if named else ("NONE", "INCONCLUSIVE"))
    (heavy,) = [*found.effects, *found.verdict.of_steps]
    assert (heavy.name, heavy.joint, heavy in found.effects) == ("inertia_error", 1, named)
    assert heavy.parameters["inertia"].value == pytest.approx(inertia, rel=0.05)
    assert any("steps its servos" in sentence for sentence in verdict_sentences(found)) != named


WHOLE = (
    VelocityFilter("all", 0.006),  # else an inertia too little of each motor
    IntegralAction("all", 3.0),
    Payload("all", 0.4, 0.05, -0.03, 0.06, place="beside"),  # else a heavier link with its weight elsewhere
)


@pytest.mark.parametrize("hidden", WHOLE, ids=[e.about.name for e in WHOLE])
def test_what_is_of_the_whole_machine_is_named_once(hidden: Effect) -> None:
    """One effect with the true numbers in its intervals, not one for each joint that feels it."""
    log = fine((hidden,), runs=12, hz=50.0)
    noise = np.random.default_rng(6).normal(0.0, [1e-4, 1e-4, 1e-5], log.external_jp.shape)
    found = find_discrepancy(SERVO_MODEL, replace(log, external_jp=log.external_jp + noise, tracker_cp=None))
    assert [(e.level, e.name, e.joint) for e in found.effects] == [("EXACT", hidden.about.name, "all")]
    for name, estimate in found.effects[0].parameters.items():
        if estimate.ci95 is not None:
            assert estimate.ci95[0] <= getattr(hidden, name) <= estimate.ci95[1]


def test_a_filter_of_half_a_step_is_a_matter_of_steps() -> None:
    """As a controller has that differentiates its encoder: it is in the model and has no name."""
    log = fine((VelocityFilter("all", 0.0006),), runs=12, hz=50.0)
    noise = np.random.default_rng(6).normal(0.0, [1e-4, 1e-4, 1e-5], log.external_jp.shape)
    found = find_discrepancy(SERVO_MODEL, replace(log, external_jp=log.external_jp + noise, tracker_cp=None))
    assert (found.level in ("NONE", "INCONCLUSIVE"), found.effects) == (True, ())


@pytest.mark.parametrize(
    ("seconds", "probability", "like"), [(5e-4, 0.4, True), (5e-4, 1e-4, False), (5e-3, 0.4, False)]
)
def test_what_may_as_well_be_the_steps_is_like_them(seconds: float, probability: float, like: bool) -> None:
    """A gain error that cannot be told from a filter of half a step; neither one that can, nor from five steps."""
    built, nothing = scene(fine((), runs=12, hz=50.0)), np.zeros(1)
    known = {c.name: c for c in all_candidates(built) if c.joint == 2}
    gain, lag = known["gain_error"], known["velocity_filter"]
    rival = Rival(FittedEffect(lag, np.array([lag.coordinates[0].coordinate(seconds)])), 0.0, 0.0)
    own = Own((), (nothing, nothing), nothing, nothing, 1.0)
    weighed = Weighed(own, 0.0, np.ones(1, dtype=np.bool_), (rival,), 0.0, 0.0)
    alternatives = (Alternative.of(gain, 1.0 - probability), Alternative.of(lag, probability))
    fit = FittedEffect(gain, np.array(gain.start))
    named = Named(fit, Level.CLASS, 1.0 - probability, 50.0, alternatives, ())
    assert like_steps(named, weighed, built.machine.drive, built.joints) is like


@pytest.mark.parametrize("hidden", [CommandDelay(2, 0.0015), ViscousFriction(2, damping=0.18)])
def test_a_late_joint_is_told_from_friction(hidden: Effect) -> None:
    """Friction makes a lag as well: what tells the two is as little as another way to step the loop would change."""
    log = fine((hidden,), runs=12, hz=50.0)
    noise = np.random.default_rng(6).normal(0.0, [1e-4, 1e-4, 1e-5], log.external_jp.shape)
    (late,) = find_discrepancy(SERVO_MODEL, replace(log, external_jp=log.external_jp + noise, tracker_cp=None)).effects
    assert (late.name, late.joint) == (hidden.about.name, 2)
    first = hidden.about.parameters[0].name
    assert late.parameters[first].value == pytest.approx(getattr(hidden, first), rel=0.05)


def test_a_fit_that_begins_where_no_machine_is_comes_back_to_one() -> None:
    """A step may lead to an unstable loop, or a motor of no inertia: the fit begins smaller, no run ends there."""
    slow = SERVO_MODEL.model_copy(update={"controller": SERVO_MODEL.controller.model_copy(update={"rate_hz": 400.0})})
    prepared = prepare_data(fine((InertiaError(3, -1.0),), runs=12, hz=50.0), slow, np.random.default_rng(0))
    (light,) = (c for c in all_candidates(prepared.dataset.scene) if (c.name, c.joint) == ("inertia_error", 3))
    start = FittedEffect(light, np.array([light.coordinates[0].coordinate(-5.0)]))
    with pytest.raises(DataError, match="unstable"):
        prepared.dataset.predict([start.effect])
    (found,) = refine(start_search(prepared.dataset, [light]).whitener, [], [start])
    assert np.isfinite(prepared.dataset.predict([found.effect])).all()
    assert InertiaError(3, found.effect.inertia) == found.effect
    assert found.effect.inertia == pytest.approx(-1.0, abs=400.0 * (1 / 400 - 1 / 1000) / 2)  # as steps differ


def test_what_steps_could_gain_beside_a_set_is_counted() -> None:
    """Speeds seen half a step late, beside a payload: what steps could gain is counted until the lag is in the set."""
    log = fine((Payload("all", 0.2), VelocityFilter("all", 0.0005)), runs=12, hz=50.0)
    noise = np.random.default_rng(6).normal(0.0, [1e-4, 1e-4, 1e-5], log.external_jp.shape)
    prepared = prepare_data(replace(log, external_jp=log.external_jp + noise), SERVO_MODEL, np.random.default_rng(0))
    state = start_search(prepared.dataset, all_candidates(prepared.dataset.scene))
    load = next(t.candidate for t in state.traces if t.candidate.name == "payload")
    lag = next(t.candidate for t in state.traces if (t.candidate.name, t.candidate.joint) == ("velocity_filter", "all"))
    both = refine(state.whitener, [], [FittedEffect(c, np.array(c.start)) for c in (load, lag)])
    without, beside = (
        left_to_steps(view_of(replace(state, fitted=tuple(fitted)), prepared)) for fitted in (both[:1], both)
    )
    assert without > state.misfit(both[:1]) - state.misfit(both) > 20.0  # of two parts, and of the first
    assert 0.0 <= beside < 0.1
