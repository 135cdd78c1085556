"""The fitted corrector: desired pose in, command and honest uncertainty out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.cleaning import CleaningReport
from gpcorrect.corrector.bounds import Bounds
from gpcorrect.corrector.bridging import MotionLimits
from gpcorrect.corrector.one_pose import Frame, command, frame, inputs
from gpcorrect.corrector.queries import bad_query, checked_poses, checked_times, pose_numbers, twist_numbers
from gpcorrect.corrector.reference import reference_twists, rotations_of
from gpcorrect.corrector.screening import Screen
from gpcorrect.gpr import FeatureMap, IntervalCalibration, Predictor
from gpcorrect.rigid import RigidModel, apply_residual
from gpcorrect.types import (
    BoolArray,
    CalibrationLog,
    Correction,
    CorrectionStatus,
    FloatArray,
    IntArray,
    PoseSignal,
    frozen_array,
)
from gpcorrect.velocity import twists

__all__ = ["CommandCorrector", "PathCorrection"]

PREDICTOR = "predictor."
POSITION = 3
NO_MEMORY = np.zeros(0)
AT_REST = "no twist was given: taken as at rest"
LIMITED = "the learned part was cut to the largest one that training justifies"
BRIDGED = "the path jumps here faster than the arm can move: bridged by straight motion"
OUTSIDE = "outside the training region: the learned part fades to its mean, the interval to its widest"


@dataclass(frozen=True, eq=False)
class PathCorrection:
    """What to command instead of a path of n desired poses.

    Parameters
    ----------
    positions : (n, 3) array
        Commanded positions, base frame, m.
    quaternions : (n, 4) array or None
        Commanded orientations wxyz; None when none were asked for.
    std, interval95 : (n, 6) arrays
        Standard deviation and half width of the 95 % interval of each component: m, then rad; NaN where not learned.
    in_domain : (n,) bool array
        Whether each pose lies near training data.
    status, reason : tuples of n str
        As in :class:`gpcorrect.types.Correction`.
    """

    positions: FloatArray
    quaternions: FloatArray | None
    std: FloatArray
    interval95: FloatArray
    in_domain: BoolArray
    status: tuple[str, ...]
    reason: tuple[str, ...]

    def bridged(self, rows: BoolArray) -> Self:
        """Return the same, saying of these rows (n,) that their poses were replaced."""
        said = zip(rows.tolist(), self.status, self.reason, strict=True)
        marked = [("LIMITED", "; ".join(filter(None, (BRIDGED, why)))) if cut else (how, why) for cut, how, why in said]
        return replace(self, status=tuple(how for how, _ in marked), reason=tuple(why for _, why in marked))


@dataclass(frozen=True, eq=False)
class CommandCorrector:
    """Tells what to command so that the robot reaches a desired pose: `F(x) = H(G(x))` (Mahler 2014, Sec. IV).

    `G` is the rigid registration from the observer's frame to the command's, `H` adds the residual that a Gaussian
    process learned from pose and velocity.

    Parameters
    ----------
    rigid : RigidModel
        G.
    features : FeatureMap
        From a reference pose and its twist to the inputs of the Gaussian process.
    predictor : Predictor
        Mean and standard deviation of the residual.
    intervals : IntervalCalibration
        What turns standard deviations into 95 % intervals that hold on unseen trajectories.
    bounds : Bounds
        Largest residual that is believed, and the novelty beyond which a query is extrapolation.
    screen : Screen
        The training's ruler for judging other logs.
    motion : MotionLimits or None
        What no arm does from one pose of a path to the next; None believes every path, as a fit without cleaning does.
    velocity_step : float or None
        Step of the five-point stencil on recorded paths, s; None takes neighbouring samples.
    summary : mapping
        Frames, units, features, fit report: what the model file says of itself.
    check_queries : (k, 13) array
        Training queries (pose, twist) that a model file records and asks again at load.
    """

    rigid: RigidModel
    features: FeatureMap
    predictor: Predictor
    intervals: IntervalCalibration
    bounds: Bounds
    screen: Screen
    motion: MotionLimits | None
    velocity_step: float | None
    summary: Mapping[str, Any]
    check_queries: FloatArray
    _frame: Frame = field(init=False, repr=False)
    _limits: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_frame", frame(self.rigid, self.features))
        object.__setattr__(self, "_limits", np.array([self.bounds.position, self.bounds.rotation]))
        self._warm_up()

    @property
    def has_orientation(self) -> bool:
        """Whether orientations are corrected too."""
        return self.features.has_orientation

    def correct(self, pose: ArrayLike, twist: ArrayLike | None = None) -> Correction:
        """Return what to command so that the robot reaches `pose`.

        Parameters
        ----------
        pose : (7,) or (3,) array
            Desired position (m) and unit quaternion wxyz in the frame of the training's observed poses; a
            position-only model takes three numbers, and with seven only turns the orientation into the base frame.
        twist : (6,) array, optional
            Desired velocity, m/s and rad/s, same frame. Without it the pose is taken as at rest, and the answer says
            so.

        Raises
        ------
        DataError
            The pose or the twist is not finite, has the wrong length, or its quaternion is not a unit quaternion.
        """
        query, velocity = pose_numbers(pose, orientation=self.has_orientation), twist_numbers(twist)
        good, position, rotation, x = inputs(query, velocity, NO_MEMORY, self._frame)
        if not good:
            raise bad_query(query, velocity)
        mean, std, novelty = self.predictor.mean_std(x)
        position, quaternion, limited = command(position, rotation, mean, self._limits)
        in_domain = self.bounds.in_domain(novelty)
        return Correction(
            position=position,
            quaternion=None if len(query) == POSITION else quaternion,
            std=_six(std),
            interval95=_six(self.intervals.interval95(std)),
            in_domain=in_domain,
            status=_status(in_domain, limited),
            reason=_reason(in_domain, limited, twist is None and self.features.uses_velocity),
        )

    def correct_path(self, poses: ArrayLike, times: ArrayLike) -> PathCorrection:
        """Return what to command instead of a timed path; its velocities come from the five-point stencil on the path.

        Lone jumps that no arm can follow are bridged, and their samples say so (status LIMITED).

        Parameters
        ----------
        poses : (n, 7) or (n, 3) array
            Desired poses, as for :meth:`correct`.
        times : (n,) array
            Seconds, strictly increasing. A path of one pose is at rest.

        Raises
        ------
        DataError
            As for :meth:`correct`, or the times do not increase.
        """
        queries = checked_poses(poses, orientation=self.has_orientation)
        seconds = checked_times(times, len(queries))
        desired = PoseSignal(queries[:, :3], queries[:, 3:] if queries.shape[1] > 3 else None)
        labels = np.zeros(len(queries), dtype=np.int64)
        desired, replaced = self.possible(desired, seconds, labels)
        twist = twists(seconds, desired.position, rotations_of(desired), labels)
        return self.correct_observed(desired, np.nan_to_num(twist)).bridged(replaced)

    def possible(self, desired: PoseSignal, time: FloatArray, labels: IntArray) -> tuple[PoseSignal, BoolArray]:
        """Return desired paths with the lone jumps of each run bridged, and the mask (n,) of replaced poses."""
        if self.motion is None:
            return desired, np.zeros(len(desired), dtype=bool)
        return self.motion.bridge(desired, self.rigid.apply(desired), time, labels)

    def correct_observed(self, desired: PoseSignal, twist: FloatArray) -> PathCorrection:
        """Return what to command instead of desired poses (n rows) with known twists `(n, 6)`."""
        reference = self.rigid.apply(desired)
        moved = reference_twists(self.rigid, rotations_of(desired), twist)
        X = self.features.transform(reference.position, rotations_of(reference), moved)
        mean, std, novelty = self.predictor.mean_std_batch(X)
        residual, limited = self.bounds.limit_rows(mean)
        commanded = apply_residual(reference, _six_columns(residual, 0.0))
        in_domain = self.bounds.in_domain_rows(novelty)
        flags = list(zip(in_domain.tolist(), limited.tolist(), strict=True))
        return PathCorrection(
            positions=commanded.position,
            quaternions=commanded.quaternion,
            std=_six_columns(std, np.nan),
            interval95=_six_columns(self.intervals.interval95(std), np.nan),
            in_domain=in_domain,
            status=tuple(_status(near, cut) for near, cut in flags),
            reason=tuple(_reason(near, cut, False) for near, cut in flags),
        )

    def clean(self, log: CalibrationLog) -> CleaningReport:
        """Judge the samples of another log by the ruler that the training data set."""
        return self.screen.judge(log)

    def info(self) -> dict[str, Any]:
        """Return what the model says of itself: frames, units, features, training region, fit report. JSON-able."""
        return dict(self.summary)

    def to_parts(self) -> tuple[dict[str, Any], dict[str, FloatArray]]:
        """Return the corrector as a JSON-able header and named arrays, for a model file."""
        screen, screen_arrays = self.screen.to_parts()
        predictor = {PREDICTOR + name: array for name, array in self.predictor.to_arrays().items()}
        header = {
            "rigid": self.rigid.to_dict(),
            "features": self.features.to_dict(),
            "intervals": self.intervals.to_dict(),
            "bounds": self.bounds.to_dict(),
            "screen": screen,
            "motion": None if self.motion is None else self.motion.to_dict(),
            "velocity_step": self.velocity_step,
            "summary": dict(self.summary),
        }
        return header, {**predictor, **screen_arrays, "check_queries": self.check_queries}

    @classmethod
    def from_parts(cls, header: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild a corrector from :meth:`to_parts`.

        Raises
        ------
        KeyError, TypeError, ValueError
            A part is missing or is not what it should be.
        """
        return cls(
            rigid=RigidModel.from_dict(header["rigid"]),
            features=FeatureMap.from_dict(header["features"]),
            predictor=Predictor.from_arrays(
                {name.removeprefix(PREDICTOR): a for name, a in arrays.items() if name.startswith(PREDICTOR)}
            ),
            intervals=IntervalCalibration.from_dict(header["intervals"]),
            bounds=Bounds.from_dict(header["bounds"]),
            screen=Screen.from_parts(header["screen"], arrays),
            motion=None if header["motion"] is None else MotionLimits.from_dict(header["motion"]),
            velocity_step=header["velocity_step"],
            summary=header["summary"],
            check_queries=frozen_array(arrays["check_queries"]),
        )

    def _warm_up(self) -> None:
        """Answer a query, so that what is compiled at first use is compiled now."""
        self.correct([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def _six(values: FloatArray) -> FloatArray:
    """Pad the three components of a position-only model with NaN."""
    return values if len(values) == 6 else np.concatenate([values, np.full(3, np.nan)])


def _six_columns(values: FloatArray, fill: float) -> FloatArray:
    if values.shape[1] == 6:
        return values
    return np.concatenate([values, np.full((len(values), 3), fill)], axis=1)


def _status(in_domain: bool, limited: bool) -> CorrectionStatus:
    if limited:
        return "LIMITED"
    return "OK" if in_domain else "EXTRAPOLATING"


def _reason(in_domain: bool, limited: bool, at_rest: bool) -> str:
    said = [(limited, LIMITED), (not in_domain, OUTSIDE), (at_rest, AT_REST)]
    return "; ".join(text for holds, text in said if holds)
