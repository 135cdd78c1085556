"""Cameras and tracker on rendered sequences: accuracy beside the targets, under bad conditions, and frames a second.

    python bench/vision_track.py [--seeds 3] [--frames 90] [--only conditions|speed]

The fixture is that of Peng et al. 2020: balls of 20 mm radius, 38 mm from the middle.

Pictures come from `gpcorrect_studies.rendering`, which shares no maths with the tracker. Speed is by the clock: of
pictures in memory, after the first search; of pictures that a second thread reads from files, with it; and with the
first look, which searches seven frames and tracks the first 45 twice. On a busy machine look at the frames a second of
processor time: how many one core of its own would do.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from support import print_table, save_results

from gpcorrect import se3
from gpcorrect.types import FloatArray
from gpcorrect.vision import (
    END_EFFECTOR,
    Camera,
    Intrinsics,
    Target,
    Tracker,
    TrackSettings,
    mean_midpoint,
    open_source,
    pose_closed_form,
    track,
)
from gpcorrect.vision import single_ball as one_ball
from gpcorrect.vision.opencv import cv2
from gpcorrect_studies.peng2020 import calibrated_cameras
from gpcorrect_studies.rendering import Ball, Card, Lens, Light, Stage, Studio, random_motion, single_ball

RATE = 30.0
COVER = Card((0, 0, 640, 480))
RADIUS = 0.020  # m
COLOURS = {"green": (40.0, 160.0, 60.0), "yellow": (225.0, 200.0, 40.0), "red": (200.0, 35.0, 35.0)}  # in full light
CHI2_3 = 7.815  # 95 % of squared normalised errors of a position lie below it
FINE = 1000.0  # poses a second of a path from which cameras take theirs at moments of their own
OUT_OF_STEP = 0.030  # s, greatest difference between two cameras
READOUT = 0.025  # s, of rolling shutters
Cards = Mapping[int, Mapping[int, Sequence[Card]]]


def true_cameras(lenses: Sequence[Lens]) -> list[Camera]:
    """Return the rendered cameras as if calibrated without error."""
    cameras = []
    for k, lens in enumerate(lenses):
        K = np.array([[lens.focal[0], 0, lens.middle[0]], [0, lens.focal[1], lens.middle[1]], [0, 0, 1.0]])
        T = se3.invert(se3.pose(lens.axes, lens.position))
        cameras.append(Camera(f"cam{k}", Intrinsics(*lens.size, K, np.array(lens.distortion)), T))
    return cameras


def run(stage: Stage, cameras: Sequence[Camera], target: Target, poses: FloatArray, cards: Cards) -> dict[str, Any]:
    """Track a rendered sequence; errors in mm and degrees of measured frames, and the tracker's own time."""
    away, turn, spent, paper, midpoints = [], [], 0.0, [], []
    with Tracker(cameras, target) as tracker:
        for i, pose in enumerate(poses):
            images = stage.frame(pose, cards.get(i))
            begun = time.perf_counter()
            frame = tracker.step(images, i / RATE)
            spent += time.perf_counter() - begun
            if frame.pose.status != "measured":
                continue
            T = frame.pose.T_tracker_tool
            away.append(1e3 * float(np.linalg.norm(T[:3, 3] - pose[:3, 3])))
            turn += [np.rad2deg(float(se3.angle(T[:3, :3] @ pose[:3, :3].T)))] if target.has_pose else []
            points = midpoint_balls(frame.views, cameras)
            midpoints.append(1e3 * np.linalg.norm(points - (target.places @ pose[:3, :3].T + pose[:3, 3]), axis=1))
            if target.has_pose and np.isfinite(points).all():
                found = pose_nelder_mead(points, target.places)
                closed = pose_closed_form(points, target.places).T_tracker_tool
                paper.append([1e3 * np.linalg.norm(X[:3, 3] - pose[:3, 3]) for X in (found, closed)])
    rms = [float(np.sqrt(np.mean(np.square(v)))) if len(v) else float("nan") for v in (away, turn)]
    return {
        "rms_mm": rms[0],
        "rms_deg": rms[1],
        "max_mm": max(away, default=float("nan")),
        "measured": len(away) / len(poses),
        "frames_a_second": len(poses) / spent,
        "ball_midpoint_rms_mm": float(np.sqrt(np.nanmean(np.square(midpoints)))),
        "nelder_mead_rms_mm": float(np.sqrt(np.mean(np.square([p[0] for p in paper])))) if paper else float("nan"),
        "closed_form_rms_mm": float(np.sqrt(np.mean(np.square([p[1] for p in paper])))) if paper else float("nan"),
    }


def pose_nelder_mead(points: FloatArray, places: FloatArray) -> FloatArray:
    """Return the pose that minimises the sum of distances between balls and where they should be (Peng 2020, Eq. 7).

    From the closed form: the paper begins at the frame that the balls span, and comes to the same place.
    """
    start = pose_closed_form(points, places).T_tracker_tool
    reach = float(np.linalg.norm(places - places.mean(axis=0), axis=1).mean())

    def moved(x: FloatArray) -> FloatArray:
        return se3.pose(se3.matrix_from_rotvec(x[3:]) @ start[:3, :3], start[:3, 3] + reach * x[:3])

    def cost(x: FloatArray) -> float:
        T = moved(x)
        return float(np.linalg.norm(places @ T[:3, :3].T + T[:3, 3] - points, axis=1).sum() / reach)

    simplex = np.vstack([np.zeros(6), 0.02 * np.eye(6)])
    options = {"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-10, "maxiter": 4000, "maxfev": 4000}
    return moved(minimize(cost, np.zeros(6), method="Nelder-Mead", options=options).x)


def midpoint_balls(views: Any, cameras: Sequence[Camera]) -> FloatArray:
    """Return the paper's own estimate of each ball: mean midpoint of common perpendiculars of the trusted views."""
    points = []
    for b in range(len(views[0])):
        seen = [(c, v[b].outline) for c, v in zip(cameras, views, strict=True) if v[b].effective and v[b].outline]
        if len(seen) < 2:
            points.append(np.full(3, np.nan))
            continue
        origins = np.array([camera.position for camera, _ in seen])
        rays = np.array([camera.directions(np.array([*o.ray, 1.0]))[0] for camera, o in seen])
        points.append(mean_midpoint(origins, rays))
    return np.array(points)


def accuracy(seeds: range, frames: int) -> dict[str, list[dict[str, Any]]]:
    """Every case, every seed."""
    rows: dict[str, list[dict[str, Any]]] = {}
    for seed in seeds:
        rng = np.random.default_rng([seed, 7])
        poses = random_motion(frames, RATE, rng)
        third = frames // 3
        hidden = {i: {seed % 4: [COVER]} for i in range(third, 2 * third)}
        flicker = {i: {1: [COVER]} for i in range(0, frames, 3)}
        standard = Stage.standard(seed, radius=RADIUS)
        calibrated, placed = calibrated_cameras(standard.lenses, rng)
        rows.setdefault("camera positions", []).append({"max_mm": max(placed)})
        harsh = Stage.standard(
            seed, light=Light((1.0, 0.0, 0.3), 0.2), noise=6.0, colourful=1.0, pieces=50, radius=RADIUS
        )
        ball = Stage(standard.lenses, standard.studios, single_ball("red"), RADIUS)
        true = true_cameras(standard.lenses)
        cases: list[tuple[str, Stage, Sequence[Camera], Target, Cards]] = [
            ("single ball", ball, calibrated, one_ball("red"), {}),
            ("end effector", standard, calibrated, END_EFFECTOR, {}),
            ("end effector, a camera hidden for a third", standard, calibrated, END_EFFECTOR, hidden),
            ("end effector, a camera hidden every third frame", standard, calibrated, END_EFFECTOR, flicker),
            ("end effector, calibration without error", standard, true, END_EFFECTOR, {}),
            ("end effector, side light, noise, colourful clutter", harsh, true_cameras(harsh.lenses), END_EFFECTOR, {}),
        ]
        for name, stage, cameras, target, cards in cases:
            rows.setdefault(name, []).append(run(stage, cameras, target, poses, cards))
    return rows


def conditions(seeds: range, frames: int) -> dict[str, dict[str, float]]:
    """Median and 95th percentile of the errors, coverage of 95 % ellipsoids, and the fraction lost, seeds pooled."""
    scenes, rows = [conditions_of(seed, frames) for seed in seeds], {}
    for name in scenes[0]:
        runs = [pictured(*scene[name], frames) for scene in scenes]
        rows[name] = summary(np.vstack([found for found, _ in runs]), statistics.median(rate for _, rate in runs))
        print(f"# {name}", *(f"{key} {value:.3f}" for key, value in rows[name].items()), flush=True)
    return rows


def conditions_of(seed: int, frames: int) -> dict[str, tuple[Stage, FloatArray, Sequence[float], float]]:
    """Stage, path (a pose a millisecond), delays of the cameras (s) and readout (s) of each condition."""
    rng = np.random.default_rng([seed, 8])
    path = random_motion(round((frames / RATE + 0.2) * FINE), FINE, rng)
    late, in_step = (0.0, *(rng.uniform(-0.5, 0.5, 3) * OUT_OF_STEP)), (0.0,) * 4
    clean = Stage.standard(seed, radius=RADIUS)
    dark = {name: tuple(0.5 * v for v in shade) for name, shade in COLOURS.items()}
    half = Stage.standard(seed, radius=RADIUS, colours=dark)
    half = replace(half, studios=tuple(Studio(s.lens, 0.5 * s.background, s.light, rng=s.rng) for s in half.studios))
    return {
        "as it should be": (clean, path, in_step, 0.0),
        "clutter of all colours": (Stage.standard(seed, radius=RADIUS, colourful=1.0, pieces=50), path, in_step, 0.0),
        "half light": (half, path, in_step, 0.0),
        "noise 12": (Stage.standard(seed, radius=RADIUS, noise=12.0), path, in_step, 0.0),
        "out of step by up to 30 ms": (clean, path, late, 0.0),
        "rolling shutter 25 ms": (clean, path, in_step, READOUT),
        "rolling shutter, out of step": (clean, path, late, READOUT),
    }


def pictured(
    stage: Stage, path: FloatArray, delays: Sequence[float], readout: float, frames: int
) -> tuple[FloatArray, float]:
    """Track cameras that look at their own moments: error (mm, degrees) and squared normalised error of each frame."""
    cameras = [replace(camera, readout=readout) for camera in true_cameras(stage.lenses)]
    rows, spent = np.full((frames, 3), np.nan), 0.0
    with Tracker(cameras, END_EFFECTOR) as tracker:
        for i in range(frames):
            t = 0.05 + i / RATE
            pairs = zip(stage.studios, delays, strict=True)
            images = [studio.photograph(rolled(stage, studio.lens, path, t + d, readout)) for studio, d in pairs]
            begun = time.perf_counter()
            frame = tracker.step(images, t)
            spent += time.perf_counter() - begun
            if frame.measured is not None:
                T, pose = frame.pose.T_tracker_tool, path[round(t * FINE)]
                off = T[:3, 3] - pose[:3, 3]
                turn = np.rad2deg(float(se3.angle(T[:3, :3] @ pose[:3, :3].T)))
                square = off @ np.linalg.solve(frame.measured.covariance[:3, :3], off)
                rows[i] = 1e3 * np.linalg.norm(off), turn, square
    return rows, frames / spent


def rolled(stage: Stage, lens: Lens, path: FloatArray, t: float, readout: float) -> list[Ball]:
    """Balls as a shutter sees them that reads the first row at `t` and the last one `readout` later."""
    seen = []
    for b, ball in enumerate(stage.balls(path[round(t * FINE)])):
        row = float(lens.pixels(ball.centre)[1])
        at = round((t + readout * row / lens.size[1]) * FINE)
        before, now, after = (stage.balls(path[k])[b].centre for k in (at - 1, at, at + 1))
        drift = (after - before) * 0.5 * FINE * readout / lens.size[1]
        seen.append(replace(ball, centre=now, row=row, drift=tuple(drift.tolist())))
    return seen


def summary(rows: FloatArray, rate: float) -> dict[str, float]:
    """Figures of pooled frames."""
    known = rows[np.isfinite(rows[:, 0])]
    middle, high = (np.percentile(known[:, :2], q, axis=0) for q in (50, 95))
    return {
        "median_mm": float(middle[0]),
        "p95_mm": float(high[0]),
        "median_deg": float(middle[1]),
        "p95_deg": float(high[1]),
        "coverage_percent": 100.0 * float(np.mean(known[:, 2] < CHI2_3)),
        "lost_percent": 100.0 * (1.0 - len(known) / len(rows)),
        "frames_a_second": rate,
    }


def speed(frames: int) -> dict[str, float]:
    """Frames a second with four 640 x 480 cameras: pictures in memory, and pictures read from files."""
    stage, poses = Stage.standard(3, radius=RADIUS), random_motion(frames, RATE, np.random.default_rng(3))
    pictures = [stage.frame(pose) for pose in poses]
    cameras, result = true_cameras(stage.lenses), {}
    with Tracker(cameras, END_EFFECTOR) as tracker:
        tracker.step(pictures[0], 0.0)
        begun, used = time.perf_counter(), time.process_time()
        for i, images in enumerate(pictures[1:], start=1):
            tracker.step(images, i / RATE)
        result["in memory"] = (frames - 1) / (time.perf_counter() - begun)
        result["  per second of processor time"] = (frames - 1) / (time.process_time() - used)
    with tempfile.TemporaryDirectory() as folder:
        sources = [Path(folder) / f"c{k}" for k in range(len(cameras))]
        for k, source in enumerate(sources):
            source.mkdir()
            for i, images in enumerate(pictures):
                cv2.imwrite(str(source / f"{i:05d}.jpg"), images[k], [cv2.IMWRITE_JPEG_QUALITY, 95])
        for name, first_look in (("from JPEG files, with the first search", False), ("  with the first look", True)):
            settings = TrackSettings(first_look=first_look)
            done = track([open_source(source) for source in sources], cameras, END_EFFECTOR, settings)
            result[name] = done.frames_a_second
    return result


def print_speed(frames: int) -> dict[str, float]:
    """Print and return the frames a second."""
    rates = speed(frames)
    print_table(["four cameras, 640 x 480 (target 30)", "frames/s"], [[name, value] for name, value in rates.items()])
    return rates


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--frames", type=int, default=90)
    parser.add_argument("--only", choices=["conditions", "speed"], help="print this table alone")
    asked = parser.parse_args()
    cv2.setNumThreads(1)
    if asked.only == "speed":
        save_results("vision_speed", print_speed(2 * asked.frames))
        return
    harsh = conditions(range(900, 900 + asked.seeds), asked.frames)
    head = ["true calibration, seeds pooled", "median mm", "p95 mm", "median deg", "p95 deg", "coverage %", "lost %"]
    print_table([*head, "frames/s"], [[name, *row.values()] for name, row in harsh.items()])
    print(flush=True)
    if asked.only == "conditions":
        save_results("vision_conditions", harsh)
        return
    rows = accuracy(range(900, 900 + asked.seeds), asked.frames)
    targets = {"single ball": "0.99", "end effector": "0.53 / 0.3"}
    placed = max(row["max_mm"] for row in rows.pop("camera positions"))
    print(f"camera positions: within {placed:.2f} mm (target 0.5)\n")
    table = []
    for name, runs in rows.items():
        keys = ("rms_mm", "rms_deg", "max_mm", "measured", "ball_midpoint_rms_mm", "nelder_mead_rms_mm")
        keys += ("closed_form_rms_mm", "frames_a_second")
        table.append(
            [name, targets.get(name.split(",")[0], "-"), *(statistics.median(r[k] for r in runs) for k in keys)]
        )
    head = ["median of seeds", "target", "RMS mm", "RMS deg", "max mm", "measured", "balls, midpoint", "Nelder-Mead"]
    print_table([*head, "closed form", "frames/s"], table)
    print()
    frames = print_speed(2 * asked.frames)
    save_results("vision_track", {"conditions": harsh, "accuracy": rows, "cameras_max_mm": placed, "speed": frames})


if __name__ == "__main__":
    main()
