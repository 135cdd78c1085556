"""Orientations that are not learned from: those that hardly vary among the commands, and those that no tracker saw.

Held ones are registered; of unseen ones, what positions show of the lever arm from the marker to the tool tip is said.

A regression from observed to commanded rotations is one with errors in its regressor (Fuller 1987, Sec. 1.1). With
commands of spread c that the robot misses by m, it passes on the share `k = c^2 / (c^2 + m^2)` of a tilt that is asked
for, and takes the rest for a miss to be undone. Its held-out errors are counted in commands and have the spread
`m sqrt(k)`; what the robot then misses has `m sqrt(2 - k)`. Where the command never turns, errors of zero are claimed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.dataset import Samples, folds_of
from gpcorrect.calibration.metrics import Z95
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.gpr import IntervalCalibration, LeftOut
from gpcorrect.rigid import Registration, RigidModel, pose_residual, register
from gpcorrect.rigid.select import MarkerOption
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, frozen_array


@dataclass(frozen=True, eq=False)
class HeldOrientation:
    """What is known of rotations where the training commanded nearly one orientation.

    Parameters
    ----------
    R_mean : (3, 3) array, mean of the observed orientations, registered
    widest : float
        Angle from it up to which positions were learned, rad: what commands vary by, and nearly all that is missed. A
        few orientations that were commanded far from the others do not widen it.
    std, interval95 : (3,) arrays
        Root mean square of the rotations that registration leaves along the base's axes, and the half widths that hold
        95 % of them, rad.
    commanded, missed : float, mean angle of the commands from their mean, and median angle of what is left, rad
    """

    R_mean: FloatArray
    widest: float
    std: FloatArray
    interval95: FloatArray
    commanded: float
    missed: float

    def __post_init__(self) -> None:
        for name, shape in (("R_mean", (3, 3)), ("std", (3,)), ("interval95", (3,))):
            value = frozen_array(getattr(self, name))
            if value.shape != shape or not np.isfinite(value).all():
                raise DataError(f"{name} of a held orientation must be finite with shape {shape}, got {value.shape}.")
            object.__setattr__(self, name, value)
        if min(*self.std, *self.interval95) < 0 or not self.widest >= 0:
            raise DataError("spreads of a held orientation are at least 0.")

    @classmethod
    def of(cls, reference: PoseSignal, command: PoseSignal, samples: Samples) -> Self:
        """Return what n samples say of it.

        Parameters
        ----------
        reference, command : PoseSignal, n registered observations and their commands, with orientations
        samples : Samples, the same, of which positions are learned
        """
        trajectory = samples.trajectory[samples.rows]
        R_mean, left = se3.rotation_mean(_rotations(reference)), pose_residual(reference, command)[:, 3:]
        std = np.maximum(np.sqrt(np.mean(left**2, axis=0)), np.finfo(float).tiny)
        intervals = IntervalCalibration.fit(left, np.broadcast_to(std, left.shape), trajectory, folds_of(trajectory))
        commanded, missed = _spreads(reference, command)
        widest = commanded + float(np.percentile(np.linalg.norm(left, axis=1), LIMITS.range_quantiles[1]))
        return cls(R_mean, widest, std, intervals.widened(samples.widening).interval95(std), commanded, missed)

    def joined(self, other: Self) -> Self:
        """Return what is known after another log: no narrower than before.

        Parameters
        ----------
        other : HeldOrientation, of the other log
        """
        apart = float(se3.angle(self.R_mean.T @ other.R_mean))
        return replace(
            self,
            widest=max(self.widest, other.widest + apart),
            std=np.maximum(self.std, other.std),
            interval95=np.maximum(self.interval95, other.interval95),
            commanded=max(self.commanded, other.commanded),
            missed=max(self.missed, other.missed),
        )

    def beyond(self, rotations: FloatArray) -> BoolArray:
        """Return which registered orientations `(n,)` are none of those that were seen in training.

        Parameters
        ----------
        rotations : (n, 3, 3) array, base frame
        """
        return self._turned(rotations) > self.widest

    def whole(self, std: FloatArray, interval95: FloatArray, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return deviations and half widths of whole poses `(..., 6)`, with what a turn may move the marker by.

        Parameters
        ----------
        std, interval95 : (..., 3) arrays, of positions in the training's orientation
        rotations : (..., 3, 3) array, registered orientations
        """
        lever = LIMITS.unseen_lever * np.maximum(self._turned(rotations) - self.commanded, 0.0)[..., None]
        std, width = np.hypot(std, lever / Z95), np.hypot(interval95, lever)
        turn, turn95 = (np.broadcast_to(part, std.shape) for part in (self.std, self.interval95))
        return np.concatenate([std, turn], axis=-1), np.concatenate([width, turn95], axis=-1)

    def _turned(self, rotations: FloatArray) -> FloatArray:
        return np.asarray(se3.angle(self.R_mean.T @ rotations))

    def beside(
        self, left_out: LeftOut, intervals: IntervalCalibration, reference: PoseSignal, command: PoseSignal
    ) -> tuple[LeftOut, IntervalCalibration]:
        """Return errors, deviations and intervals of positions with those of rotations behind them.

        Parameters
        ----------
        left_out : LeftOut, of n positions
        intervals : IntervalCalibration, of positions
        reference, command : PoseSignal, n registered observations and their commands
        """
        factor = np.maximum(intervals.factor, np.finfo(float).tiny)
        width = self.whole(left_out.std, factor * left_out.std, _rotations(reference))[1][:, :3]
        left = pose_residual(reference, command)[:, 3:]
        std = np.hstack([width / factor, np.broadcast_to(self.std, left.shape)])
        both = LeftOut(np.hstack([left_out.errors, left]), std, left_out.novelty)
        return both, IntervalCalibration(np.concatenate([intervals.factor, self.interval95 / self.std]))

    @property
    def sentence(self) -> str:
        """What a reader must know of the model's answers."""
        commanded, missed = np.degrees([self.commanded, self.missed])
        lever = 100 * LIMITS.unseen_lever
        return (
            f"rotations are not corrected: the commanded orientations of the training lie {commanded:.2g} deg about "
            f"their mean, and the robot misses them by {missed:.2g} deg, so that nothing tells how to mend it. An "
            "orientation is registered and passed on, its interval is what is missed then, and positions are learned "
            f"without the observed one, for a marker up to {lever:.0f} cm from the tool tip. To correct them, record "
            f"commands that turn by more than {missed:.2g} deg"
        )

    def to_dict(self) -> dict[str, float | list[float]]:
        """Return the spreads in degrees, JSON-able."""
        return {
            "commanded_deg": float(np.degrees(self.commanded)),
            "missed_deg": float(np.degrees(self.missed)),
            "interval95_deg": np.degrees(self.interval95).tolist(),
        }


def hardly_turns(reference: PoseSignal, command: PoseSignal) -> bool:
    """Whether commanded orientations vary less than the robot misses them, see :attr:`Limits.least_turning`.

    Parameters
    ----------
    reference, command : PoseSignal, n registered observations and their commands
    """
    if reference.quaternion is None or command.quaternion is None:
        return False
    commanded, missed = _spreads(reference, command)
    return commanded < LIMITS.least_turning * missed


def _spreads(reference: PoseSignal, command: PoseSignal) -> tuple[float, float]:
    """Return the mean angle of commands from their mean, and the median angle of what registration leaves from its.

    A constant turn of the frames, or of the tool in the marker, that a registration did not take out is no miss.
    """
    R_ref, R_cmd = _rotations(reference), _rotations(command)
    left = [R_cmd @ np.swapaxes(R_ref, 1, 2), np.swapaxes(R_ref, 1, 2) @ R_cmd]
    missed = min(float(np.median(_from_mean(R))) for R in left)
    return float(_from_mean(R_cmd).mean()), missed


def _from_mean(rotations: FloatArray) -> FloatArray:
    return se3.angle(se3.rotation_mean(rotations).T @ rotations)


def _rotations(signal: PoseSignal) -> FloatArray:
    assert signal.quaternion is not None
    return se3.matrix_from_quaternion(signal.quaternion)


def register_held(
    whole: Registration, observed: PoseSignal, command: PoseSignal, trajectory: IntArray, marker: MarkerOption
) -> Registration:
    """Register positions by themselves, frames turned alike, and orientations by the mean turn that is left.

    Orientations that hardly vary say nothing of a lever arm, nor, but for positions on one line, of how the frames are
    turned.

    Parameters
    ----------
    whole : Registration, of the same samples by their whole poses
    observed, command : PoseSignal, n samples each, with orientations
    trajectory : (n,) int array
    marker : {"none", "solve", "auto"}, as for :func:`gpcorrect.rigid.register`; a lever arm is not solved for
    """
    positions = PoseSignal(observed.position), PoseSignal(command.position)
    try:
        found = register(*positions, trajectory, "none" if marker == "none" else "auto")
    except DegenerateError:
        found = whole
    frames = found.model
    left = np.swapaxes(frames.R_position @ _rotations(observed), 1, 2) @ _rotations(command)
    model = RigidModel(
        "separate", frames.R_position, frames.t, R_left=frames.R_position, R_right=se3.rotation_mean(left)
    )
    return replace(found, model=model, reason=f"{found.reason}; orientations by their mean turn")


def lever_note(log: CalibrationLog, rows: IntArray, reference: FloatArray, left: FloatArray) -> tuple[str, ...]:
    """Return a note where a marker away from the tip explains much of what a registration of positions leaves.

    A marker at `a` in the tool's frame shows `u + R_cmd a`, so residuals hold `-R_cmd a`. That is fitted beside a small
    turn and shift of the frames to one half of the trajectories, and measured on the other, both ways.

    Parameters
    ----------
    log : CalibrationLog, n samples; nothing is returned where the tracker has orientations, or commands have none
    rows : (k,) int array, samples that were registered
    reference, left : (k, 3) arrays, registered positions, and commands minus these, m
    """
    tracker, command = log.tracker_cp, log.setpoint_cp
    if tracker is None or command is None or tracker.quaternion is not None or command.quaternion is None:
        return ()
    ok = np.isfinite(command.quaternion[rows]).all(axis=1)
    R, reference, left = se3.matrix_from_quaternion(command.quaternion[rows][ok]), reference[ok], left[ok]
    frames = np.concatenate([np.broadcast_to(np.eye(3), R.shape), se3.hat(reference - reference.mean(axis=0))], axis=2)
    design, y = np.concatenate([frames, -R], axis=2), left[:, :, None]
    trajectory = log.trajectory[rows][ok]
    first = trajectory <= np.median(np.unique(trajectory))
    if first.all():
        return ()
    before, after = (
        sum(_misfit(x[half], y[half], x[~half], y[~half]) for half in (first, ~first)) for x in (frames, design)
    )
    if not after < (1.0 - LIMITS.lever_explains) * before:
        return ()
    a = np.linalg.lstsq(design.reshape(-1, 9), y.reshape(-1), rcond=None)[0][6:]
    where = ", ".join(f"{1e3 * length:.0f}" for length in a)
    return (
        f"the tracker reports positions only, of a marker that seems to be {1e3 * np.linalg.norm(a):.0f} mm from the "
        f"commanded point ({where} mm in the commanded tool's frame), which explains {1 - after / before:.0%} of what "
        "registration leaves and follows from orientations, that are not learned from here. Track the orientation too; "
        "or record and ask for the marker's position: setpoint_cp plus these millimetres, turned by its orientation",
    )


def _misfit(x: FloatArray, y: FloatArray, other_x: FloatArray, other_y: FloatArray) -> float:
    """Return the sum of squares that a fit to some samples leaves of others."""
    found = np.linalg.lstsq(x.reshape(-1, x.shape[2]), y.reshape(-1), rcond=None)[0]
    return float(((other_y[:, :, 0] - other_x @ found) ** 2).sum())
