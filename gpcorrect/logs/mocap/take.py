"""What a motion capture export holds, whatever system wrote it; which part of it is the tool, and the tool's pose."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError, LogError
from gpcorrect.logs.columns import MocapOptions
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, LogMeta, PoseSignal

METRES: Mapping[str, float] = {
    **dict.fromkeys(("m", "meters"), 1.0),
    **dict.fromkeys(("cm", "centimeters"), 1e-2),
    **dict.fromkeys(("mm", "millimeters"), 1e-3),
    **dict.fromkeys(("in", "inches"), 0.0254),
    **dict.fromkeys(("ft", "feet"), 0.3048),
}
ROUNDS = 3  # of aligning and taking the median; the second changes the configuration by less than the noise
FLATNESS = 1e-3  # markers whose width is below this fraction of their length lie on a line
FRAMES = 500  # that are looked at for the marker that moves most against the others

RIGID = 1e-3
"""m. Marker systems place a marker within some tenths of a millimetre, so the markers of a rigid tool fit each other
better than this; chosen by hand."""
NO_TOOL = 10e-3
"""m. Ten times that: the pose is then wrong by as much as what is to be learned. Markers on different links of an arm,
or taken from a person, are tens to hundreds of millimetres off."""
TYPICAL = 0.9  # of the frames: swapped and ghost markers in the others are left to cleaning


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
    remarks += _require_rigid(points, seen, rms)
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


def bodies_of(names: Sequence[str]) -> dict[str, list[str]]:
    """Group markers by the body in their labels, as marker systems write it: `arm:1`, `arm_1`, `arm - 1`, `arm1`.

    Parameters
    ----------
    names : sequence of str, labels of markers; those without a number belong to the body ""
    """
    groups: dict[str, list[str]] = {}
    for name in names:
        numbered = re.fullmatch(r"(.*?)[\s_.-]*\d+", name)
        body = name.rpartition(":")[0] if ":" in name else numbered[1] if numbered else ""
        groups.setdefault(body, []).append(name)
    return groups


def typical_misfit(rms: FloatArray) -> float:
    """Distance of the markers from a rigid body that nine frames in ten keep below, m; 0 where nothing was seen.

    Parameters
    ----------
    rms : (n,) array, root mean square distance in each frame, m; NaN where the body was not seen
    """
    seen = rms[np.isfinite(rms)]
    return float(np.quantile(seen, TYPICAL)) if seen.size else 0.0


def _require_rigid(points: FloatArray, names: Sequence[str], rms: FloatArray) -> list[str]:
    """Refuse markers (n, m, 3) that are no rigid tool, off by `rms` (n,) m; return a remark where they barely are."""
    misfit = typical_misfit(rms)
    if misfit <= RIGID:
        return []
    what = (
        f"the markers do not move as one rigid tool: in a tenth of the frames they are {1e3 * misfit:.3g} mm or more"
        f" off; {names[_least_rigid(points)]} moves most against the others."
    )
    if misfit > NO_TOOL:
        hint = f'Name those on the tool in a mapping file: [mocap] markers = ["{names[0]}", ...].'
        raise LogError(what, hint=hint)
    return [what]


def _least_rigid(points: FloatArray) -> int:
    """Marker whose distances to the others vary most, in the middle of its pairs."""
    some = points[:: max(1, len(points) // FRAMES)]
    distance = np.linalg.norm(some[:, :, None] - some[:, None], axis=3)
    count = points.shape[1]
    spread = np.full((count, count), np.nan)
    for i, j in zip(*np.triu_indices(count, 1), strict=True):
        known = distance[np.isfinite(distance[:, i, j]), i, j]
        if known.size:
            spread[i, j] = spread[j, i] = np.ptp(np.quantile(known, [1 - TYPICAL, TYPICAL]))
    middle = [float(np.median(row[np.isfinite(row)])) if np.isfinite(row).any() else 0.0 for row in spread]
    return int(np.argmax(middle))


def tool_poses(points: FloatArray) -> tuple[PoseSignal, FloatArray]:
    """Pose of a body from its markers; a single marker gives positions only.

    The body's origin is the markers' centroid; its axes are the tracker's in the first frame that shows all.

    Parameters
    ----------
    points : (n, m, 3) array, markers over time, m; NaN where one is hidden

    Returns
    -------
    PoseSignal
        NaN where fewer than three markers are seen, or those seen lie on a line.
    (n,) array
        Root mean square distance of the markers from the fitted body, m; zero for a single marker.
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
    placed = body @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    square = ((points - placed) ** 2).sum(axis=2)
    visible = np.isfinite(square)
    total = np.where(visible, square, 0.0).sum(axis=1) / np.maximum(visible.sum(axis=1), 1)
    return PoseSignal(*se3.to_parts(T)), np.where(seen, np.sqrt(total), np.nan)


def configuration(points: FloatArray) -> FloatArray:
    """Markers in the body's own frame `(m, 3)`: the median over all frames, aligned to each other.

    The first of the frames that show most markers begins; markers that it hides join as soon as they are seen beside
    three that are known.

    Parameters
    ----------
    points : (n, m, 3) array, markers over time, m; NaN where one is hidden
    """
    seen = np.asarray(np.isfinite(points).all(axis=2))
    shown = f"they are seen in {', '.join(f'{part:.0%}' for part in seen.mean(axis=0))} of the frames."
    first = int(np.argmax(seen.sum(axis=1)))
    if seen[first].sum() < 3:
        raise DataError(f"no frame shows three markers; {shown}")
    body: FloatArray = points[first] - points[first][seen[first]].mean(axis=0)
    known, rounds = seen[first], 0
    while rounds < ROUNDS:
        if not _spans_plane(body[None])[0]:
            raise DegenerateError("the markers lie on a line and give no orientation.")
        T_body_tracker = se3.invert(_fit_body(points, body))
        aligned = points @ np.swapaxes(T_body_tracker[:, :3, :3], 1, 2) + T_body_tracker[:, None, :3, 3]
        found = np.asarray(np.isfinite(aligned).all(axis=2).any(axis=0))
        body = np.full(body.shape, np.nan)
        body[found] = np.nanmedian(aligned[:, found], axis=0)
        body = body - body[found].mean(axis=0)
        rounds = 0 if found.sum() > known.sum() else rounds + 1
        known = found
    if not known.all():
        raise DataError(f"not every marker is seen beside three others; {shown}")
    return body


def _fit_body(points: FloatArray, body: FloatArray) -> FloatArray:
    """Poses `(n, 4, 4)` that best map a body's markers `(m, 3)` onto those seen `(n, m, 3)` (Kabsch 1976)."""
    known = np.asarray(np.isfinite(body).all(axis=1))
    seen = np.asarray(np.isfinite(points).all(axis=2)) & known
    body = np.where(known[:, None], body, 0.0)
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
