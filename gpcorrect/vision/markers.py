"""Finds markers, dots or small balls at known places, near where a rough pose puts them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gpcorrect.types import FloatArray
from gpcorrect.vision.opencv import Image, cv2

__all__ = ["find_markers"]

REACH = 40.0  # px, or this share of the way to the next marker
SHARE = 0.45
LEAST_AREA, MOST_SHARE = 4, 0.4  # px; share of the window that a dot may fill
CONTRAST = 25.0  # grey levels


def find_markers(image: Image, expected: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the middles (px) of dots near where they are expected; a marker of which none is found is left out.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        The picture.
    expected : mapping of marker to (2,) array
        Where each should be, px, to within half the way to the next one.
    """
    names = [name for name, pixel in expected.items() if np.isfinite(pixel).all()]
    if not names:
        return {}
    places = np.array([expected[name] for name in names])
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float32)
    found = {}
    for i, name in enumerate(names):
        apart = np.linalg.norm(places - places[i], axis=1)
        apart[i] = np.inf
        reach = float(min(REACH, max(SHARE * float(apart.min()), 6.0)))
        middle = _dot(grey, places[i], reach)
        if middle is not None:
            found[name] = middle
    return found


def _dot(grey: FloatArray, place: FloatArray, reach: float) -> FloatArray | None:
    """Middle of the most compact patch that stands out of its surroundings, weighted by how much it does."""
    height, width = grey.shape
    left, top = (int(max(c - reach, 0)) for c in place)
    right, bottom = int(min(place[0] + reach + 1, width)), int(min(place[1] + reach + 1, height))
    if right - left < 5 or bottom - top < 5:
        return None
    part = grey[top:bottom, left:right]
    ground = float(np.median(part))
    best, best_score = None, 0.0
    for signed in (part - ground, ground - part):
        level = float(signed.max())
        if level < CONTRAST:
            continue
        count, labels, stats, middles = cv2.connectedComponentsWithStats((signed > 0.5 * level).astype(np.uint8))
        for k in range(1, count):
            area, box = float(stats[k, 4]), stats[k, :4]
            whole = box[0] > 0 and box[1] > 0 and box[0] + box[2] < part.shape[1] and box[1] + box[3] < part.shape[0]
            if not whole or not LEAST_AREA <= area <= MOST_SHARE * part.size:
                continue
            fill = area / float(np.pi / 4 * max(box[2], box[3]) ** 2)
            off = float(np.linalg.norm(middles[k] + np.array([left, top]) - place)) / reach
            score = level * min(fill, 1.0) * np.exp(-(off**2))
            if score > best_score:
                best, best_score = _weighted_middle(signed, labels == k), score
    return None if best is None else best + np.array([left, top])


def _weighted_middle(signed: FloatArray, patch: FloatArray) -> FloatArray:
    """Centre of gravity of the patch and its soft border."""
    around = cv2.dilate(patch.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)
    level = float(signed[patch].mean())
    weight = np.where(around, np.clip(signed, 0.0, level), 0.0)
    v, u = np.nonzero(weight)
    w = weight[v, u]
    return np.array([float(u @ w), float(v @ w)]) / float(w.sum())
