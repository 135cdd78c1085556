"""What a motion capture export holds, whatever system wrote it, and which part of it is the tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.logs.columns import MocapOptions
from gpcorrect.logs.markers import tool_poses
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta, PoseSignal

__all__ = ["METRES", "Body", "Take", "log_of", "scale_of"]

METRES: Mapping[str, float] = {
    "m": 1.0,
    "meters": 1.0,
    "cm": 1e-2,
    "centimeters": 1e-2,
    "mm": 1e-3,
    "millimeters": 1e-3,
    "in": 0.0254,
    "inches": 0.0254,
    "ft": 0.3048,
    "feet": 0.3048,
}


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body that the capture software itself solved.

    Parameters
    ----------
    pose : PoseSignal
        m and wxyz; NaN where it was not seen.
    error : (n,) array or None
        Mean distance of its markers from where the body puts them, m; None where the export does not say.
    """

    pose: PoseSignal
    error: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Take:
    """One recording of a motion capture system.

    Parameters
    ----------
    time : (n,) array
        s, from the recording's own origin.
    bodies : mapping of name to Body
        Bodies solved by the software.
    markers : mapping of name to (n, 3) array
        m; NaN where a marker is hidden.
    others : sequence of str
        Markers that are not on a tool unless the user says so: unlabelled ones, and expected places of markers.
    remarks : sequence of str
        What reading had to decide.
    """

    time: FloatArray
    bodies: Mapping[str, Body] = field(default_factory=dict)
    markers: Mapping[str, FloatArray] = field(default_factory=dict)
    others: Sequence[str] = ()
    remarks: Sequence[str] = ()
    tracker: str = ""


def scale_of(unit: str) -> float:
    """Metres in a unit of length.

    Raises
    ------
    LogError
        The unit is none that is known.
    """
    scale = METRES.get(unit.strip().lower())
    if scale is None:
        raise LogError(f"positions are in {unit!r}, expected one of {', '.join(METRES)}.")
    return scale


def log_of(take: Take, options: MocapOptions) -> CalibrationLog:
    """Log of a take: the pose of one body, or of the tool that carries the chosen markers.

    Nothing chosen: the only body, else all labelled markers as one tool. The fit's or the software's own error
    becomes the extra column `marker_rms` (m).

    Raises
    ------
    LogError
        There is no such body or marker, several bodies and none was chosen, or nothing at all.
    DataError
        The markers do not give a pose.
    """
    if options.markers is None and (take.bodies or options.body is not None):
        pose, rms, said = _from_body(take, options.body)
    else:
        pose, rms, said = _from_markers(take, options.markers)
    zeros = np.zeros(len(take.time), np.int64)
    return CalibrationLog(
        take.time,
        zeros,
        zeros,
        tracker_cp=pose,
        extra={} if rms is None else {"marker_rms": rms},
        meta=LogMeta(tracker=take.tracker),
        remarks=(said, *take.remarks),
    )


def _from_body(take: Take, name: str | None) -> tuple[PoseSignal, FloatArray | None, str]:
    names = list(take.bodies)
    if name is None and len(names) > 1:
        hint = f'Say which one is on the tool in a mapping file: [mocap] body = "{names[0]}".'
        raise LogError(f"the recording holds {len(names)} bodies: {', '.join(names)}.", hint=hint)
    chosen = names[0] if name is None else name
    if chosen not in take.bodies:
        held = f"Bodies here: {', '.join(names)}." if names else "The recording holds markers only."
        raise LogError(f"there is no body {chosen}.", hint=held)
    body = take.bodies[chosen]
    return body.pose, body.error, f"tracker_cp is the body {chosen}."


def _from_markers(take: Take, chosen: tuple[str, ...] | None) -> tuple[PoseSignal, FloatArray, str]:
    names = chosen or tuple(name for name in take.markers if name not in take.others)
    missing = [name for name in names if name not in take.markers]
    if missing:
        hint = f"Markers here: {', '.join(take.markers)}."
        raise LogError(f"there is no marker {', '.join(missing)}.", hint=hint)
    if not names:
        found = f"{len(take.markers)} markers without labels" if take.markers else "nothing"
        raise LogError(f"expected a body or labelled markers, found {found}.", hint="Label them before exporting.")
    pose, rms = tool_poses(np.stack([take.markers[name] for name in names], axis=1))
    return pose, rms, f"tracker_cp was computed from the markers {', '.join(names)}."
