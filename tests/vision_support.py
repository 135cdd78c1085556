"""Support of the vision tests: rendered cameras as the tracker knows them, boards before them, recordings on disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from board_pictures import Board

from gpcorrect.types import FloatArray
from gpcorrect.vision import Camera, Intrinsics, write_cameras
from gpcorrect.vision.opencv import cv2
from gpcorrect_studies.rendering import Card, Lens, Stage, random_motion

COVER = Card((0, 0, 640, 480))
Cards = Callable[[int], Mapping[int, Sequence[Card]]]


def intrinsics_of(lens: Lens) -> Intrinsics:
    """Return the rendered lens as the tracker's own kind."""
    K = np.array([[lens.focal[0], 0.0, lens.middle[0]], [0.0, lens.focal[1], lens.middle[1]], [0.0, 0.0, 1.0]])
    return Intrinsics(*lens.size, K, np.array(lens.distortion))


def place_of(lens: Lens) -> FloatArray:
    """Return T_camera_tracker of a rendered lens."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = lens.axes.T, -lens.axes.T @ lens.position
    return T


def cameras_of(stage: Stage) -> tuple[Camera, ...]:
    """Return the true calibration of a stage."""
    return tuple(Camera(f"cam{k}", intrinsics_of(lens), place_of(lens)) for k, lens in enumerate(stage.lenses))


def turned(rotvec: Sequence[float]) -> FloatArray:
    """Return a rotation matrix, by OpenCV."""
    matrix: FloatArray = cv2.Rodrigues(np.array(rotvec, dtype=np.float64))[0]
    return matrix


def board_before(lens: Lens, rng: np.random.Generator, *, square: float = 0.015) -> Board:
    """Return a chessboard of 9 x 6 inner corners that a lens sees whole, slanted by chance."""
    while True:
        away, pixel = rng.uniform(0.24, 0.4), rng.uniform([150, 120], [490, 360])
        middle = lens.position + lens.directions(*(np.array(float(p)) for p in pixel)) * away
        axes = lens.axes @ turned(rng.uniform(-0.6, 0.6, 3))
        x, y = axes[:, 0], axes[:, 1]
        board = Board(9, 6, square, middle - square * (4.0 * x + 2.5 * y), x, y)
        rim = lens.pixels(board.origin + square * np.array([a * x + b * y for a in (-2, 10) for b in (-2, 7)]))
        if (rim > 3).all() and (rim < np.array(lens.size) - 4).all():
            return board


def record(folder: Path, stage: Stage, poses: FloatArray, cards: Cards | None = None) -> list[Path]:
    """Photograph poses into a folder a camera, with the calibration file beside them; return the folders."""
    folders = [folder / f"view{k}" for k in range(len(stage.lenses))]
    for one in folders:
        one.mkdir(parents=True, exist_ok=True)
    for i, pose in enumerate(poses):
        for one, image in zip(folders, stage.frame(pose, cards(i) if cards else None), strict=True):
            cv2.imwrite(str(one / f"{i:04d}.png"), image)
    write_cameras(cameras_of(stage), folder / "cameras.json")
    return folders


def path_of(seed: int, count: int, rate_hz: float = 30.0) -> FloatArray:
    """Return poses of a tool that wanders smoothly."""
    return random_motion(count, rate_hz, np.random.default_rng(seed))
