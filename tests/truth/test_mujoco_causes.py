"""Each cause of the MuJoCo truth moves the recording as its law says."""

from __future__ import annotations

import numpy as np
import pytest
from mujoco_cases import in_rows, plan_along, setting, with_cause
from truth_mujoco import AHEAD, CATALOGUE, OUTSIDE, SUITES, specs
from truth_mujoco.case import Setting
from truth_mujoco.facts import nominal_tables
from truth_mujoco.stages import plays, ring, strain

from gpcorrect.sim import effect_from_dict, machine_of, model_from_dict, run
from gpcorrect.types import CalibrationLog

HIDDEN = {  # of the RAVEN-like arm: column and numbers, all far above the noise and inside the catalogue's ranges
    "homing_offset": (1, {"offset": 2e-3}),
    "pulley_eccentricity": (0, {"amplitude": 2e-3, "waves": 11.0, "phase": 0.7}),
    "cable_stretch": (1, {"stiffness": 900.0}),
    "nonlinear_stretch": (1, {"stiffness": 400.0, "cubic": 3e7}),
    "length_dependent_stiffness": (1, {"source": 3, "rigidity": 60.0, "length": -0.25}),
    "gravity_sag": (1, {"stiffness": 900.0}),
    "payload": (0, {"mass": 0.3}),
    "backlash": (0, {"radius": 1.5e-3}),
    "coulomb_friction": (0, {"torque": 1.0, "side": "motor"}),
    "viscous_friction": (0, {"damping": 4.0, "side": "motor"}),
    "stribeck_friction": (0, {"torque": 0.5, "static_torque": 1.2, "speed": 0.1, "side": "motor"}),
    "capstan_friction": (1, {"wrap": 0.3, "side": "motor"}),
    "position_dependent_friction": (0, {"torque": 0.8, "swing": 0.6, "waves": 9.0, "phase": 0.3, "side": "motor"}),
    "creep": (1, {"compliance": 1e-3, "time_constant": 3.0}),
    "drift": (0, {"rate": 2e-4, "time_constant": float("inf")}),
    "delay": (0, {"delay": 0.008}),
    "cable_slip": (0, {"step": 2e-3, "instant": 7.0, "session": 0}),
    "torque_saturation": (0, {"limit": 0.0}),  # filled in from the run
    "joint_stop": (0, {"stiffness": 60.0, "limit": 0.72, "end": "upper"}),
    "resonance": (0, {"frequency": 9.0, "damping_ratio": 0.05}),
    "shaft_bending": (0, {"rigidity": 0.5}),
    "rcm_shift": (0, {"stiffness": 2000.0}),
}
# Share of a trace that the product's effect with the same numbers explains at least. Dry friction and slack remember
# what came before the first sample, a cable rings in MuJoCo and not in the product
LEAST = {
    "backlash": 0.85, "coulomb_friction": 0.85, "stribeck_friction": 0.7, "position_dependent_friction": 0.7,
    "capstan_friction": 0.8, "creep": 0.5, "torque_saturation": 0.8, "joint_stop": 0.9,
}  # fmt: skip
ELSE = 0.95
PLACES = {"payload": "all", "delay": "all", "shaft_bending": "tool", "rcm_shift": "base"}


def traces(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return what a cause does to the motion, by MuJoCo and by the product's effect with the same numbers."""
    where = setting()
    column, params = HIDDEN[name]
    if name == "torque_saturation":
        params = {"limit": float(0.98 * np.abs(where.readings.effort[where.reference.logged, column]).max())}
    _, after = with_cause(where, name, column, params)
    log = commands(where)
    model = model_from_dict(nominal_tables(where, np.random.default_rng(0)))
    plan = plan_along(log, model.log_rate_hz)
    effect = effect_from_dict({"name": name, "joint": PLACES.get(name, column + 1)} | params)
    without, with_it = (run(machine_of(m), plan) for m in (model, model.with_effects(effect)))
    rows = where.reference.logged
    if CATALOGUE[name].tracker_only:
        hidden = (after.tip - where.readings.tip)[rows, :3, 3]
        return hidden, in_rows(with_it.T_base_tip - without.T_base_tip)[:, :3, 3]
    scale = where.joint_noise.rms
    return (after.outside - where.readings.outside)[rows] / scale, in_rows(with_it.q - without.q) / scale


def commands(where: Setting) -> CalibrationLog:
    """Return the commands of a motion as a log on the clock of its session."""
    rows, reference = where.reference.logged, where.reference
    return CalibrationLog(
        time=reference.session_time[rows],
        trajectory=reference.trajectory[rows],
        session=reference.session[rows],
        setpoint_jp=reference.position[::2][rows],
        measured_jp=reference.position[::2][rows],
        payload=reference.payload[rows],
    )


@pytest.mark.parametrize("name", sorted(HIDDEN))
def test_the_products_effect_does_the_same(name: str) -> None:
    """Signs, units and sizes are the catalogue's: the product's effect with the hidden numbers explains the trace."""
    hidden, ours = traces(name)
    assert np.sum(hidden**2) > 0
    assert 1.0 - np.sum((hidden - ours) ** 2) / np.sum(hidden**2) > LEAST.get(name, ELSE)


@pytest.mark.parametrize(
    ("name", "params", "source"),
    [
        ("transmission_ratio", {"error": 0.02, "home": 0.9}, 0),
        ("cable_coupling", {"coefficient": 0.03, "source": 2, "home": 1.2}, 1),
    ],
)
def test_ratio_and_coupling_act_about_the_pose_of_homing(name: str, params: dict, source: int) -> None:
    """Reported less true grows in proportion to the way from home, and is nothing there."""
    where = setting()
    _, after = with_cause(where, name, 0, params)
    slope = params.get("error", params.get("coefficient"))
    rows = where.reference.logged
    error = (after.reported - after.outside)[rows, 0]
    np.testing.assert_allclose(error, slope * (after.outside[rows, source] - params["home"]), atol=1e-9)


def test_a_table_error_moves_the_tool_and_not_the_motors() -> None:
    """The tool goes elsewhere; motors hardly feel the changed weight."""
    where = setting()
    _, after = with_cause(where, "dh_error", 1, {"alpha": 0.01, "a": 0.0, "d": 0.0, "theta": 0.0})
    rows = where.reference.logged
    moved = np.abs(after.tip - where.readings.tip)[rows, :3, 3].max()
    assert moved > 5e-4
    assert np.abs(after.outside - where.readings.outside)[rows].max() < 0.2 * moved


def test_registration_is_a_similarity_of_the_tools_places() -> None:
    """Distances between places grow by the scale, all alike."""
    where = setting()
    params = {"x": 1e-3, "y": 0.0, "z": -2e-3, "rx": 0.01, "ry": -0.02, "rz": 0.005, "scale": 0.01}
    _, after = with_cause(where, "registration_error", 0, params)
    before, then = (np.diff(r.tip[::200, :3, 3], axis=0) for r in (where.readings, after))
    far = np.linalg.norm(before, axis=1) > 1e-3
    np.testing.assert_allclose(np.linalg.norm(then, axis=1)[far] / np.linalg.norm(before, axis=1)[far], 1.01, rtol=1e-9)


def test_hysteresis_lags_and_keeps_within_its_loop() -> None:
    """The lag follows the direction of motion, and is at most the sum of its elements' slack."""
    where = setting()
    shares = [0.3, 0.3, 0.2, 0.2]
    _, after = with_cause(where, "hysteresis", 0, {"width": 4e-3, "depth": 0.5, "shares": shares})
    lag = (where.readings.outside - after.outside)[:, 0]
    speed = np.gradient(where.readings.outside[:, 0])
    moving = np.abs(speed) > 0.1 * np.abs(speed).max()
    most = 0.5 * 4e-3 * float(np.array(shares) @ [0.15, 0.4, 1.0, 2.2])
    assert np.abs(lag).max() <= 1.1 * most
    assert np.corrcoef(np.sign(speed[moving]), lag[moving])[0, 1] > 0.7


def test_recorded_counts_are_multiples_of_the_step() -> None:
    """The written positions are whole steps, at most half a step from the motors."""
    where = setting()
    _, after = with_cause(where, "encoder_quantisation", 0, {"step": 1e-3})
    counts = after.reported[:, 0] / 1e-3
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(after.reported - where.readings.reported).max() <= 0.5e-3 + 1e-12


@pytest.mark.parametrize(
    ("name", "params"), [("noise_change", {"std": 1e-3, "since": 6.0}), ("speed_noise", {"seconds": 1e-3})]
)
def test_noise_grows_where_its_law_says(name: str, params: dict) -> None:
    """After the moment, or with the speed; nowhere else, and nothing moves."""
    where = setting()
    _, after = with_cause(where, name, 0, params)
    extra = after.extra_noise[:, 0]
    here = where.reference.session_time >= 6.0 if name == "noise_change" else np.abs(where.before.speed[:, 0]) > 0
    assert (extra[here] > 0).all()
    assert not extra[~here].any()
    assert not after.extra_noise[:, 1:].any()
    np.testing.assert_array_equal(after.outside, where.readings.outside)


@pytest.mark.parametrize("term", ["gravity", "inertia", "velocity"])
def test_a_missing_feedforward_term_leaves_its_own_error(term: str) -> None:
    """The motor lags by the missing torque over kp: against weight, acceleration or speed."""
    where = setting(feedforward="rigid-body")
    assert where.machine.plant.feedforward == "rigid-body"
    run_with, after = with_cause(where, "feedforward_error", 0, {"term": term, "fraction": -0.5})
    rows, plant = where.reference.logged, where.machine.plant
    moved = (after.reported - where.readings.reported)[rows, 0]
    missing = {
        "gravity": -0.5 * where.before.weight[rows, 0],
        "inertia": -0.5 * plant.arm.motor_inertia[0] * where.reference.acceleration[::2][rows, 0],
        "velocity": -0.5 * plant.kd[0] * where.reference.speed[::2][rows, 0],
    }[term]
    assert run_with.plant.fed.min() == 0.5
    assert np.corrcoef(moved, missing / plant.kp[0])[0, 1] > 0.6


def test_a_stiffer_loop_sags_less() -> None:
    """With more kp and nothing fed forward the arm hangs lower by less."""
    where = setting(feedforward="none")
    _, after = with_cause(where, "gain_error", 1, {"proportional": 0.5, "derivative": 0.2})
    rest = where.reference.logged[:20]  # at rest before the first move
    wanted = where.reference.position[::2]
    before, now = ((r.reported - wanted)[rest, 1].mean() for r in (where.readings, after))
    assert now == pytest.approx(before / 1.5, rel=0.02)


@pytest.mark.parametrize("name", sorted(OUTSIDE))
def test_what_is_outside_leaves_a_trace(name: str) -> None:
    """Each cause that no catalogue lists moves what its sensors see, on the arm and by finite amounts."""
    where = setting()
    from truth_mujoco.causes.cause import Scene

    cause = OUTSIDE[name]
    params = cause.draw(np.random.default_rng(4), 0, Scene(where.before, where.joint_noise.rms, 1))
    _, after = with_cause(where, name, 0, params)
    assert np.isfinite(after.outside).all()
    ratio = where.ratio(_hidden(name, params), after, where.readings, where.reference.logged)
    assert 0.01 < ratio < 100.0


def _hidden(name: str, params: dict) -> object:
    from truth_mujoco.machine import Hidden

    return Hidden(name, 0, params)


def test_stages_agree_with_their_laws() -> None:
    """Slack ends at its edges, a slow path does not ring, a constant load creeps to its settled strain."""
    path = 0.1 * np.sin(np.linspace(0.0, 9.0, 3000))
    place = plays(path, np.array([0.01]))[:, 0]
    assert np.abs(path - place).max() < 1.02 * 0.01
    assert np.abs(np.abs(path - place)[500:] - 0.01).min() < 1e-4
    slow = 0.1 * np.linspace(0.0, 1.0, 3000) ** 2
    assert np.abs(ring(slow, 20.0, 0.3) - slow).max() < 2e-4
    time = np.arange(4000) / 500.0
    load = np.where(time > 0.1, 2.0, 0.0)
    np.testing.assert_allclose(strain(load, time, 0.5, 0.4)[-1], 1.0, rtol=1e-3)
    halfway = strain(load, time, 0.5, 0.4)[np.searchsorted(time, 0.5)]
    assert halfway == pytest.approx(1.0 - np.exp(-1.0), rel=0.02)


def test_catalogue_and_suites_are_whole() -> None:
    """The catalogue's 29 names, at least ten outside it; a seed means one wish; every cause has its turn."""
    from gpcorrect.sim import EFFECTS

    assert set(CATALOGUE) <= set(EFFECTS)
    assert len(CATALOGUE) == 29
    assert len(OUTSIDE) >= 10
    assert not set(OUTSIDE) & (set(EFFECTS) | set(AHEAD))
    for suite in SUITES:
        assert list(specs(suite, 4, 100)) == list(specs(suite, 6, 98))[2:]
    assert {s.hidden[0] for s, _ in specs("one", 29, 1)} == set(CATALOGUE)
    assert {s.signals for s, _ in specs("null", 60, 1)} == {"joints", "tracker", "both", "bare"}
