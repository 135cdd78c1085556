"""Peng et al. 2020: ground truth from four webcams on rendered pictures, and a position estimator learned from it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration import (
    Experiment,
    FitSettings,
    PositionEstimator,
    RobotState,
    position_reductions,
    run_experiment,
)
from gpcorrect.sim import Noise, preset, random_reaches_log
from gpcorrect.types import CalibrationLog, FloatArray, Progress
from gpcorrect_studies.published import PENG_2020, PENG_2020_MISSING
from gpcorrect_studies.rendering import Card, Lens, Stage, looking_at, marker_points, random_motion
from gpcorrect_studies.rendering import single_ball as one_ball

if TYPE_CHECKING:  # OpenCV is an extra: other studies are done again without it
    from gpcorrect.vision import Camera, Target

__all__ = ["Peng2020Scope", "calibrated_cameras", "reproduce_peng2020"]

RATE_HZ = 30.0  # that of a common webcam
COVER = Card((0, 0, 640, 480))  # hides a whole picture
CORNER_NOISE_PX = MARKER_NOISE_PX = 0.05  # SD; chosen by hand
BOARDS, SQUARE = 20, 0.015  # pictures of the board, and the side of its squares, m; chosen by hand
STREAM_SAMPLES = 2000  # over which one estimate is timed; chosen by hand


METHODS = ("linear", "network", "gp")


@dataclass(frozen=True)
class Peng2020Scope:
    """How much to do.

    Parameters
    ----------
    frames : int
        Of each rendered sequence.
    reaches : int
        Of the simulated robot; the last fifth is held out, whole.
    layers : tuple of int
        Of the network.
    epochs : int
        Of the network.
    inducing : int
        Points of the Gaussian process.
    """

    frames: int = 120
    reaches: int = 150
    layers: tuple[int, ...] = (600, 500, 400)
    epochs: int = 60
    inducing: int = 400

    @classmethod
    def quick(cls) -> Peng2020Scope:
        """Return a small study: every part, rough figures."""
        return cls(10, 40, (60, 50, 40), 30, 120)


def reproduce_peng2020(scope: Peng2020Scope, seed: int = 0, progress: Progress | None = None) -> dict[str, Any]:
    """Do both halves of the study again: the cameras' accuracy, and what an estimator makes of their labels.

    Parameters
    ----------
    scope : Peng2020Scope
        How much is done.
    seed : int
        Of scene, motion and noise.
    progress : Progress, optional
        Receives how far each part is.

    Returns
    -------
    dict
        `table1` (single ball, end effector, and the latter with a camera hidden a third of the time: RMS and SD an
        axis, mm, and rotation, deg), `cameras_mm` (errors of their positions, mm), `estimator` (a method a row),
        `published`, `missing` and `seconds`.
    """
    begun, progress = time.perf_counter(), progress or Progress()
    table, placed = _table1(scope, seed, progress)
    log = _recording(scope, seed, table["end effector"]["rms_mm"])
    estimators = {}
    for k, method in enumerate(METHODS):
        progress.step("estimators", k / len(METHODS))
        settings = FitSettings(
            method=method, layers=scope.layers, epochs=scope.epochs, inducing=scope.inducing, seed=seed
        )
        experiment = run_experiment(log, settings, task=PositionEstimator)
        estimators[method] = {
            **experiment.to_dict(),
            **position_reductions(experiment.evaluation),
            "microseconds_a_sample": _microseconds(experiment, log),
        }
    progress.step("estimators", 1.0)
    return {
        "table1": table,
        "cameras_mm": placed,
        "estimator": estimators,
        "published": PENG_2020,
        "missing": PENG_2020_MISSING,
        "seconds": time.perf_counter() - begun,
    }


def _table1(scope: Peng2020Scope, seed: int, progress: Progress) -> tuple[dict[str, Any], list[float]]:
    from gpcorrect.vision import END_EFFECTOR, single_ball

    rng = np.random.default_rng([seed, 20])
    whole = Stage.standard(seed)
    cameras, placed = calibrated_cameras(whole.lenses, rng)
    poses = random_motion(scope.frames, RATE_HZ, rng)
    ball = Stage(whole.lenses, whole.studios, one_ball("red"))
    third = scope.frames // 3
    hidden = {i: {1: [COVER]} for i in range(third, 2 * third)}
    cases: list[tuple[str, Stage, Target, Mapping[int, Mapping[int, Sequence[Card]]]]] = [
        ("single ball", ball, single_ball("red"), {}),
        ("end effector", whole, END_EFFECTOR, {}),
        ("end effector, a camera hidden", whole, END_EFFECTOR, hidden),
    ]
    table = {}
    for k, (name, stage, target, cards) in enumerate(cases):
        progress.step("pictures", k / len(cases))
        table[name] = _tracked(stage, cameras, target, poses, cards)
    progress.step("pictures", 1.0)
    return table, placed


def calibrated_cameras(lenses: Sequence[Lens], rng: np.random.Generator) -> tuple[list[Camera], list[float]]:
    """Calibrate rendered cameras as a user would.

    Parameters
    ----------
    lenses : sequence of Lens
        The true cameras.
    rng : numpy.random.Generator
        Of boards and noise.

    Returns
    -------
    list of Camera
        As calibrated.
    list of float
        Distance of each from where it truly is, mm.
    """
    cameras = [_calibrated(f"cam{k}", lens, rng) for k, lens in enumerate(lenses)]
    misses = [float(np.linalg.norm(c.position - x.position)) for c, x in zip(cameras, lenses, strict=True)]
    return cameras, [1e3 * miss for miss in misses]


def _calibrated(name: str, lens: Lens, rng: np.random.Generator) -> Camera:
    """Calibrate from boards for the intrinsics and sixteen markers for the pose, all seen with a little noise."""
    from gpcorrect.vision import Camera, Chessboard, adjust, calibrate_lens, refine_pose

    board = Chessboard(9, 6, SQUARE)
    corners = [lens.pixels(_board(lens, board.points, rng)) for _ in range(BOARDS)]
    corners = [c + CORNER_NOISE_PX * rng.standard_normal(c.shape) for c in corners]
    calibration = calibrate_lens(corners, board, lens.size)
    points = marker_points()
    pixels = lens.pixels(points) + MARKER_NOISE_PX * rng.standard_normal((len(points), 2))
    rough = se3.invert(se3.pose(looking_at(lens.position + 0.02, np.array([0.01, 0.0, 0.2])), lens.position + 0.02))
    placement = refine_pose(points, pixels, calibration.intrinsics, [rough])
    bundle = adjust(calibration, board, points, pixels, placement)
    found = bundle.placement
    return Camera(name, bundle.intrinsics, found.T_camera_tracker, found.covariance, found.rms_px)


def _board(lens: Lens, corners: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Corners of a board held before the camera at a random slant, wholly in the picture."""
    while True:
        axes = lens.axes @ se3.matrix_from_rotvec(rng.uniform(-0.6, 0.6, 3))
        u, v = (np.array(float(p)) for p in rng.uniform([120, 100], [520, 380]))
        middle = lens.position + lens.directions(u, v) * rng.uniform(0.24, 0.4)
        placed: FloatArray = middle + (corners - corners.mean(axis=0)) @ axes.T
        pixels = lens.pixels(placed)
        if (pixels > 5).all() and (pixels < np.array(lens.size) - 5).all():
            return placed


def _tracked(
    stage: Stage,
    cameras: Sequence[Camera],
    target: Target,
    poses: FloatArray,
    cards: Mapping[int, Mapping[int, Sequence[Card]]],
) -> dict[str, Any]:
    """Track the target along these poses, and compare with them; cards hide it from cameras in some frames."""
    from gpcorrect.vision import Tracker

    errors, turns, measured = [], [], 0
    with Tracker(cameras, target) as tracker:
        for i, pose in enumerate(poses):
            frame = tracker.step(stage.frame(pose, cards.get(i)), i / RATE_HZ)
            if frame.pose.status == "measured":
                T = frame.pose.T_tracker_tool
                measured += 1
                errors.append(1e3 * (T[:3, 3] - pose[:3, 3]))
                turns.append(np.rad2deg(float(se3.angle(T[:3, :3] @ pose[:3, :3].T))))
    e = np.array(errors)
    row = {
        "rms_mm": float(np.sqrt((e**2).sum(axis=1).mean())),
        "rms_axes_mm": np.sqrt((e**2).mean(axis=0)).tolist(),
        "sd_axes_mm": e.std(axis=0).tolist(),
        "measured_share": measured / len(poses),
    }
    return {**row, "rotation_rms_deg": float(np.sqrt(np.mean(np.square(turns))))} if target.has_pose else row


def _recording(scope: Peng2020Scope, seed: int, label_noise_mm: float) -> CalibrationLog:
    """Random reaches of a RAVEN-II whose tool is seen by cameras of that accuracy, in a frame known by construction."""
    model = preset("raven2_left")
    steps = () if model.noise is None else model.noise.encoder_step
    noise = Noise(tracker_white=1e-3 * label_noise_mm / np.sqrt(3.0), encoder_step=steps)
    model = model.model_copy(update={"noise": noise})
    log = random_reaches_log("raven2_left", scope.reaches, seed, faults=False, model=model)
    frame = model.T_tracker_base
    assert frame is not None
    return replace(log, meta=replace(log.meta, tracker_base=(*frame.translation, *frame.rotvec)))


def _microseconds(experiment: Experiment, log: CalibrationLog) -> float:
    """Median time of one sample in a stream."""
    stream = experiment.corrector.stream()
    assert log.measured_jp is not None
    assert log.measured_cp is not None
    assert log.setpoint_cp is not None
    spent = []
    for i in range(min(STREAM_SAMPLES, len(log))):
        sample = RobotState(
            float(log.time[i]),
            log.measured_jp[i],
            log.measured_cp.position[i],
            None if log.measured_cp.quaternion is None else log.measured_cp.quaternion[i],
            None if log.setpoint_jp is None else log.setpoint_jp[i],
            None if log.measured_jv is None else log.measured_jv[i],
            None if log.measured_jf is None else log.measured_jf[i],
            log.setpoint_cp.position[i],
            None if log.setpoint_cp.quaternion is None else log.setpoint_cp.quaternion[i],
        )
        begun = time.perf_counter()
        stream.correct(sample)
        spent.append(time.perf_counter() - begun)
    return 1e6 * float(np.median(spent))
