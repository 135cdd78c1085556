"""Markers in a calibration picture: dots or small balls, free or on posts, of a colour and size that nobody said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.errors import DegenerateError
from gpcorrect.types import FloatArray, IntArray
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.place import Placement, refine_pose
from gpcorrect.vision.rim import outline
from gpcorrect.vision.settings import DEFAULT

SETTINGS = DEFAULT.calibration
# Width of the wider Gaussian over the narrower one: their difference is nearly the Laplacian (Marr, Hildreth 1980).
WIDER = 1.6
MARKER_NOISE_PX = 0.2  # what rims of dots leave: nothing is to be gained below
DISC = 1.75  # radius of a disc over the narrower Gaussian at which it answers most: sqrt(2) x sqrt(1.6)


@dataclass(frozen=True, eq=False)
class Blobs:
    """Compact patches that stand out of their surroundings."""

    pixels: FloatArray  # (n, 2) middles, to about a pixel; the strongest first
    radii: FloatArray  # (n,) px
    answers: FloatArray  # (n,) how much they stand out, grey levels of a difference of Gaussians
    kinds: FloatArray  # (n,) lighter, darker, redder, greener, yellower or bluer than what is around them: 0 to 5


def find_blobs(image: Image) -> Blobs:
    """Find dots of any colour and size in a whole picture; a dot at the end or in the middle of a post is one too.

    Peaks of differences of Gaussians over scales, in lightness and both colour axes, ridges left out.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
    """
    lab = cv2.cvtColor(image.astype(np.float32) / 255.0, cv2.COLOR_BGR2Lab) * np.array(
        [2.55, 1.0, 1.0], dtype=np.float32
    )
    found: list[list[FloatArray]] = [[] for _ in range(6)]
    for radius in SETTINGS.marker_radii_px:
        narrow = radius / DISC
        difference = cv2.GaussianBlur(lab, (0, 0), narrow) - cv2.GaussianBlur(lab, (0, 0), WIDER * narrow)
        for kind, answer in enumerate(signed for plane in cv2.split(difference) for signed in (plane, -plane)):
            peak = (answer == cv2.dilate(answer, np.ones((3, 3)))) & (answer > SETTINGS.marker_answer)
            v, u = (index.astype(np.int64) for index in np.nonzero(peak[2:-2, 2:-2]))
            peaks = _round(answer, u + 2, v + 2)
            found[kind].append(np.column_stack([peaks, np.full((len(peaks), 2), [radius, kind])]))
    table = np.vstack([_distinct(np.vstack(rows)) for rows in found])
    return Blobs(table[:, :2], table[:, 3], table[:, 2], table[:, 4])


def _distinct(rows: FloatArray) -> FloatArray:
    """Strongest of the peaks `(n, 5)` (u, v, answer, radius, kind) that are one blob at several scales."""
    rows = rows[np.argsort(-rows[:, 2])]
    found = np.zeros((0, 5))
    for row in rows:
        if len(found) == SETTINGS.marker_blobs:
            break
        if (np.hypot(*(found[:, :2] - row[:2]).T) > 0.5 * found[:, 3]).all():
            found = np.vstack([found, row])
    return found


def _round(answer: Image, u: IntArray, v: IntArray) -> FloatArray:
    """Peaks `(n, 3)` (u, v, answer) that fall off to all sides, to a fraction of a pixel."""
    at = answer[v, u]
    left, right, up, down = answer[v, u - 1], answer[v, u + 1], answer[v - 1, u], answer[v + 1, u]
    xx, yy = 2.0 * at - left - right, 2.0 * at - up - down
    xy = 0.25 * (answer[v + 1, u - 1] + answer[v - 1, u + 1] - answer[v + 1, u + 1] - answer[v - 1, u - 1])
    trace, root = xx + yy, np.sqrt((xx - yy) ** 2 + 4.0 * xy**2)
    good = (trace - root) > SETTINGS.marker_roundness * (trace + root)
    x = u + 0.5 * (right - left) / np.maximum(xx, 1e-6)
    y = v + 0.5 * (down - up) / np.maximum(yy, 1e-6)
    return np.asarray(np.stack([x, y, at], axis=1)[good], dtype=np.float64)


def _match_blobs(
    blobs: Blobs, markers: Mapping[str, FloatArray], camera: Camera, reach_px: float, near_px: float
) -> list[dict[str, int]]:
    """Say what may be the blobs of the markers, the likeliest first: of one kind, at one offset from their places.

    Markers `(3,)` are expected where the camera would see them; no offset is greater than `reach_px`, and no marker
    farther than `near_px` from the offset of all.
    """
    seen = zip(markers, camera.project(np.array(list(markers.values()))), strict=True)
    places = {name: pixel for name, pixel in seen if np.isfinite(pixel).all()}
    trials: list[tuple[float, FloatArray, dict[str, int]]] = []
    for kind in np.unique(blobs.kinds) if places else ():
        own = np.flatnonzero(blobs.kinds == kind)
        offsets = blobs.pixels[own][None] - np.array(list(places.values()))[:, None]
        strength = np.minimum(blobs.answers[own] / SETTINGS.marker_strong, 1.0)
        for offset in offsets[np.linalg.norm(offsets, axis=2) <= reach_px]:
            worth = np.maximum(1.0 - np.linalg.norm(offsets - offset, axis=2) / near_px, 0.0) * strength
            names = {n: int(own[np.argmax(row)]) for n, row in zip(places, worth, strict=True) if row.max() > 0.0}
            trials.append((float(worth.max(axis=1).sum()), np.array([*offset, 1e3 * kind]), names))
    trials.sort(key=lambda trial: -trial[0])
    chosen: list[tuple[float, FloatArray, dict[str, int]]] = []
    for trial in trials:
        apart = all(np.linalg.norm(trial[1] - other[1]) > 0.5 * near_px for other in chosen)
        if len(chosen) < SETTINGS.marker_trials and apart:
            chosen.append(trial)
    return [names for _, _, names in chosen]


def found_from(
    image: Image, blobs: Blobs, markers: Mapping[str, FloatArray], camera: Camera
) -> tuple[Placement, dict[str, FloatArray]] | None:
    """Find the markers and refine the camera's pose in turns, from every likely beginning; None when too few agree.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
    blobs : Blobs, of the picture
    markers : mapping of marker to (3,) array, places in the tracker frame, m
    camera : Camera, where it stands roughly
    """
    first, *rounds = SETTINGS.marker_near_px
    best: tuple[Placement, dict[str, FloatArray]] | None = None
    for matched in _match_blobs(blobs, markers, camera, SETTINGS.marker_reach_px, first):
        found = _refined_from(image, blobs, matched, markers, camera)
        for near in rounds:
            if found is not None:
                placed = replace(camera, T_camera_tracker=found[0].T_camera_tracker)
                again = _match_blobs(blobs, markers, placed, near, near)
                found = _refined_from(image, blobs, again[0], markers, placed) if again else None
        if found is not None and (best is None or _markers_agree(found[0]) > _markers_agree(best[0])):
            best = found
    return best if best is not None and best[0].rms_px < SETTINGS.marker_rms_px else None


def _markers_agree(placed: Placement) -> float:
    """How well markers agree on a place: how many do, over what they are off by; tops of posts agree too, but less."""
    return float(placed.used.sum()) / (MARKER_NOISE_PX + placed.rms_px)


def _refined_from(
    image: Image, blobs: Blobs, matched: Mapping[str, int], markers: Mapping[str, FloatArray], camera: Camera
) -> tuple[Placement, dict[str, FloatArray]] | None:
    """Middles of markers, from the part of their rim that no post hides, and the pose that follows from them."""
    found = {}
    for name, k in matched.items():
        pixel, radius = blobs.pixels[k], blobs.radii[k]
        rim = outline(image, np.array([*pixel, radius]), camera.intrinsics)
        if rim is not None and np.linalg.norm(rim.pixel - pixel) < SETTINGS.marker_shift * radius + 1.0:
            found[name] = rim.pixel
    if len(found) < SETTINGS.fewest_points:
        return None
    known, pixels = np.array([markers[name] for name in found]), np.array(list(found.values()))
    try:
        return refine_pose(known, pixels, camera.intrinsics, [camera.T_camera_tracker]), found
    except DegenerateError:
        return None
