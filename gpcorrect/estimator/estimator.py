"""A fitted position estimator: batches for logs, and one sample at a time for a servo loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Self

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.estimator.data import EstimatorData
from gpcorrect.estimator.state import RobotState
from gpcorrect.joint.coupled_play import CoupledPlay
from gpcorrect.joint.maps import NetworkMap, PolynomialMap
from gpcorrect.joint_corrector.gp import GPMap
from gpcorrect.packing import pack, unpack
from gpcorrect.rigid import RigidModel
from gpcorrect.types import FloatArray

__all__ = ["EstimatorMethod", "EstimatorStream", "PositionEstimate", "PositionEstimator"]

EstimatorMethod = Literal["gp", "network", "linear"]
LONGEST_STEP = 0.5  # s between two samples of a stream; after a longer gap the path begins anew


@dataclass(frozen=True, eq=False)
class PositionEstimate:
    """Where the tool is: positions `(n, 3)` in the base frame (m) and their standard deviations."""

    position: FloatArray
    std: FloatArray


@dataclass(frozen=True, eq=False)
class PositionEstimator:
    """What was learned of one arm's position error.

    Parameters
    ----------
    method : str
        "gp", "network" or "linear".
    registration : RigidModel
        From the tracker's frame to the base: as the log states it, or the best rigid motion of the training.
    rigid : RigidModel
        That best rigid motion.
    centre, half : (d,) arrays
        Middle and half of the range of each joint in training, rad or m.
    play : CoupledPlay
        Slack of the cables: where the joints really are depends on where they come from.
    with_effort : bool
        Whether efforts are among the chosen features.
    learned : GPMap, NetworkMap or PolynomialMap
        Features to position error.
    zero : (3,) array
        Where the error stood when training ended, m.
    state_names : tuple of str
        Columns of the whole state.
    extra : tuple of str
        Extra columns of the log in it.
    summary : mapping
        Counts and seconds of the fit.
    """

    method: EstimatorMethod
    registration: RigidModel
    rigid: RigidModel
    centre: FloatArray
    half: FloatArray
    play: CoupledPlay
    with_effort: bool
    learned: GPMap | NetworkMap | PolynomialMap
    zero: FloatArray
    state_names: tuple[str, ...]
    extra: tuple[str, ...] = ()
    summary: Mapping[str, Any] = field(default_factory=dict)

    def features(self, data: EstimatorData) -> FloatArray:
        """Return the features `(n, k)`: the whole state for the network, joints, slack and efforts otherwise."""
        if self.method == "network":
            return data.state
        path = (data.q - self.centre) / self.half
        features = np.hstack([path, self.play.lags(path, data.new)])
        return np.hstack([features, data.effort]) if self.with_effort and data.effort is not None else features

    def estimate(self, data: EstimatorData) -> PositionEstimate:
        """Return estimated positions of a path, base frame; rows with a missing number are NaN.

        Raises
        ------
        DataError
            The log's state has other columns than the model was trained with.
        """
        if data.q.shape[1] != len(self.centre) or data.state.shape[1] != len(self.state_names):
            raise DataError(
                f"the model knows {len(self.centre)} joints and {len(self.state_names)} numbers of state, the log has "
                f"{data.q.shape[1]} and {data.state.shape[1]}.",
                hint="Record the same signals as in training.",
            )
        X = self.features(data)
        known = np.isfinite(X).all(axis=1)
        mean, std = (np.full(data.position.shape, np.nan) for _ in range(2))
        if known.any():
            mean[known], std[known] = self.learned.predict(X[known])
        return PositionEstimate(data.position + mean + self.zero, std)

    def stream(self) -> EstimatorStream:
        """Return an estimator of one sample at a time, which remembers where in its slack the arm is."""
        return EstimatorStream(self)

    def to_parts(self) -> tuple[dict[str, Any], dict[str, FloatArray]]:
        """Return JSON-able data and arrays, for a model file."""
        return pack(self, "model")

    @classmethod
    def from_parts(cls, data: Mapping[str, Any], arrays: Mapping[str, FloatArray]) -> Self:
        """Rebuild from :meth:`to_parts`.

        Raises
        ------
        DataError
            The data do not describe an estimator.
        """
        kinds: dict[str, type] = {"gp": GPMap, "network": NetworkMap, "linear": PolynomialMap}
        hints: dict[str, type] = {
            "registration": RigidModel,
            "rigid": RigidModel,
            "play": CoupledPlay,
            "learned": kinds[data["method"]],
            **dict.fromkeys(("centre", "half", "zero"), np.ndarray),
        }
        parts: dict[str, Any] = {name: unpack(hint, data[name], arrays) for name, hint in hints.items()}
        names = {name: tuple(data[name]) for name in ("state_names", "extra")}
        return cls(**{**data, **parts, **names})


class EstimatorStream:
    """Estimates sample after sample, as in a servo loop; well below a millisecond each.

    Parameters
    ----------
    model : PositionEstimator
        What was learned.
    """

    def __init__(self, model: PositionEstimator) -> None:
        self._model = model
        self._place: FloatArray | None = None  # of the joints behind the cables, in units of half their ranges
        self._time = -np.inf

    def predict(self, state: RobotState) -> tuple[FloatArray, FloatArray]:
        """Return the estimated position `(3,)` (base frame, m) and its standard deviation.

        Raises
        ------
        DataError
            The sample lacks what the model was trained with, or time runs backwards.
        """
        model = self._model
        if not state.time >= self._time:
            raise DataError(f"samples must come in the order of time; {state.time} s follows {self._time} s.")
        x = self._state(state) if model.method == "network" else self._chosen(state)
        self._time = state.time
        if len(x) != self._expected() or not np.isfinite(x).all():
            raise DataError(
                f"the model needs {self._expected()} finite numbers of state, the sample gives {len(x)}.",
                hint="Hand over the same signals as in the training log.",
            )
        mean, std = self._mean_std(x)
        return np.asarray(state.measured_position) + mean + model.zero, std

    def _expected(self) -> int:
        model = self._model
        if model.method == "network":
            return len(model.state_names)
        return len(model.centre) * (3 if model.with_effort else 2)

    def _mean_std(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        learned = self._model.learned
        if not isinstance(learned, GPMap):
            mean, std = learned.predict(x[None])
            return mean[0], std[0]
        gp, std, _ = learned.predictor.mean_std(x[learned.columns])
        return learned.linear.predict(x[None])[0][0] + gp, std

    def _chosen(self, state: RobotState) -> FloatArray:
        """Joints, slack and efforts of one sample; the slack follows from where the joints were before."""
        model = self._model
        path = (np.asarray(state.measured_jp, dtype=np.float64) - model.centre) / model.half
        if self._place is None or state.time - self._time > LONGEST_STEP:
            self._place = path
        lag = model.play.lags(np.stack([self._place, path]), np.array([True, False]))[1]
        self._place = path - lag
        effort = [] if not model.with_effort or state.measured_jf is None else [state.measured_jf]
        return np.concatenate([path, lag, *effort])

    def _state(self, state: RobotState) -> FloatArray:
        """Return the whole state of one sample, in the order of `state_columns`."""
        parts: list[FloatArray] = [
            part
            for part in (state.setpoint_jp, state.measured_jp, state.measured_jv, state.measured_jf)
            if part is not None
        ]
        if state.setpoint_jp is not None:
            parts.append(np.asarray(state.setpoint_jp) - state.measured_jp)
        for position, quaternion in (
            (state.setpoint_position, state.setpoint_quaternion),
            (state.measured_position, state.measured_quaternion),
        ):
            if position is not None:
                parts.append(position)
                parts += [] if quaternion is None else [se3.matrix_from_quaternion(quaternion).ravel()]
        return np.concatenate([*parts, np.asarray(state.extra, dtype=np.float64)])
