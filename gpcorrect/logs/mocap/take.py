"""What a motion capture export holds, whatever system wrote it, and which part of it is the tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect.errors import DataError, LogError
from gpcorrect.logs.columns import MocapOptions
from gpcorrect.logs.mocap.tool import RIGID, bodies_of, require_rigid, tool_poses, typical_misfit
from gpcorrect.types import CalibrationLog, FloatArray, LogMeta, PoseSignal

METRES: Mapping[str, float] = {
    **dict.fromkeys(("m", "meters"), 1.0),
    **dict.fromkeys(("cm", "centimeters"), 1e-2),
    **dict.fromkeys(("mm", "millimeters"), 1e-3),
    **dict.fromkeys(("in", "inches"), 0.0254),
    **dict.fromkeys(("ft", "feet"), 0.3048),
}


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body that the capture software itself solved."""

    pose: PoseSignal  # m and wxyz; NaN where it was not seen
    # (n,) mean distance of its markers from where the body puts them, m; None where the export does not say
    error: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Take:
    """One recording of a motion capture system."""

    time: FloatArray  # (n,) s, from the recording's own origin
    bodies: Mapping[str, Body] = field(default_factory=dict)  # solved by the software
    # (n, 3) m; NaN where a marker is hidden
    markers: Mapping[str, FloatArray] = field(default_factory=dict)
    # markers that are not on a tool unless the user says so: unlabelled ones, and expected places of markers
    others: Sequence[str] = ()
    remarks: Sequence[str] = ()  # what reading had to decide
    tracker: str = ""


def scale_of(unit: str) -> float:
    """Metres in a unit of length.

    Parameters
    ----------
    unit : str, as an export writes it
    """
    scale = METRES.get(unit.strip().lower())
    if scale is None:
        raise LogError(f"positions are in {unit!r}, expected one of {', '.join(METRES)}.")
    return scale


def log_of(take: Take, options: MocapOptions) -> CalibrationLog:
    """Log of a take: the pose of one body, or of the tool that carries the chosen markers.

    Nothing chosen: the only solved body, else the only body among the markers' labels. The fit's or the software's own
    error becomes the extra column `marker_rms` (m).

    Parameters
    ----------
    take : Take
    options : MocapOptions
    """
    if options.body in take.bodies or (take.bodies and options.body is None and options.markers is None):
        names = list(take.bodies)
        if options.body is None and len(names) > 1:
            hint = f'Say which one is on the tool in a mapping file: [mocap] body = "{names[0]}".'
            raise LogError(f"the recording holds {len(names)} bodies: {', '.join(names)}.", hint=hint)
        chosen = names[0] if options.body is None else options.body
        pose, rms = take.bodies[chosen].pose, take.bodies[chosen].error
        remarks = [f"tracker_cp is the body {chosen}."]
    else:
        pose, rms, remarks = _from_markers(take, options)
    zeros = np.zeros(len(take.time), np.int64)
    return CalibrationLog(
        take.time,
        zeros,
        zeros,
        tracker_cp=pose,
        extra={} if rms is None else {"marker_rms": rms},
        meta=LogMeta(tracker=take.tracker),
        remarks=(*remarks, *take.remarks),
    )


def _from_markers(take: Take, options: MocapOptions) -> tuple[PoseSignal, FloatArray, list[str]]:
    chosen = _named(take, options)
    seen = [name for name in chosen if np.isfinite(take.markers[name]).all(axis=1).any()]
    unseen = [name for name in chosen if name not in seen]
    remarks = [f"markers that were never seen are left out: {', '.join(unseen)}."] if unseen else []
    if not seen:
        found = f"{len(take.markers)} markers without labels or never seen" if take.markers else "nothing"
        raise LogError(f"expected a body or labelled markers, found {found}.", hint="Label them before exporting.")
    if options.markers is None and options.body is None:
        seen, others = _one_tool(take, seen)
        remarks += [f"markers of other bodies are left out: {', '.join(others)}."] if others else []
    points = np.stack([take.markers[name] for name in seen], axis=1)
    pose, rms = tool_poses(points)
    remarks += require_rigid(points, seen, rms)
    return pose, rms, [f"tracker_cp was computed from the markers {', '.join(seen)}.", *remarks]


def _named(take: Take, options: MocapOptions) -> list[str]:
    """Markers that the user named, by themselves or by the body in their labels; else all that are labelled."""
    labelled = [name for name in take.markers if name not in take.others]
    if options.body is not None:
        groups = bodies_of(labelled)
        if options.body not in groups:
            bodies = [*take.bodies, *(body for body in groups if body)]
            held = f"Bodies here: {', '.join(bodies)}." if bodies else "The recording holds markers only."
            raise LogError(f"there is no body {options.body}.", hint=held)
        return groups[options.body]
    missing = [name for name in options.markers or () if name not in take.markers]
    if missing:
        raise LogError(f"there is no marker {', '.join(missing)}.", hint=f"Markers here: {', '.join(take.markers)}.")
    return labelled if options.markers is None else list(options.markers)


def _one_tool(take: Take, names: list[str]) -> tuple[list[str], list[str]]:
    """Markers of the tool and the others: all where they are rigid, else those of the only body that gives a pose."""
    groups = bodies_of(names)
    whole = {body: markers for body, markers in groups.items() if len(markers) >= 3}
    if len(groups) == 1 or not whole or _is_rigid(take, names):
        return names, []
    if len(whole) > 1:
        listed = ", ".join(f"{body or 'no body'} ({len(markers)} markers)" for body, markers in whole.items())
        hint = f'Say which one is the tool in a mapping file: [mocap] body = "{next(iter(whole))}".'
        raise LogError(f"the markers' labels name {len(whole)} bodies: {listed}.", hint=hint)
    (tool,) = whole.values()
    return tool, [name for name in names if name not in tool]


def _is_rigid(take: Take, names: list[str]) -> bool:
    try:
        _, rms = tool_poses(np.stack([take.markers[name] for name in names], axis=1))
    except DataError:
        return False
    return typical_misfit(rms) <= RIGID
