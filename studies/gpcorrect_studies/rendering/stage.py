"""Four webcams around a workspace, the tool with three balls, and how it wanders: the stage of Peng et al. 2020."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect.types import FloatArray
from gpcorrect_studies.rendering.picture import Ball, Card, Lens, Light, Studio, backdrop, looking_at

WORKSPACE = np.array([0.0, 0.0, 0.2])  # m, world frame
ARM = 0.038  # m from the holder's centre to each ball's (the fixture of Peng et al. 2020)
RADIUS = 0.0095  # m; chosen by hand, smaller than the fixture's 20 mm: fewer pixels to find
COLOURS: dict[str, tuple[float, float, float]] = {
    "green": (40.0, 160.0, 60.0),
    "yellow": (225.0, 200.0, 40.0),
    "red": (200.0, 35.0, 35.0),
}
END_EFFECTOR_BALLS: dict[str, tuple[float, float, float]] = {
    "green": (0.0, -ARM, 0.0),
    "yellow": (ARM, 0.0, 0.0),
    "red": (0.0, ARM, 0.0),
}


def single_ball(name: str = "red") -> dict[str, tuple[float, float, float]]:
    """Return a target of one ball at its own origin.

    Parameters
    ----------
    name : str, its colour
    """
    return {name: (0.0, 0.0, 0.0)}


def four_cameras(rng: np.random.Generator) -> tuple[Lens, ...]:
    """Return four webcams at the corners of a table, each a little different from the next.

    Parameters
    ----------
    rng : numpy.random.Generator, of the differences
    """
    size, lenses = (640, 480), []
    for k in range(4):
        bearing = np.pi / 4 + k * np.pi / 2 + rng.uniform(-0.1, 0.1)
        away = rng.uniform(0.36, 0.42)
        position = np.array([away * np.cos(bearing), away * np.sin(bearing), rng.uniform(0.38, 0.46)])
        focal = size[0] * rng.uniform(0.92, 1.0)
        lenses.append(
            Lens(
                position,
                looking_at(position, WORKSPACE + rng.uniform(-0.02, 0.02, 3), rng.uniform(-0.05, 0.05)),
                (focal, focal * rng.uniform(0.998, 1.002)),
                (size[0] / 2 + rng.uniform(-6, 6), size[1] / 2 + rng.uniform(-6, 6)),
                (rng.uniform(-0.12, 0.05), rng.uniform(-0.05, 0.1), *rng.uniform(-1e-3, 1e-3, 2).tolist(), 0.0),
                size,
            )
        )
    return tuple(lenses)


def marker_points() -> FloatArray:
    """Sixteen known places `(16, 3)` around the workspace, m: eight posts, two marks each, alike from no two sides."""
    outer = [(0.11, -0.10, 0.12), (0.12, 0.11, 0.14), (-0.10, 0.12, 0.11), (-0.11, -0.12, 0.13)]
    inner = [(0.075, 0.01, 0.15), (-0.01, 0.08, 0.16), (-0.07, 0.0, 0.14), (0.01, -0.085, 0.17)]
    heights = ((0.0, 0.13), (0.0, 0.08))
    posts = zip((outer, inner), heights, strict=True)
    return np.array([(x, y, z + up) for group, ups in posts for x, y, z in group for up in ups])


def random_motion(count: int, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """Smooth poses `(count, 4, 4)` of the tool, world from tool, within 40 mm and 0.4 rad of the workspace's middle, m.

    Parameters
    ----------
    count : int
    rate_hz : float, poses a second
    rng : numpy.random.Generator, of rates and phases
    """
    t = np.arange(count) / rate_hz
    rates, phases = rng.uniform(0.4, 1.6, (6, 2)), rng.uniform(0, 2 * np.pi, (6, 2))
    swing = np.sin(rates[:, None, :] * t[None, :, None] + phases[:, None, :]).mean(axis=2).T
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = WORKSPACE + 0.04 * swing[:, :3]
    poses[:, :3, :3] = Rotation.from_rotvec(0.4 * swing[:, 3:]).as_matrix()
    return poses


@dataclass(eq=False)
class Stage:
    """Cameras, their backgrounds, and the balls of a target."""

    lenses: tuple[Lens, ...]
    studios: tuple[Studio, ...]  # one a camera
    places: Mapping[str, Sequence[float]]  # balls by name, in the tool frame, m
    radius: float = RADIUS  # of each ball, m
    colours: Mapping[str, tuple[float, float, float]] | None = None  # by name: red, green, blue

    @classmethod
    def standard(
        cls,
        seed: int,
        places: Mapping[str, Sequence[float]] | None = None,
        *,
        pieces: int = 25,
        colourful: float = 0.3,
        noise: float = 2.0,
        blur: float = 0.7,
        light: Light | None = None,
        radius: float = RADIUS,
        colours: Mapping[str, tuple[float, float, float]] | None = None,
    ) -> Stage:
        """Return four cameras before clutter; everything random comes from the seed.

        Parameters
        ----------
        seed : int
        places, radius, colours : as of the class; the end effector's balls by default
        pieces, colourful : as of :func:`backdrop`
        noise, blur, light : as of :class:`Studio`
        """
        rng = np.random.default_rng(seed)
        lenses = four_cameras(rng)
        studios = tuple(
            Studio(
                lens,
                backdrop(lens.size, rng, pieces=pieces, colourful=colourful),
                light or Light(),
                blur,
                noise,
                np.random.default_rng([seed, k]),
            )
            for k, lens in enumerate(lenses)
        )
        return cls(lenses, studios, places or END_EFFECTOR_BALLS, radius, colours)

    def balls(self, T_world_tool: FloatArray) -> list[Ball]:
        """Balls of the target at a pose.

        Parameters
        ----------
        T_world_tool : (4, 4) array
        """
        R, t = T_world_tool[:3, :3], T_world_tool[:3, 3]
        shades = {**COLOURS, **(self.colours or {})}
        return [
            Ball(R @ np.asarray(place) + t, self.radius, shades[name.split("_")[0]])
            for name, place in self.places.items()
        ]

    def frame(
        self, T_world_tool: FloatArray, cards: Mapping[int, Sequence[Card]] | None = None
    ) -> list[np.ndarray[tuple[int, ...], np.dtype[np.uint8]]]:
        """Return the pictures of all cameras.

        Parameters
        ----------
        T_world_tool : (4, 4) array
        cards : mapping of camera number to sequence of Card, optional, that hide parts of some pictures
        """
        balls = self.balls(T_world_tool)
        return [studio.photograph(balls, (cards or {}).get(k, ())) for k, studio in enumerate(self.studios)]
