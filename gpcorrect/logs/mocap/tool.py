"""The tool that carries markers: which markers are one rigid body, and its pose in every frame."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError, LogError
from gpcorrect.types import BoolArray, FloatArray, PoseSignal

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


def require_rigid(points: FloatArray, names: Sequence[str], rms: FloatArray) -> list[str]:
    """Refuse markers that are no rigid tool; return a remark where they are barely one.

    Parameters
    ----------
    points : (n, m, 3) array, markers over time, m; NaN where one is hidden
    names : sequence of str
    rms : (n,) array, distance from the fitted body in each frame, m
    """
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
