"""Two recordings of one session: the robot's, and the motion capture's on a clock of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.logs.sync import TimeOffset, stream_offset
from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

__all__ = ["with_tracker"]

SAME_MOTION = 0.9  # of the spread that one motion must explain of the other
IN_COMMON = 0.5  # of the shorter recording: both are of one session
REFERENCES = ("measured_cp", "setpoint_cp")  # what the robot reports comes first: a servo's lag is then left to be seen


def with_tracker(robot: CalibrationLog, take: CalibrationLog, ahead: float | None = None) -> CalibrationLog:
    """Put the tracker of another recording on the robot's clock and rows.

    Parameters
    ----------
    robot : CalibrationLog
        Without a tracker; its clock runs through all trajectories.
    take : CalibrationLog
        With `tracker_cp`.
    ahead : float, optional
        Seconds by which the take's stamps run ahead of the robot's. Found from the motion when not given, wherever the
        two clocks begin; a lag of the robot behind its command is part of what is found where the robot reports no
        pose.

    Returns
    -------
    CalibrationLog
        The robot's, with `tracker_cp`: NaN where the take saw nothing near in time.

    Raises
    ------
    LogError
        The robot's recording has a tracker already, no pose, or a clock that starts anew; the take has no tracker;
        the motion does not determine how the clocks lie, or they share no time.
    """
    if robot.tracker_cp is not None:
        raise LogError("the robot's recording has a tracker of its own.", hint="Give one tracker.", path=robot.name)
    if take.tracker_cp is None:
        raise LogError("expected a recording with a tracker.", path=take.name)
    for log in (robot, take):
        if log.static or len(log) < 2 or not np.all(np.diff(log.time) > 0):
            raise LogError("expected one clock that runs through the whole recording.", path=log.name)
    seen = Stream("tracker_cp", take.time, take.tracker_cp, source=take.name)
    shift, said = _shift(robot, seen, ahead)
    pose = cast(PoseSignal, interpolate(seen, robot.time + shift))
    missing = ~np.isfinite(pose.position).all(axis=1)
    if missing.all():
        raise LogError("the recordings share no time.", hint=_HINT, path=take.name)
    extra = {
        name: np.asarray(interpolate(Stream(name, take.time, values), robot.time + shift))
        for name, values in take.extra.items()
        if name not in robot.extra
    }
    remarks = [said, f"{missing.sum()} of {len(robot)} samples have no tracker."] if missing.any() else [said]
    return replace(
        robot,
        tracker_cp=pose,
        extra={**robot.extra, **extra},
        meta=replace(robot.meta, tracker=robot.meta.tracker or take.meta.tracker),
        name=f"{robot.name} + {take.name}",
        remarks=(*robot.remarks, *take.remarks, *remarks),
    )


_HINT = "Give the seconds by which the tracker's clock runs ahead: --time-offset SECONDS."


def _shift(robot: CalibrationLog, seen: Stream, ahead: float | None) -> tuple[FloatArray | float, str]:
    """Seconds to add to the robot's stamps, and where they come from."""
    if ahead is not None:
        return ahead, f"the tracker's clock runs {ahead:g} s ahead, as was said."
    name = next((n for n in REFERENCES if n in robot.signals), None)
    if name is None:
        raise LogError("the robot's recording has no pose to match clocks by.", hint=_HINT, path=robot.name)
    found = _search(Stream(name, robot.time, getattr(robot, name)), seen)
    doubt = _doubt(found, robot.time, seen.stamp)
    if doubt:
        raise LogError(f"the motion does not tell how the clocks lie: {doubt}", hint=_HINT, path=seen.source)
    return found.at(robot.time + found.offset), f"the tracker's clock runs {found.offset:.4f} s ahead, found by {name}."


def _doubt(found: TimeOffset, robot: FloatArray, take: FloatArray) -> str:
    """Why not to believe what was found, empty if it may be believed.

    Among all shifts of two long recordings some make short pieces of unrelated motions look alike.
    """
    if not found.observable:
        return found.reason
    if found.explained < SAME_MOTION:
        return f"at the best shift one explains only {found.explained:.0%} of the other."
    start, stop = max(robot[0] + found.offset, take[0]), min(robot[-1] + found.offset, take[-1])
    share = (stop - start) / min(np.ptp(robot), np.ptp(take))
    if share < IN_COMMON:
        return f"at the best shift they share only {share:.0%} of the shorter recording."
    return ""


def _search(reference: Stream, seen: Stream) -> TimeOffset:
    """Try every shift at which the two recordings overlap."""
    spans = [s.stamp[-1] - s.stamp[0] for s in (reference, seen)]
    apart = (seen.stamp[-1] + seen.stamp[0] - reference.stamp[-1] - reference.stamp[0]) / 2
    return stream_offset(seen, reference, max_lag=float(sum(spans)) / 2, centre=float(apart))
