"""Pictures of balls before clutter by ray casting, for testing cameras that must not be trusted with their own maths.

Independent of `gpcorrect.vision` on purpose: own lens model, own inversion of the distortion, NumPy and SciPy only. It
is installed, and no part of the tests, because `gpcorrect reproduce peng2020` draws all its pictures with it.
"""

from gpcorrect_studies.rendering.picture import Ball, Card, Lens, Light, Studio, backdrop, looking_at
from gpcorrect_studies.rendering.stage import Stage, four_cameras, marker_points, random_motion, single_ball

__all__ = [
    "Ball",
    "Card",
    "Lens",
    "Light",
    "Stage",
    "Studio",
    "backdrop",
    "four_cameras",
    "looking_at",
    "marker_points",
    "random_motion",
    "single_ball",
]
