"""A tracker beside the simulator: open frames, small exact turns, nonsense left out, and the tolerance of a table."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy_core import raven_swings

from gpcorrect import se3
from gpcorrect.arms import raven2
from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.discrepancy.naming.posterior import Level
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.tracker import Tracker, refuse_mixed_joints, slack_of, table_slopes
from gpcorrect.discrepancy.search.candidates import all_candidates
from gpcorrect.discrepancy.search.needs import split_by_needs
from gpcorrect.errors import DataError
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import Delay, Effect, GravitySag
from gpcorrect.sim.plan import Segment, plan_of
from gpcorrect.types import CalibrationLog


def poses(seed: int = 0, n: int = 60) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return se3.exp(rng.uniform(-0.4, 0.4, (n, 6)))


def seen(T: np.ndarray, nominal: np.ndarray, *, known: bool = False) -> tuple[Tracker, str]:
    """Return the tracker that saw these poses of an arm, and why it compares no orientations."""
    position, quaternion = se3.to_parts(T)
    return Tracker(position, np.ones(len(T), dtype=np.bool_), known, known).with_orientations(quaternion, nominal)


def test_a_rigid_frame_and_a_turned_marker_are_no_discrepancy() -> None:
    """Wherever the tracker stands and however the marker is turned on the tip, what is left is nothing."""
    T, frame, marker = poses(), se3.exp(np.array([0.3, -1, 2, 0.5, 1.0, -2.0])), se3.exp(np.array([0, 0, 0, 1.0, 2, 0]))
    tracker, why = seen(frame @ T @ marker, T)
    assert why == ""
    np.testing.assert_allclose(tracker.observed, tracker.predicted(T), atol=1e-12)


def test_the_difference_is_the_turn() -> None:
    """A tool turned by a small vector leaves just that vector, whatever turned it from the nominal before."""
    T = poses()
    turned = T.copy()
    turned[:, :3, :3] = se3.matrix_from_rotvec(np.tile([0.01, -0.02, 0.005], (len(T), 1))) @ T[:, :3, :3]
    tracker, _ = seen(turned, T, known=True)
    left = tracker.observed - tracker.predicted(T)
    np.testing.assert_allclose(left[:, 3:], np.tile([0.01, -0.02, 0.005], (len(T), 1)), atol=1e-12)
    np.testing.assert_allclose(tracker.predicted(turned), tracker.observed, atol=1e-12)


@pytest.mark.parametrize("known", [False, True])
def test_a_marker_away_from_the_tip_is_fitted_wherever_it_sits(known: bool) -> None:
    """Nobody mounts one in the tip; its 55 mm were hunted as table errors, for ten minutes and without an answer."""
    T, frame = poses(3), np.eye(4) if known else se3.exp(np.array([0.3, -1, 2, 0.5, 1.0, -2.0]))
    marker = se3.pose(np.eye(3), np.array([0.02, 0.01, 0.05]))
    position = (frame @ T @ marker)[:, :3, 3]
    tracker = Tracker(position, np.ones(len(T), dtype=np.bool_), base_known=known, marker_known=False)
    tracker, where = tracker.with_mount(T)
    assert "20.0, 10.0, 50.0 mm" in where
    np.testing.assert_allclose(tracker.predicted(T), position, atol=1e-9)
    bent = T @ se3.exp(np.array([0, 0, 0, 0.01, 0, 0]))  # as far as a lever of its own would not do the same
    np.testing.assert_allclose(
        tracker.predicted(bent @ se3.pose(np.eye(3), np.array([0, 0, 0.03]))), position, atol=1e-3
    )


@pytest.mark.parametrize(
    ("apart", "stands"), [((0.2, -1, 2, 0.5, 1.0, -2.0), "anew"), ((0, 0, 0.01, 0, 0, 0), "still")]
)
def test_a_tracker_that_was_put_up_anew_is_registered_in_each_session(apart: tuple[float, ...], stands: str) -> None:
    """Of nothing missing, in three sessions with the tripod moved, 0.5 m outside the catalogue was made.

    A session that lies one centimetre off may have been homed so.
    """
    T, session = poses(5, 90), np.repeat([0, 3, 4], 30)
    frames = se3.exp(np.outer(session, apart) / 3.0)
    position, quaternion = se3.to_parts(frames @ T @ se3.pose(np.eye(3), np.array([0.02, 0.01, 0.05])))
    tracker = Tracker(position, np.ones(len(T), dtype=np.bool_), base_known=False, marker_known=False)
    tracker, places = tracker.with_places(session, T)
    assert bool(places) == (tracker.session is not None) == (stands == "anew")
    if stands == "anew":
        tracker, why = tracker.with_mount(T)[0].with_orientations(quaternion, T)
        assert why == ""
        np.testing.assert_allclose(tracker.observed, tracker.predicted(T), atol=1e-9)


def test_a_tracker_stays_where_the_model_or_too_few_rows_leave_it() -> None:
    """Where the base is known nothing is registered, and a session without rows to register on cannot be."""
    T, session = poses(5, 90), np.repeat([0, 3, 4], 30)
    position = (se3.exp(np.outer(session, (0.2, -1, 2, 0.5, 1.0, -2.0))) @ T)[:, :3, 3]
    for rows, known in ((np.ones(90, dtype=np.bool_), True), (session < 4, False)):
        tracker = Tracker(position, rows, base_known=known, marker_known=False)
        assert tracker.with_places(session, T) == (tracker, "")


@pytest.mark.parametrize(("length", "turns", "fitted"), [(0.05, 0.4, True), (0.005, 0.4, False), (0.05, 0.02, False)])
def test_a_short_lever_or_one_that_hardly_turns_stays_where_it_was(length: float, turns: float, fitted: bool) -> None:
    """The one is a tool that is too long, which has a name; of the other the recording shows too little."""
    T = se3.exp(np.random.default_rng(4).uniform(-1.0, 1.0, (200, 6)) * np.repeat([0.4, turns], 3))
    position = (T @ se3.pose(np.eye(3), np.array([0, 0, length])))[:, :3, 3]
    tracker, where = Tracker(position, np.ones(len(T), dtype=np.bool_), False, False).with_mount(T)
    assert bool(where) == (tracker.mount is not None) == fitted


def test_a_tracker_that_saw_nothing_mounts_no_marker() -> None:
    """An eigenvalue of no numbers ended the run, where positions were all missing."""
    T = poses()
    blind = Tracker(np.full((len(T), 3), np.nan), np.ones(len(T), dtype=np.bool_), base_known=True, marker_known=False)
    assert blind.with_mount(T) == (blind, "")


@pytest.mark.parametrize("quaternion", [None, "fixed", "missing"])
def test_orientations_that_are_none_are_left_out(quaternion: str | None) -> None:
    """Without orientations, with one that never follows the arm, or all missing: positions alone, and it is said."""
    T = poses(1)
    T[:, :3, :3] = se3.matrix_from_rotvec(np.random.default_rng(2).uniform(-2, 2, (len(T), 3)))
    given = {"fixed": np.tile([1.0, 0, 0, 0], (len(T), 1)), "missing": np.full((len(T), 4), np.nan)}
    tracker = Tracker(T[:, :3, 3], np.ones(len(T), dtype=np.bool_), base_known=False, marker_known=False)
    tracker, why = tracker.with_orientations(None if quaternion is None else given[quaternion], T)
    assert tracker.observed.shape == (len(T), 3)
    assert "positions alone" in why


def recording(*effects: object) -> CalibrationLog:
    t = np.arange(400)[:, None] / 100.0
    path = np.array([0.3, 1.4, -0.38]) + np.array([0.3, 0.3, 0.03]) * np.sin(2 * t + np.array([0.0, 1.0, 2.0]))
    plan = plan_of([Segment(path, np.zeros(len(path), dtype=np.int64), 0, 0.0, 0.2)], 100.0)
    return simulate(machine_of(MODEL).with_effects(*effects), plan)


MODEL = model_from_dict(
    {"arm": "raven2_left", "joints": [1, 2, 3], "controller": {"kp": [400.0, 400.0, 4000.0], "kd": [20.0, 20.0, 200.0]}}
)


def test_every_outside_signal_is_compared() -> None:
    """Encoders and tracker stand beside each other in one scene, and each shows an effect behind both."""
    log, sag = recording(GravitySag(2, 50.0)), GravitySag(2, 50.0)
    scene = build_scene(log, MODEL, np.ones(len(log), dtype=np.bool_)).strict()
    assert [c.name for c in scene.channels if c.signal != "measured_jp"] == [
        *(f"external_jp_{j}" for j in (1, 2, 3)),
        *(f"tracker_{kind}_{axis}" for kind in ("cp", "rotation") for axis in "xyz"),
    ]
    before, after = (np.sqrt(np.nanmean(scene.residual(e) ** 2, axis=0)) for e in ((), (sag,)))
    explained = {c.name: a < 0.1 * b for c, b, a in zip(scene.channels, before, after, strict=True) if b > 1e-4}
    assert {"external_jp_2", "tracker_cp_x"} <= set(explained)
    assert all(explained.values())
    alone = build_scene(replace(log, external_jp=None), MODEL, np.ones(len(log), dtype=np.bool_))
    assert {c.signal for c in alone.channels} == {"measured_jp", "tracker_cp", "tracker_rotation"}


@pytest.mark.parametrize(
    ("mixed", "words"),
    [((1, -2, 3), "joint 2 moves the other way"), ((2, 1, 3), "joints 1 and 2 are exchanged"), ((1, 2, 3), "")],
)
def test_joints_that_are_mixed_up_are_refused_where_only_a_tracker_looks_on(
    mixed: tuple[int, int, int], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A wrong sign was outside the catalogue, without a word on what it is; a sag of a centimetre is no such thing."""
    log = recording(GravitySag(2, 50.0))
    columns = np.sign(mixed) * log.measured_jp[:, np.abs(mixed) - 1]
    seldom = log.tracker_cp.position.copy()
    seldom[np.arange(len(log)) % 5 != 3] = np.nan  # a slower tracker, whose rows no stride of the log's may meet
    tracker = replace(log.tracker_cp, position=seldom, quaternion=None)
    given = replace(log, measured_jp=columns, setpoint_jp=None, external_jp=None, tracker_cp=tracker)
    monkeypatch.setattr("gpcorrect.discrepancy.recording.tracker.ENOUGH", 80)
    if not words:
        build_scene(given, MODEL, np.ones(len(log), dtype=np.bool_))
        return
    with pytest.raises(DataError, match=words):
        build_scene(given, MODEL, np.ones(len(log), dtype=np.bool_))


def test_what_rounding_leaves_is_no_joint_that_moves_the_other_way() -> None:
    """A run that advice simulated without noise was refused so, and with it the user's recording."""
    body = machine_of(MODEL).body
    less, much = (lambda signs, order, size=size: size * signs.sum() ** 4 for size in (1e-11, 1e-3))
    refuse_mixed_joints(body, "measured_jp", less, less, "it")
    with pytest.raises(DataError, match="moves the other way"):
        refuse_mixed_joints(body, "measured_jp", much, much, "it")


def noisy(*effects: Effect) -> CalibrationLog:
    """Return twelve motions as encoders and a tracker see them, with the noise of MODEL_WITH_NOISE."""
    return simulate(machine_of(MODEL_WITH_NOISE).with_effects(*effects), raven_swings(5, 12, 4.0), seed=7)


NOISE = {"tracker_white": 1e-4, "external_jp_white": [1e-4, 1e-4, 1e-4]}
MODEL_WITH_NOISE = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 100, "noise": NOISE})


def test_a_tracker_that_is_late_alone_has_its_name() -> None:
    """20 ms behind punctual encoders were a resonance, a registration error and couplings, in minutes."""
    found = find_discrepancy(MODEL_WITH_NOISE, noisy(Delay("tool", 0.02)))
    (late,) = found.verdict.effects
    assert (late.name, late.joint, late.level) == ("delay", "tool", Level.EXACT)
    low, high = late.parameters["delay"].ci95
    assert low < 0.02 < high
    assert high - low < 0.002


@pytest.mark.parametrize(
    ("sensors", "places"),
    [
        ({"external_jp", "tracker_cp"}, {"all", "tool"}),
        ({"external_jp"}, {"all"}),
        ({"tracker_cp"}, {"all"}),
    ],
)
def test_a_tracker_is_late_alone_only_beside_encoders(sensors: set[str], places: set[str]) -> None:
    log = replace(noisy(), **dict.fromkeys({"external_jp", "tracker_cp"} - sensors))
    scene = build_scene(log, MODEL_WITH_NOISE, np.ones(len(log), dtype=np.bool_))
    kept, _ = split_by_needs(all_candidates(scene), scene, log)
    assert {c.joint for c in kept if c.name == "delay"} == places


def test_noise_and_tolerance_together_become_white() -> None:
    """Seen through the slack, noise plus errors within the tolerance has the covariance of the noise alone."""
    rng = np.random.default_rng(0)
    slopes, sigma = rng.standard_normal((40, 2, 5)), 0.7
    rows = np.ones((40, 2), dtype=np.bool_)
    slack = slack_of(slopes, rows, (ChannelNoise(sigma, 0.0, 1.0),) * 2, 0.01)
    B = slopes.reshape(80, 5)
    W = np.eye(80) - B @ slack.pick
    np.testing.assert_allclose(W @ (sigma**2 * np.eye(80) + B @ B.T) @ W.T, sigma**2 * np.eye(80), atol=1e-9)


def test_what_is_taken_follows_the_rows_that_may_be_looked_at() -> None:
    """The sealed rows change nothing of what is taken, and get their fraction of it."""
    rng = np.random.default_rng(1)
    slopes, rows = rng.standard_normal((30, 3, 4)), np.ones((30, 3), dtype=np.bool_)
    rows[20:] = False
    slack = slack_of(slopes, rows, (ChannelNoise(0.1, 0.0, 1.0),) * 3, 0.01)
    residual = slopes @ np.ones(4)
    other = residual + 100.0 * (~rows)
    np.testing.assert_array_equal(slack.part(residual), slack.part(other))
    assert np.abs((residual - slack.part(residual))[20:]).max() < 0.2 * np.abs(residual[20:]).max()


def test_slopes_agree_with_a_tracker_that_is_turned() -> None:
    """In a turned tracker frame the slopes turn with it, and a registration takes up rigid motions entirely."""
    chain = raven2("left").chain
    rng = np.random.default_rng(2)
    q = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (50, 6))
    tip = chain.forward(q)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    T = se3.pose(turn, np.ones(3))
    seen = tracker_of(T @ tip, base_known=False)
    np.testing.assert_allclose(seen.predicted(tip)[:, :3], (T @ tip)[:, :3, 3], atol=1e-12)
    plain, seen = (table_slopes(chain, q, S, tracker_of(S @ tip, base_known=True)) for S in (np.eye(4), T))
    rows = plain.shape[2] - 6  # the last six are the registration's own errors
    np.testing.assert_allclose(seen[:, :3], np.einsum("ij,njr->nir", turn, plain[:, :3]), atol=1e-9)
    free = table_slopes(chain, q, np.eye(4), tracker_of(tip, base_known=False))
    assert free.shape[2] == rows
    assert np.abs(free[..., 4 * 2]).max() > 1e-6  # an angle between axes is no rigid motion


def tracker_of(T: np.ndarray, *, base_known: bool) -> Tracker:
    return Tracker(T[:, :3, 3], np.ones(len(T), dtype=np.bool_), base_known=base_known, marker_known=base_known)


def test_single_samples_far_off_do_not_move_the_registration() -> None:
    """One sample of a hundred is three centimetres off: the others are seen where they were, to a micrometre."""
    log, rng = recording(), np.random.default_rng(7)
    far = np.zeros(log.tracker_cp.position.shape)
    far[20::100] = 0.03 + 0.005 * rng.random((len(far[20::100]), 3))
    odd = replace(log, tracker_cp=replace(log.tracker_cp, position=log.tracker_cp.position + far))
    scene = build_scene(odd, MODEL, np.ones(len(odd), dtype=np.bool_))
    seen_there = [i for i, c in enumerate(scene.channels) if c.signal == "tracker_cp"]
    left = scene.residual()[:, seen_there]
    assert np.abs(left[far[:, 0] == 0]).max() < 1e-6
