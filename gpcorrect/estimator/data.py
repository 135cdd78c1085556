"""From a log to what the estimator learns from: joints, state, and by how much the reported position misses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import LogError
from gpcorrect.estimator.state import state_columns
from gpcorrect.rigid import RigidModel
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal
from gpcorrect.velocity import segment_labels

__all__ = ["EstimatorData", "estimator_data", "stated_frame"]


@dataclass(frozen=True, eq=False)
class EstimatorData:
    """A log as the estimator sees it, n samples of d joints.

    Parameters
    ----------
    time : (n,) array
        s.
    trajectory : (n,) int array
        Which motion.
    new : (n,) mask
        Where a path begins: nothing is known of what the arm did before.
    q : (n, d) array
        Reported joints, rad or m.
    state : (n, k) array
        The whole state.
    effort : (n, d) array or None
        Reported efforts.
    position : (n, 3) array
        Reported position, base frame, m.
    seen : (n, 3) array or None
        What the tracker saw, tracker frame, m; NaN where it saw nothing.
    """

    time: FloatArray
    trajectory: IntArray
    new: BoolArray
    q: FloatArray
    state: FloatArray
    effort: FloatArray | None
    position: FloatArray
    seen: FloatArray | None

    @property
    def usable(self) -> BoolArray:
        """(n,) mask of samples with a state, and a label where there are labels."""
        parts = [self.q, self.position, self.state, *([] if self.seen is None else [self.seen])]
        known: BoolArray = np.all([np.isfinite(part).all(axis=1) for part in parts], axis=0)
        return known

    def error(self, registration: RigidModel) -> FloatArray:
        """Return what is to be added to the reported position `(n, 3)`, base frame, m.

        Raises
        ------
        LogError
            The log has no tracker.
        """
        if self.seen is None:
            raise LogError("the log has no tracker_cp to compare with.", hint="Track the tool: gpcorrect vision track")
        return registration.apply(PoseSignal(self.seen)).position - self.position


def estimator_data(log: CalibrationLog, extra: tuple[str, ...] = (), *, needs_truth: bool = True) -> EstimatorData:
    """Take out of a log what the estimator needs; coasting rows of `gpcorrect vision track` are no labels.

    Raises
    ------
    LogError
        A signal is missing.
    """
    if log.measured_jp is None or log.measured_cp is None:
        missing = "measured_jp" if log.measured_jp is None else "measured_cp"
        raise LogError(f"the estimator needs {missing}; the log has {', '.join(log.signals)}.", path=log.name)
    if needs_truth and log.tracker_cp is None:
        raise LogError("the estimator learns from tracker_cp, which the log lacks.", path=log.name)
    _, state = state_columns(log, extra)
    labels = segment_labels(log.time, log.trajectory)
    seen = None if log.tracker_cp is None else _measured(log)
    new: BoolArray = np.concatenate([[True], np.diff(labels) != 0])
    return EstimatorData(
        log.time, log.trajectory, new, log.measured_jp, state, log.measured_jf, log.measured_cp.position, seen
    )


def _measured(log: CalibrationLog) -> FloatArray:
    assert log.tracker_cp is not None
    status = log.extra.get("tracking_status")
    if status is None:
        return log.tracker_cp.position
    return np.where((status == 0)[:, None], log.tracker_cp.position, np.nan)


def stated_frame(log: CalibrationLog) -> RigidModel | None:
    """Return the motion from the tracker's frame to the base that the log states (`tracker_base`), if it does."""
    stated = log.meta.tracker_base
    if stated is None:
        return None
    T_base_tracker = se3.invert(se3.pose(se3.matrix_from_rotvec(np.array(stated[3:])), np.array(stated[:3])))
    R, t = T_base_tracker[:3, :3], T_base_tracker[:3, 3]
    return RigidModel("position", R_position=R, t=t, R_left=R)
