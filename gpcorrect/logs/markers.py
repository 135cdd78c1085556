"""A tool's pose from the markers on it: rigid fit of each frame to the markers' median configuration."""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import BoolArray, FloatArray, PoseSignal

__all__ = ["configuration", "fit_body", "tool_poses"]

ROUNDS = 3  # of aligning and taking the median; the second changes the configuration by less than the noise
FLATNESS = 1e-3  # markers whose width is below this share of their length lie on a line


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
    T = fit_body(points, body)
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
        T_body_tracker = se3.invert(fit_body(complete, body))
        aligned = complete @ np.swapaxes(T_body_tracker[:, :3, :3], 1, 2) + T_body_tracker[:, None, :3, 3]
        body = np.median(aligned, axis=0)
        body = body - body.mean(axis=0)
    return body


def fit_body(points: FloatArray, body: FloatArray) -> FloatArray:
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
