"""What keeps a correction small, slow, and at home: bounds, rates, states."""

from __future__ import annotations

import io
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from service_support import PATIENT, ShiftCorrector

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect_service import ServerSettings, ServiceError
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.ops.metrics import Counters
from gpcorrect_service.protocol.bounds import CorrectionBound, RateBound, Throttle
from gpcorrect_service.server import models
from gpcorrect_service.server.handlers import Health
from gpcorrect_service.server.models import FAULTS_IN_A_ROW, Active, Model, load_model
from gpcorrect_service.server.queues import WorkerQueue
from gpcorrect_service.server.requests import Clock, RequestParser

seeds = st.integers(0, 2**32 - 1)


def poses(rng: np.random.Generator, n: int, spread: float) -> np.ndarray:
    R = se3.matrix_from_rotvec(spread * rng.standard_normal((n, 3)))
    return np.hstack([spread * rng.standard_normal((n, 3)), se3.quaternion_from_matrix(R)])


@given(seed=seeds, position=st.floats(1e-4, 1.0), rotation=st.floats(1e-3, 3.0))
@example(seed=51502583, position=1e-4, rotation=1.0)
def test_bounded_commands_are_within_their_bounds(seed: int, position: float, rotation: float) -> None:
    """No command ends further from its reference than the bounds; those within are handed on untouched."""
    rng = np.random.default_rng(seed)
    reference, command = poses(rng, 8, 0.3), poses(rng, 8, 0.3)
    bounded, cut = CorrectionBound(position, rotation).apply(reference, command)
    away = np.linalg.norm(bounded[:, :3] - reference[:, :3], axis=1)
    assert (away <= position + 1e-15).all()  # a rounding of places about a metre from the origin
    R = [se3.matrix_from_quaternion(p[:, 3:]) for p in (bounded, reference)]
    turned = se3.angle(R[0] @ R[1].transpose(0, 2, 1))
    assert (turned <= rotation * (1 + 1e-6)).all()
    np.testing.assert_array_equal(bounded[~cut], command[~cut])


def test_a_bound_keeps_the_way() -> None:
    """A command that is cut lies on the way from its reference to where it wanted to go."""
    reference, command = np.zeros((1, 3)), np.array([[0.003, 0.0, 0.004]])
    bounded, cut = CorrectionBound(0.001).apply(reference, command)
    np.testing.assert_allclose(bounded, [[0.0006, 0.0, 0.0008]], rtol=1e-12)
    assert cut.tolist() == [True]
    assert not CorrectionBound().acts


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_bounds_are_above_zero(bad: float) -> None:
    """A bound of nothing, or none that is a number, is a mistake."""
    with pytest.raises(DataError):
        CorrectionBound(bad)


@given(seed=seeds, rate=st.floats(0.01, 10.0))
def test_a_correction_never_changes_faster_than_its_rate(seed: int, rate: float) -> None:
    """Between any two samples of a stream every component moves by at most rate times time."""
    rng = np.random.default_rng(seed)
    bound = RateBound(rate)
    times = np.cumsum(rng.uniform(1e-4, 0.1, 30))
    passed = np.array([bound.step(t, rng.standard_normal(3))[0] for t in times])
    speed = np.abs(np.diff(passed, axis=0)) / np.diff(times)[:, None]
    assert (speed <= rate * (1 + 1e-9)).all()


def test_a_slow_correction_passes_untouched() -> None:
    """What moves slower than the rate is not changed; a gap in the numbers begins anew."""
    bound = RateBound(1.0)
    for i in range(10):
        passed, acted = bound.step(0.1 * i, np.array([0.05 * i]))
        assert not acted
        assert passed == pytest.approx([0.05 * i])
    assert np.isnan(bound.step(1.0, np.array([np.nan]))[0]).all()
    assert bound.step(1.1, np.array([9.0]))[0] == pytest.approx([9.0])


def test_a_joint_that_is_missing_leaves_the_others_bounded() -> None:
    """One number that is missing begins anew by itself; the other joints go on as fast as they may."""
    bound = RateBound(1.0)
    for i, asked in enumerate(([0.0, 0.0], [np.nan, 9.0], [9.0, 9.0])):
        passed, acted = bound.step(0.1 * i, np.array(asked))
        assert acted is (i > 0)
        assert passed == pytest.approx([[0.0, 0.0], [np.nan, 0.1], [9.0, 0.2]][i], nan_ok=True)


@given(gaps=st.lists(st.floats(0.0, 0.05), min_size=1, max_size=200), rate=st.floats(10.0, 1000.0))
def test_a_throttle_lets_no_more_pass_than_its_rate(gaps: list[float], rate: float) -> None:
    """In any time, what passed is at most rate times time, one burst more."""
    throttle, now, passed = Throttle(rate), 100.0, 0
    for gap in gaps:
        now += gap
        passed += throttle.passes(now)
    assert passed <= rate * sum(gaps) + max(1.0, 0.1 * rate) + 1e-6


def test_a_throttle_lets_steady_traffic_pass() -> None:
    """Traffic just below the rate is never refused."""
    throttle = Throttle(100.0)
    assert all(throttle.passes(10.0 + i / 99.0) for i in range(1000))


def test_states_follow_crtk() -> None:
    """DISABLED without a model, PAUSED by order, FAULT after failures in a row; ENABLED ends both."""
    active = Active()
    assert active.state == "DISABLED"
    active.activate(Model(ShiftCorrector()))
    assert active.state == "ENABLED"
    active.pause(True)
    assert refused(active) == ("PAUSED", "BUSY")
    active.pause(False)
    for _ in range(FAULTS_IN_A_ROW - 1):
        active.failed()
    assert active.state == "ENABLED"
    active.answered()
    for _ in range(FAULTS_IN_A_ROW):
        active.failed()
    active.answered()
    assert refused(active) == ("FAULT", "INTERNAL")
    active.pause(False)
    assert active.state == "ENABLED"
    assert active.pose_model().id == "unnamed"


def test_only_a_fitted_model_that_is_quick_is_asked_on_the_thread_that_brings_a_query(
    small_model: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Anybody's own corrector may wait for something, and with it every other query of that connection."""
    assert load_model(small_model).quick
    assert not Model(ShiftCorrector()).quick
    monkeypatch.setattr(models, "QUICK_SECONDS", 0.0)
    assert not load_model(small_model).quick


def refused(active: Active) -> tuple[str, str]:
    with pytest.raises(ServiceError) as caught:
        active.pose_model()
    return active.state, caught.value.status


def test_a_dead_worker_is_a_fault() -> None:
    """When a thread that answers is gone, health says FAULT though the model is well."""
    queue: WorkerQueue[int] = WorkerQueue(
        "one", lambda _: None, lambda _: None, capacity=1, logger=open_logger(io.StringIO())
    )
    active = Active(Model(ShiftCorrector()))
    parser = RequestParser(active, ServerSettings(), open_logger(io.StringIO()), Clock())
    health = Health(parser, Counters(), {"one": queue})
    queue.start()
    assert health.report().state == "ENABLED"
    queue.close()
    assert queue.join(time.monotonic() + PATIENT)
    assert health.report().state == "FAULT"
