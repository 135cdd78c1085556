"""What a motion capture export holds, whatever system wrote it, and which part of it is the tool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError, LogError
from gpcorrect.logs.columns import MocapOptions
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, LogMeta, PoseSignal

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

ROUNDS = 3  # of aligning and taking the median; the second changes the configuration by less than the noise
FLATNESS = 1e-3  # markers whose width is below this share of their length lie on a line


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

    Parameters
    ----------
    unit : str
        As an export writes it.

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

    Parameters
    ----------
    take : Take
        What was recorded.
    options : MocapOptions
        Which body or markers the user chose.

    Raises
    ------
    LogError
        There is no such body or marker, several bodies and none was chosen, or nothing at all.
    DataError
        The markers do not give a pose.
    """
    if options.markers is None and (take.bodies or options.body is not None):
        pose, rms, remark = _from_body(take, options.body)
    else:
        pose, rms, remark = _from_markers(take, options.markers)
    zeros = np.zeros(len(take.time), np.int64)
    return CalibrationLog(
        take.time,
        zeros,
        zeros,
        tracker_cp=pose,
        extra={} if rms is None else {"marker_rms": rms},
        meta=LogMeta(tracker=take.tracker),
        remarks=(remark, *take.remarks),
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


def tool_poses(points: FloatArray) -> tuple[PoseSignal, FloatArray]:
    """Pose of a body from its markers; a single marker gives positions only.

    The body's origin is the markers' centroid; its axes are the tracker's in the first frame that shows all.

    Parameters
    ----------
    points : (n, m, 3) array
        Markers over time, m; NaN where one is hidden.

    Returns
    -------
    PoseSignal
        NaN where fewer than three markers are seen, or those seen lie on a line.
    (n,) array
        Root mean square distance of the markers from the fitted body, m; zero for a single marker.

    Raises
    ------
    DataError
        There are two markers, or no frame shows all of them.
    DegenerateError
        The markers lie on a line.
    """
    count = points.shape[1]
    if count == 1:
        position = points[:, 0]
        return PoseSignal(position), np.where(np.isfinite(position).all(axis=1), 0.0, np.nan)
    if count == 2:
        raise DataError("two markers give no orientation.", hint="Name one marker, or three and more.")
    body = configuration(points)
    T = _fit_body(points, body)
    seen = np.isfinite(T).all(axis=(1, 2))
    position, quaternion = np.full((len(points), 3), np.nan), np.full((len(points), 4), np.nan)
    position[seen], quaternion[seen] = se3.to_parts(T[seen])
    placed = body @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    square = ((points - placed) ** 2).sum(axis=2)
    visible = np.isfinite(square)
    total = np.where(visible, square, 0.0).sum(axis=1) / np.maximum(visible.sum(axis=1), 1)
    return PoseSignal(position, quaternion), np.where(seen, np.sqrt(total), np.nan)


def configuration(points: FloatArray) -> FloatArray:
    """Markers in the body's own frame `(m, 3)`: the median over all complete frames, aligned to each other.

    Parameters
    ----------
    points : (n, m, 3) array
        Markers over time, m; NaN where one is hidden.

    Raises
    ------
    DataError
        No frame shows all markers.
    DegenerateError
        The markers lie on a line.
    """
    complete = points[np.isfinite(points).all(axis=(1, 2))]
    if not len(complete):
        share = np.isfinite(points).all(axis=2).mean(axis=0)
        shown = ", ".join(f"{s:.0%}" for s in share)
        raise DataError(f"no frame shows all markers; they are seen in {shown} of the frames.")
    body: FloatArray = complete[0] - complete[0].mean(axis=0)
    for _ in range(ROUNDS):
        if not _spans_plane(body[None])[0]:
            raise DegenerateError("the markers lie on a line and give no orientation.")
        T_body_tracker = se3.invert(_fit_body(complete, body))
        aligned = complete @ np.swapaxes(T_body_tracker[:, :3, :3], 1, 2) + T_body_tracker[:, None, :3, 3]
        body = np.median(aligned, axis=0)
        body = body - body.mean(axis=0)
    return body


def _fit_body(points: FloatArray, body: FloatArray) -> FloatArray:
    """Poses `(n, 4, 4)` that best map a body's markers `(m, 3)` onto those seen `(n, m, 3)` (Kabsch 1976)."""
    seen = np.asarray(np.isfinite(points).all(axis=2))
    T = np.full((len(points), 4, 4), np.nan)
    enough = seen.sum(axis=1) >= 3
    enough[enough] = _spans_plane(np.where(seen[enough, :, None], body, np.nan))
    weight = seen[enough, :, None] / seen[enough].sum(axis=1)[:, None, None]
    observed = np.where(seen[enough, :, None], points[enough], 0.0)
    centre_seen, centre_body = (observed * weight).sum(axis=1), (body * weight).sum(axis=1)
    spread = np.swapaxes((observed - centre_seen[:, None]) * weight, 1, 2) @ (body - centre_body[:, None])
    rotation = se3.nearest_rotation(spread)
    T[enough] = se3.pose(rotation, centre_seen - (rotation @ centre_body[:, :, None])[..., 0])
    return T


def _spans_plane(bodies: FloatArray) -> BoolArray:
    """Whether the markers present in each body `(n, m, 3)` lie on more than a line."""
    centred = bodies - np.nanmean(bodies, axis=1, keepdims=True)
    size = np.linalg.svd(np.nan_to_num(centred), compute_uv=False)
    return np.asarray(size[:, 1] > FLATNESS * size[:, 0])
