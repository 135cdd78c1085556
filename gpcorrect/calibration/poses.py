"""Poses of a log: observed and commanded, their velocities, the reference G(x), and what of them is complete."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gpcorrect import se3
from gpcorrect.calibration.dataset import evenly_spread, path_starts, too_few_hint
from gpcorrect.calibration.memory import steps
from gpcorrect.calibration.settings import LIMITS, FitSettings
from gpcorrect.errors import LogError
from gpcorrect.gpr import LeftOut
from gpcorrect.rigid import Registration, RigidModel, register
from gpcorrect.robust import MAD_TO_STD
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal
from gpcorrect.velocity import MOST, STENCIL, derivative, sampled_rows, segment_labels, twists

NOISE_FRACTION = 0.01
"""Of the typical speed, that noise may add to a velocity; chosen by hand. Half, itself and double, mm and deg, on
machines of bench/pose_peers.py (seed 11, last fifth): gantry .81 .57, .81 .57, .90 .56; tendons 1.04 1.24, 1.04 1.24,
1.02 1.22; platform 1.90 .34, 2.10 .35, 2.10 .35."""
WIDEST = 0.06  # s: a wider stencil blurs reversals, where friction acts; chosen by hand
STENCIL_GAIN = np.sqrt(130.0) / 12.0  # five-point stencil: standard deviation of a derivative, times step over noise
FEWEST_ASIDE = STENCIL // 2 + 1  # samples to each side: fewer are laid a stencil of degree four through
THIRD_DIFFERENCE_GAIN = np.sqrt(20.0)  # 1 + 9 + 9 + 1: standard deviation of third differences of unit white noise
STRIDE = 5  # samples over which a speed is measured: noise counts little, curvature too; chosen by hand
CHECK_QUERIES = 8  # training queries that a model file asks again at load; chosen by hand
WORTH_IT = 0.02  # least fraction of the error that memory must take away not to be called useless; chosen by hand

Steps = tuple[float, float]


def rotations_of(signal: PoseSignal) -> FloatArray | None:
    """Rotation matrices `(n, 3, 3)` of a signal, NaN where a sample is missing; None when it holds positions only.

    Parameters
    ----------
    signal : PoseSignal, n poses
    """
    return None if signal.quaternion is None else se3.matrix_from_quaternion(signal.quaternion)


def observed_twists(log: CalibrationLog, signal: PoseSignal, keep: BoolArray, velocity_steps: Steps) -> FloatArray:
    """Return twists of an observed path, never across a rejected sample or a gap; static poses are at rest.

    Parameters
    ----------
    log : CalibrationLog, n samples
    signal : PoseSignal, its observed poses
    keep : (n,) mask, samples that are not rejected
    velocity_steps : pair of float, see :func:`stencil_steps`

    Returns
    -------
    (n, 6) array
        m/s and rad/s; NaN where there is none.
    """
    if log.static:
        return np.zeros((len(log), 6))
    rows, found = sampled_rows(signal.finite), np.full((len(log), 6), np.nan)
    time, seen = log.time[rows], signal[rows]
    labels = segment_labels(time, log.trajectory[rows], keep[rows] & seen.finite)
    linear, angular = (step or None for step in velocity_steps)
    found[rows, :3] = derivative(time, seen.position, labels, linear)
    found[rows, 3:] = twists(time, seen.position, rotations_of(seen), labels, angular)[:, 3:]
    return found


def reference_twists(rigid: RigidModel, rotations: FloatArray | None, twist: FloatArray) -> FloatArray:
    """Twists `(n, 6)` of the references, from those of the observed poses with rotations `(n, 3, 3)`.

    The lever arm turns with the body: `v = R_position (v_obs + w_obs x R_obs offset)`, `w = R_left w_obs`.

    Parameters
    ----------
    rigid : RigidModel, from the observer's frame to the command's
    rotations : (n, 3, 3) array or None, of the observed poses
    twist : (n, 6) array, of the observed poses, m/s and rad/s
    """
    linear, angular = twist[..., :3], twist[..., 3:]
    if rotations is not None and rigid.needs_orientation:
        linear = linear + _cross(angular, rotations @ rigid.offset)
    return np.concatenate([linear @ rigid.R_position.T, angular @ rigid.R_left.T], axis=-1)


def inverse_reference_twists(rigid: RigidModel, poses: PoseSignal, twist: FloatArray) -> FloatArray:
    """Twists `(n, 6)` of observed poses, from those of their references: the inverse of :func:`reference_twists`.

    Parameters
    ----------
    rigid : RigidModel, from the observer's frame to the command's
    poses : PoseSignal, n observed poses
    twist : (n, 6) array, of the references, m/s and rad/s
    """
    linear, angular = twist[:, :3] @ rigid.R_position, twist[:, 3:] @ rigid.R_left
    if poses.quaternion is not None and rigid.needs_orientation:
        linear = linear - _cross(angular, se3.matrix_from_quaternion(poses.quaternion) @ rigid.offset)
    return np.hstack([linear, angular])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of rows: np.cross without its checks, which take a quarter of a query."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def pose_pair(log: CalibrationLog) -> tuple[PoseSignal, PoseSignal]:
    """Return (observed, command): `tracker_cp` and `setpoint_cp`, both without orientation when one of them has none.

    Parameters
    ----------
    log : CalibrationLog, n samples

    Raises
    ------
    LogError
        One of the signals is missing, or the log is empty.
    """
    missing = [name for name in ("tracker_cp", "setpoint_cp") if getattr(log, name) is None]
    if missing or log.tracker_cp is None or log.setpoint_cp is None:
        of_joints = log.setpoint_cp is None and log.setpoint_jp is not None
        raise LogError(
            f"learning needs tracker_cp and setpoint_cp; missing: {', '.join(missing)}. "
            f"Present: {', '.join(log.signals) or 'none'}.",
            hint="Name the columns in a mapping file: --columns map.toml"
            + (", or the arm whose joints these are: --machine robot.urdf" if of_joints else "")
            + "".join(f". Reading said: {remark.rstrip('.')}" for remark in log.remarks),
            path=log.name,
        )
    if len(log) == 0:
        raise LogError("the log holds no samples.", path=log.name)
    observed, command = log.tracker_cp, log.setpoint_cp
    if observed.quaternion is None or command.quaternion is None:
        return PoseSignal(observed.position), PoseSignal(command.position)
    return observed, command


def stencil_steps(log: CalibrationLog) -> Steps:
    """Return the stencils' steps, s, for positions and for turns, that keep noise below a fraction of the speed.

    0 takes five neighbouring samples. The tracker's noise is estimated from third differences, which the motion itself
    hardly enters at the rates where noise matters.

    Parameters
    ----------
    log : CalibrationLog, n samples
    """
    log = log.select(sampled_rows(pose_pair(log)[0].finite))
    runs = [rows for _, rows in log.trajectories() if len(rows) > STRIDE]
    if not runs:
        return 0.0, 0.0
    sample = float(np.median(np.concatenate([np.diff(log.time[rows]) for rows in runs])))
    moved = [steps(pose_pair(log)[0][rows])[1:] for rows in runs]
    parts = [[part[:, columns] for part in moved] for columns in (slice(3), slice(3, 6))]
    linear, angular = (0.5 * sample * _samples_aside(part, sample) for part in parts)
    return linear, angular


def _samples_aside(moved: list[FloatArray], sample: float) -> int:
    """Return how many samples to each side a velocity needs of paths that moved so between samples; 0 for neighbours.

    The slope of a parabola through k samples to each side has the noise of one sample times `sqrt(3 / (k (k + 1) (2 k +
    1)))`, over the time between samples; through more than `MOST` in all none is laid.
    """
    noise = MAD_TO_STD / THIRD_DIFFERENCE_GAIN * _median(np.abs(np.concatenate([np.diff(p, 2, axis=0) for p in moved])))
    chords = np.concatenate([sliding_window_view(part, STRIDE, axis=0).sum(axis=-1) for part in moved])
    allowed = NOISE_FRACTION * _median(np.linalg.norm(chords, axis=1)) / STRIDE
    widest = int(2.0 * WIDEST / sample)
    if not allowed > 0.0 or STENCIL_GAIN * noise <= allowed or widest < FEWEST_ASIDE:
        return 0
    k = np.arange(FEWEST_ASIDE, widest + 1)
    laid = np.minimum(k, MOST // 2)
    enough = noise * np.sqrt(3.0 / (laid * (laid + 1) * (2 * laid + 1))) * laid / k <= allowed
    return int(k[np.argmax(enough)]) if enough.any() else widest


def _median(values: FloatArray) -> float:
    return float(np.median(values[np.isfinite(values)])) if np.isfinite(values).any() else 0.0


@dataclass(frozen=True, eq=False)
class PosePairs:
    """The k samples of a log with both poses and a velocity: their rows, and where among them a path begins."""

    observed: PoseSignal
    command: PoseSignal
    twist: FloatArray
    rows: IntArray
    new: BoolArray

    @classmethod
    def of(cls, log: CalibrationLog, keep: BoolArray, velocity_steps: Steps) -> Self:
        """Return the complete ones of a log's samples.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that are not rejected
        velocity_steps : pair of float, see :func:`stencil_steps`
        """
        observed, commanded = pose_pair(log)
        twist = observed_twists(log, observed, keep, velocity_steps)
        rows = np.flatnonzero(keep & observed.finite & commanded.finite & np.isfinite(twist[:, :3]).all(axis=1))
        if rows.size < LIMITS.fewest_samples:
            raise LogError(
                f"only {rows.size} of {len(log)} samples can be learned from; at least {LIMITS.fewest_samples} are"
                " needed.",
                hint=too_few_hint(len(log), rejected=not keep.all(), static=log.static),
                path=log.name,
            )
        new = path_starts(log.time[rows], log.session[rows], np.ones(len(rows), dtype=bool))
        return cls(observed[rows], commanded[rows], twist[rows], rows, new)

    @property
    def positions(self) -> Self:
        """The same samples without their orientations."""
        return replace(self, observed=PoseSignal(self.observed.position), command=PoseSignal(self.command.position))

    @property
    def check_queries(self) -> FloatArray:
        """Training queries `(k, 13)` spread over the recording: pose (unturned in a position-only log) and twist."""
        rows = evenly_spread(len(self.rows), CHECK_QUERIES)
        observed = self.observed[rows]
        unturned = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1))
        quaternion = unturned if observed.quaternion is None else observed.quaternion
        return np.hstack([observed.position, quaternion, np.nan_to_num(self.twist[rows])])

    def register(self, log: CalibrationLog, settings: FitSettings) -> Registration:
        """Return the rigid model from the observer's frame to the command's.

        Parameters
        ----------
        log : CalibrationLog, that the samples are of
        settings : FitSettings, whether frames are registered, and whether the marker may be away from the tool tip
        """
        if not settings.rigid:
            return Registration(RigidModel(), "the registration was switched off", (), None)
        return register(self.observed, self.command, log.trajectory[self.rows], settings.marker)


def changes(with_it: LeftOut, without: LeftOut) -> FloatArray:
    """Return the relative change of the errors of positions and, where learned, rotations at left-out trajectories.

    Parameters
    ----------
    with_it, without : LeftOut, of two ways to answer the same log
    """
    sizes = [np.sqrt(np.nanmean(left_out.errors**2, axis=0)) for left_out in (with_it, without)]
    return np.asarray((sizes[0] / sizes[1] - 1.0).reshape(-1, 3).mean(axis=1))


def changes_text(change: FloatArray) -> str:
    """Return such changes in words.

    Parameters
    ----------
    change : (1,) or (2,) array, of position and rotation
    """
    parts = zip(("position", "rotation"), change, strict=False)
    return "error at left-out trajectories " + ", ".join(f"{100 * value:+.0f} % in {name}" for name, value in parts)


def require_poses(log: CalibrationLog) -> None:
    """Refuse, before any work, a log from which no correction of poses can be learned whatever the cleaning keeps.

    Parameters
    ----------
    log : CalibrationLog, to be learned from
    """
    pairs = PosePairs.of(log, np.ones(len(log), dtype=np.bool_), (0.0, 0.0))
    pairs.register(log, FitSettings(marker="none"))
