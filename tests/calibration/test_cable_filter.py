"""The cable filter on machines of its own model: motor, spring, a load that goes by position, Coulomb friction."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gpcorrect.calibration import FitSettings, JointCorrector, evaluate_model, fit_model, random_sinusoids
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta

LIMITS = np.array([[0.3, 1.5], [0.6, 2.2]])
SPEED = np.array([0.4, 0.5])
STIFFNESS = np.array([40.0, 60.0])  # N m/rad
FRICTION = 0.12  # N m
COUPLING = np.array([[0.01, -0.006], [0.004, 0.008]])
SEEDS = (1, 2, 3)


@cache
def recording(seed: int, seen: bool = True) -> CalibrationLog:
    """Return a log whose efforts are all that stretches the cables, or all but friction (not `seen`)."""
    rng = np.random.default_rng(seed)
    path = random_sinusoids(LIMITS, SPEED, 12 * 12.0, 20.0, rng)
    motor, n = path.q, len(path.time)
    load = np.column_stack([1.2 * np.sin(motor[:, 0]) * np.cos(motor[:, 1]), 1.5 * np.cos(motor[:, 1])])
    middle, joint = motor - load / STIFFNESS, np.empty(motor.shape)
    joint[0] = middle[0]
    for t in range(1, n):
        joint[t] = np.clip(joint[t - 1], middle[t] - FRICTION / STIFFNESS, middle[t] + FRICTION / STIFFNESS)
    effort = STIFFNESS * (motor - joint) if seen else load
    return CalibrationLog(
        time=path.time,
        trajectory=np.arange(n) * 12 // n,
        session=np.zeros(n),
        measured_jp=motor + np.array([0.02, -0.03]) + motor @ COUPLING,
        measured_jf=effort + 0.01 * rng.standard_normal(motor.shape),
        external_jp=joint + 2e-4 * rng.standard_normal(motor.shape),
        meta=LogMeta(joint_types="RR"),
        name="cables",
    )


@cache
def fitted(method: str, seed: int, seen: bool = True) -> tuple[JointCorrector, FloatArray, FloatArray]:
    """Return a model of ten motions, and its errors (RMSE) and the coverage of its intervals on the other two."""
    log = recording(seed, seen)
    held_out = log.trajectory >= 10
    model = fit_model(log.select(~held_out), FitSettings(method=method), task=JointCorrector).corrector
    measured = evaluate_model(model, log.select(held_out)).dirty
    return model, np.sqrt((measured.corrected**2).mean(axis=0)), measured.coverage95


@pytest.mark.parametrize("seed", SEEDS)
def test_the_compliance_of_a_loaded_cable_is_found(seed: int) -> None:
    """Though effort goes by position, within 5 %; and the answers are as good as a line's, which is exact here."""
    model, errors, coverage = fitted("ukf", seed)
    np.testing.assert_allclose(model.law.learned.compliance, 1 / STIFFNESS, rtol=0.05)
    assert (errors < 1.1 * fitted("linear", seed)[1]).all()
    assert (coverage > 0.9).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_play_goes_with_the_load_where_efforts_do_not_show_friction(seed: int) -> None:
    """A line leaves the friction's stretch, the filter less than half of it; and its intervals hold."""
    _, errors, coverage = fitted("ukf", seed, seen=False)
    assert (errors < 0.5 * fitted("linear", seed, seen=False)[1]).all()
    assert (coverage > 0.9).all()


def test_efforts_that_the_motion_never_took_are_outside() -> None:
    """Of whole paths and streams alike, of any size; those of the training's load are inside, missing ones are not."""
    model, log = fitted("ukf", SEEDS[0])[0], recording(SEEDS[0])
    some = np.where(np.arange(len(log)) % 3 == 0, np.nan, 0.0)[:, None]
    for more, inside in ((0.0, 1.0), (3.0, 0.0), (1e9, 0.0), (some, 2 / 3)):
        given = replace(log, measured_jf=log.measured_jf + more)
        whole, stream = model.correct_log(given), model.stream()
        assert whole.in_domain.mean() == pytest.approx(inside, abs=0.1)
        for k in range(40):
            live = stream.correct(log.time[k], log.measured_jp[k], given.measured_jf[k])
            assert live.in_domain == whole.in_domain[k]
            np.testing.assert_allclose(live.joints, whole.joints[k], atol=1e-12)
