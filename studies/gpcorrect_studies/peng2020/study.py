"""Peng et al. 2020: ground truth from four webcams on rendered pictures, and a position estimator learned from it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import islice
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
from gpcorrect_studies.claims import ClaimTable, StudyResult
from gpcorrect_studies.parts import Parts
from gpcorrect_studies.rendering import Card, Lens, Stage, looking_at, marker_points, random_motion
from gpcorrect_studies.rendering import single_ball as one_ball

if TYPE_CHECKING:  # OpenCV is an extra: other studies are done again without it
    from gpcorrect.vision import Camera, Target

    Case = tuple[Stage, Target, Mapping[int, Mapping[int, Sequence[Card]]]]

RATE_HZ = 30.0  # that of a common webcam
COVER = Card((0, 0, 640, 480))  # hides a whole picture
CORNER_NOISE_PX = MARKER_NOISE_PX = 0.05  # SD; chosen by hand
BOARDS, SQUARE = 20, 0.015  # pictures of the board, and the side of its squares, m; chosen by hand
STREAM_SAMPLES = 2000  # over which one estimate is timed; chosen by hand
BALL_RADIUS = 0.020  # m; the paper's fixture
METHODS = ("linear", "network", "gp")
COMPONENTS = ("x_mm", "y_mm", "z_mm", "length_mm")  # rows of Table I
CLAIMS = ClaimTable.of_study("peng2020")


@dataclass(frozen=True)
class Peng2020Scope:
    """How much to do."""

    frames: int = 120  # of each rendered sequence
    reaches: int = 150  # of the simulated robot; the last fifth is held out, whole
    layers: tuple[int, ...] = (600, 500, 400)  # of the network
    epochs: int = 60  # of the network
    inducing: int = 400  # points of the Gaussian process

    @classmethod
    def short(cls) -> Peng2020Scope:
        """Return a third of the study: every part, with fewer frames and reaches and a smaller network."""
        return cls(40, 60, (150, 125, 100), 40, 200)

    @classmethod
    def quick(cls) -> Peng2020Scope:
        """Return a small study: every part, rough figures."""
        return cls(8, 30, (60, 50, 40), 30, 120)


@dataclass(frozen=True, eq=False)
class Peng2020(StudyResult):
    """Both halves of the study, measured."""

    STUDY, CLAIMS = "peng2020", CLAIMS

    scope: Peng2020Scope
    samples: int  # of the simulated robot's recording
    # by what is seen (single ball; end effector; the latter with a camera hidden a third of the time): RMS and SD of
    # each component of the error and of its length, mm, and rotation, deg
    table1: Mapping[str, Any]
    cameras_mm: Sequence[float]  # errors of the cameras' positions, mm
    estimator: Mapping[str, Any]  # by method: errors on held-out reaches, and what they are less than the reported ones

    def setup(self) -> dict[str, float]:
        """Return the numbers of the set-up, under the names of the printed ones."""
        from gpcorrect.vision import END_EFFECTOR

        distance = float(np.linalg.norm(END_EFFECTOR.places, axis=1).max())
        return {
            "data_pairs": self.samples,
            "cameras": len(self.cameras_mm),
            "markers": len(marker_points()),
            "ball_distance_mm": 1e3 * distance,
            "ball_radius_mm": 1e3 * BALL_RADIUS,
            "frames": self.scope.frames,
        }

    def figures(self) -> dict[str, Any]:
        """Return what was measured, as JSON-able data."""
        return {
            "scope": asdict(self.scope),
            "samples": self.samples,
            "table1": self.table1,
            "cameras_mm": self.cameras_mm,
            "estimator": self.estimator,
        }


def reproduce_peng2020(
    scope: Peng2020Scope, seed: int = 0, progress: Progress | None = None, parts: Parts | None = None
) -> Peng2020:
    """Do both halves of the study again: the cameras' accuracy, and what an estimator makes of their labels.

    Parameters
    ----------
    scope : Peng2020Scope
    seed : int, of scene, motion and noise
    progress : Progress, optional
    parts : Parts, optional
    """
    begun, progress, parts = time.perf_counter(), progress or Progress(), parts or Parts()
    table, placed = _table1(scope, seed, progress, parts)
    log = _recording(scope, seed, table["end effector"]["length_mm"]["rms"])
    estimators = parts.each("estimators", partial(_estimator, log, scope, seed), {m: m for m in METHODS}, progress)
    seconds = parts.seconds_before + time.perf_counter() - begun
    return Peng2020(scope, seed, len(log), table, placed, estimators, seconds=seconds)


def _estimator(log: CalibrationLog, scope: Peng2020Scope, seed: int, method: str) -> dict[str, Any]:
    settings = FitSettings(method=method, layers=scope.layers, epochs=scope.epochs, inducing=scope.inducing, seed=seed)
    experiment = run_experiment(log, settings, task=PositionEstimator)
    return {
        **experiment.to_dict(),
        **position_reductions(experiment.evaluation),
        "microseconds_a_sample": _microseconds(experiment, log),
    }


def _table1(scope: Peng2020Scope, seed: int, progress: Progress, parts: Parts) -> tuple[dict[str, Any], list[float]]:
    from gpcorrect.vision import END_EFFECTOR, single_ball

    rng = np.random.default_rng([seed, 20])
    whole = Stage.standard(seed, radius=BALL_RADIUS)
    cameras, placed = calibrated_cameras(whole.lenses, rng)
    poses = random_motion(scope.frames, RATE_HZ, rng)
    ball = Stage(whole.lenses, whole.studios, one_ball("red"), BALL_RADIUS)
    third = scope.frames // 3
    hidden = {i: {1: [COVER]} for i in range(third, 2 * third)}
    cases: dict[str, Case] = {
        "single ball": (ball, single_ball("red"), {}),
        "end effector": (whole, END_EFFECTOR, {}),
        "end effector, a camera hidden": (whole, END_EFFECTOR, hidden),
    }
    return parts.each("pictures", partial(_tracked, cameras, poses), cases, progress), placed


def calibrated_cameras(lenses: Sequence[Lens], rng: np.random.Generator) -> tuple[list[Camera], list[float]]:
    """Calibrate rendered cameras as a user would.

    Parameters
    ----------
    lenses : sequence of Lens, the true cameras
    rng : numpy.random.Generator, of boards and noise

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


def _tracked(cameras: Sequence[Camera], poses: FloatArray, case: Case) -> dict[str, Any]:
    """Track the target along these poses, and compare with them; cards hide it from cameras in some frames."""
    from gpcorrect.vision import Tracker

    stage, target, cards = case
    errors, turns = [], []
    with Tracker(cameras, target) as tracker:
        for i, pose in enumerate(poses):
            frame = tracker.step(stage.frame(pose, cards.get(i)), i / RATE_HZ)
            if frame.pose.status == "measured":
                T = frame.pose.T_tracker_tool
                errors.append(1e3 * (T[:3, 3] - pose[:3, 3]))
                turns.append(np.rad2deg(float(se3.angle(T[:3, :3] @ pose[:3, :3].T))))
    e = np.array(errors)
    columns = [*e.T, np.linalg.norm(e, axis=1)]
    row: dict[str, Any] = {
        name: {"rms": float(np.sqrt((column**2).mean())), "sd": float(column.std())}
        for name, column in zip(COMPONENTS, columns, strict=True)
    }
    row["measured_share"] = len(errors) / len(poses)
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
    assert log.measured_cp is not None
    assert log.setpoint_cp is not None
    measured, wanted = log.measured_cp, log.setpoint_cp
    signals = (log.measured_jp, measured.position, measured.quaternion, log.setpoint_jp, log.measured_jv)
    columns: Any = (*signals, log.measured_jf, wanted.position, wanted.quaternion)  # the simulator gives them all
    spent = []
    for t, *row in islice(zip(log.time.tolist(), *columns, strict=True), STREAM_SAMPLES):
        sample = RobotState(t, *row)
        begun = time.perf_counter()
        stream.correct(sample)
        spent.append(time.perf_counter() - begun)
    return 1e6 * float(np.median(spent))
