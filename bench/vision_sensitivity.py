"""What half and twice of every number in `gpcorrect/vision/settings.py` do to the tracker and to the calibration.

    python bench/vision_sensitivity.py [--frames 16] [--only gate rays]

Tracker: a rendered sequence with side light, noise and colourful clutter, in which a camera is hidden for a third of
the frames, all are for two, and the tool jumps once; then the same for a single ball. Calibration: four rendered
lenses, 12 boards, 16 markers, one of them gross. The settings `check` are left out: what they refuse is in the
tests. A row is printed where half or twice changes accuracy by more than 5 %, coverage by any frame, or processor time
by more than 15 %.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from support import print_table, save_results
from vision_track import COVER, RATE, true_cameras

from gpcorrect import se3
from gpcorrect.errors import GpCorrectError
from gpcorrect.types import FloatArray
from gpcorrect.vision import (
    END_EFFECTOR,
    Chessboard,
    Target,
    Tracker,
    VisionSettings,
    adjust,
    calibrate_lens,
    refine_pose,
)
from gpcorrect.vision import single_ball as one_ball
from gpcorrect.vision.opencv import cv2
from gpcorrect.vision.settings import CalibrationSettings
from gpcorrect_studies.rendering import (
    Light,
    Stage,
    four_cameras,
    looking_at,
    marker_points,
    random_motion,
    single_ball,
)

Pictures = Sequence[Sequence[Any]]
BOARD = Chessboard(9, 6, 0.015)


def recording(seed: int, frames: int, stage: Stage) -> tuple[Pictures, FloatArray]:
    """Return pictures and true poses, with what makes tracking hard in them."""
    poses = random_motion(frames, RATE, np.random.default_rng(seed))
    poses[frames // 2 :] = random_motion(frames, RATE, np.random.default_rng(seed + 1))[frames // 2 :]  # a jump
    third = range(frames // 3, 2 * frames // 3)
    hidden = {i: {2: [COVER]} for i in third} | {i: {k: [COVER] for k in range(4)} for i in (3, 4)}
    return [stage.frame(pose, hidden.get(i)) for i, pose in enumerate(poses)], poses


def tracked(
    stage: Stage, target: Target, pictures: Pictures, poses: FloatArray, settings: VisionSettings
) -> FloatArray:
    """Return RMS error of measured frames (mm), their fraction, and processor time a frame (ms)."""
    errors, used = [], time.process_time()
    with Tracker(true_cameras(stage.lenses), target, settings, workers=1) as tracker:
        for i, (images, pose) in enumerate(zip(pictures, poses, strict=True)):
            estimate = tracker.step(images, i / RATE).pose
            if estimate.status == "measured":
                errors.append(1e3 * np.linalg.norm(estimate.T_tracker_tool[:3, 3] - pose[:3, 3]))
    spent = 1e3 * (time.process_time() - used) / len(poses)
    return np.array([np.sqrt(np.mean(np.square(errors))) if errors else np.nan, len(errors) / len(poses), spent])


def calibrated(settings: CalibrationSettings) -> FloatArray:
    """Return the RMS error of four cameras' positions (mm), the fraction that was accepted, and time a camera (ms)."""
    rng, errors, used = np.random.default_rng(7), [], time.process_time()
    for lens in four_cameras(rng):
        corners = []
        while len(corners) < 12:
            axes = lens.axes @ se3.matrix_from_rotvec(rng.uniform(-0.6, 0.6, 3))
            points = lens.position + 0.3 * lens.axes[:, 2] + (BOARD.points - BOARD.points.mean(axis=0)) @ axes.T
            corners.append(lens.pixels(points) + 0.05 * rng.standard_normal((len(points), 2)))
        pixels = lens.pixels(marker_points()) + 0.05 * rng.standard_normal((16, 2))
        pixels[5] += 12.0
        start = se3.invert(se3.pose(looking_at(lens.position + 0.02, np.array([0.01, 0.0, 0.2])), lens.position + 0.02))
        try:
            found = calibrate_lens(corners, BOARD, lens.size, settings)
            placed = refine_pose(marker_points(), pixels, found.intrinsics, [start], settings)
            T = adjust(found, BOARD, marker_points(), pixels, placed, settings).placement.T_camera_tracker
        except GpCorrectError:
            continue
        errors.append(1e3 * np.linalg.norm(se3.invert(T)[:3, 3] - lens.position))
    spent = 1e3 * (time.process_time() - used) / 4
    return np.array([np.sqrt(np.mean(np.square(errors))) if errors else np.nan, len(errors) / 4, spent])


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or all of a tuple, times a factor; whole numbers stay whole and positive."""
    if isinstance(value, tuple):
        return tuple(scaled(v, factor) for v in value)
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


def changed(usual: Mapping[str, FloatArray], now: Mapping[str, FloatArray]) -> bool:
    """Whether accuracy, coverage or time differ by more than chance."""
    for name, (error, fraction, spent) in now.items():
        was = usual[name]
        if not abs(error - was[0]) <= 0.05 * was[0] or fraction != was[1] or abs(spent - was[2]) > 0.15 * was[2]:
            return True
    return False


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=16)
    parser.add_argument("--only", nargs="*", default=[])
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    light = {"light": Light((1.0, 0.0, 0.3), 0.2), "noise": 6.0, "colourful": 1.0, "pieces": 12}
    stages = {
        "end effector": (Stage.standard(31, **light), END_EFFECTOR),
        "ball": (Stage.standard(32, single_ball("red"), **light), one_ball("red")),
    }
    cases = {name: (stage, target, *recording(31, asked.frames, stage)) for name, (stage, target) in stages.items()}

    def measured(settings: VisionSettings) -> dict[str, FloatArray]:
        return {name: tracked(*case, settings) for name, case in cases.items()}

    usual = measured(VisionSettings())
    usual = measured(VisionSettings())  # the first run warms up
    usual_calibration = calibrated(VisionSettings().calibration)
    print({name: row.round(3).tolist() for name, row in {**usual, "calibration": usual_calibration}.items()}, "\n")
    rows, quiet = [], []
    for group in dataclasses.fields(VisionSettings):
        part = getattr(VisionSettings(), group.name)
        for number in dataclasses.fields(part) if group.name != "check" else ():
            name, value = number.name, getattr(part, number.name)
            if asked.only and name not in asked.only:
                continue
            results = []
            for factor in (0.5, 2.0):
                other = dataclasses.replace(part, **{name: scaled(value, factor)})
                settings = dataclasses.replace(VisionSettings(), **{group.name: other})
                if group.name == "calibration":
                    results.append(({"calibration": usual_calibration}, {"calibration": calibrated(other)}))
                else:
                    results.append((usual, measured(settings)))
            if any(changed(was, now) for was, now in results):
                cells = ["; ".join(" ".join(f"{v:.3g}" for v in row) for row in now.values()) for _, now in results]
                rows.append([f"{group.name}.{name}", str(value), *cells])
            else:
                quiet.append(f"{group.name}.{name}")
            print(".", end="", file=sys.stderr, flush=True)
    print_table(["number", "value", "half: RMS mm, fraction, ms a frame", "twice"], rows)
    print("\nhalf and twice change nothing here:", ", ".join(quiet))
    save_results("vision_sensitivity", {"rows": rows, "unchanged": quiet})


if __name__ == "__main__":
    main()
