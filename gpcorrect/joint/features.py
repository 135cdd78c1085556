"""Features of a joint path: position, velocity, effort, memory, or the whole state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.joint.coupled_play import CoupledPlay, learn_coupled_play
from gpcorrect.joint.dataset import JointData
from gpcorrect.play import play_states
from gpcorrect.types import FloatArray, IntArray

__all__ = ["FeatureKind", "JointFeatures", "feature_kinds"]

FeatureKind = Literal["position", "velocity", "effort", "memory", "state"]

LADDER = (0.02, 0.1, 0.3)  # radii of single plays beside the coupled one, in units of half the joints' ranges


@dataclass(frozen=True, eq=False)
class JointFeatures:
    """How a path becomes columns; learned from training rows, the same for every log.

    Parameters
    ----------
    kinds : tuple of str
        Which columns, in this order.
    centre, half : (d,) arrays
        Middle and half of the range of each joint in training, rad or m.
    play : CoupledPlay or None
        The coupled play of `memory`.
    n_state : int
        Columns of `state`.
    """

    kinds: tuple[FeatureKind, ...]
    centre: FloatArray
    half: FloatArray
    play: CoupledPlay | None = None
    n_state: int = 0

    @classmethod
    def learn(cls, kinds: Sequence[str], data: JointData, rows: IntArray) -> JointFeatures:
        """Learn ranges, and for `memory` the coupled play, from these rows of a log.

        Raises
        ------
        DataError
            A kind is unknown, or the log does not hold what it needs.
        """
        chosen = feature_kinds(kinds)
        low, high = np.percentile(data.q[rows], (0.0, 100.0), axis=0)
        half = np.maximum((high - low) / 2, 1e-12)
        known = cls(chosen, (low + high) / 2, half, None, 0 if data.state is None else data.state.shape[1])
        known._check(data)
        if "memory" not in chosen:
            return known
        play = learn_coupled_play(known.scaled(data.q), data.error, data.new, rows)
        return cls(chosen, known.centre, half, play, known.n_state)

    def scaled(self, q: FloatArray) -> FloatArray:
        """Return joints `(..., d)` in units of half their ranges, from the middle."""
        path: FloatArray = (q - self.centre) / self.half
        return path

    def transform(self, data: JointData) -> FloatArray:
        """Return features `(n, k)`; rows with a missing number are NaN."""
        self._check(data)
        return np.hstack([self._columns(kind, data) for kind in self.kinds])

    @cached_property
    def ladder(self) -> FloatArray:
        """Radii `(h, d)` of the single plays of `memory`, in units of half the ranges."""
        return np.outer(LADDER, np.ones(len(self.centre)))

    @property
    def smooth(self) -> IntArray:
        """Columns on which the error may depend in a curved way: all but the ladder of single plays."""
        dof = len(self.centre)
        sizes = {"memory": dof * (1 + len(LADDER)), "state": self.n_state}
        chosen: list[int] = []
        start = 0
        for kind in self.kinds:
            size = sizes.get(kind, dof)
            chosen += range(start, start + (dof if kind == "memory" else size))
            start += size
        return np.array(chosen, dtype=np.int64)

    def _columns(self, kind: FeatureKind, data: JointData) -> FloatArray:
        path = self.scaled(data.q)
        match kind:
            case "position":
                return path
            case "velocity":
                return data.velocity / self.half
            case "effort":
                assert data.effort is not None
                return np.asarray(data.effort)
            case "memory":
                assert self.play is not None
                steps = np.diff(path, axis=0, prepend=path[:1])
                ladder = play_states(steps, self.ladder, np.cumsum(data.new)) / self.ladder
                return np.hstack([self.play.lags(path, data.new), ladder.reshape(len(path), -1)])
            case "state":
                assert data.state is not None
                return data.state

    def _check(self, data: JointData) -> None:
        if data.q.shape[1] != len(self.centre):
            raise DataError(f"the model knows {len(self.centre)} joints, the log has {data.q.shape[1]}.")
        if "effort" in self.kinds and (data.effort is None or not np.isfinite(data.effort).any()):
            raise DataError(
                "effort is among the features, but the log has no efforts (measured_jf) for this direction.",
                hint="Leave effort out: --features position,velocity,memory",
            )
        if "state" in self.kinds and (0 if data.state is None else data.state.shape[1]) != self.n_state:
            raise DataError("the log's state has other columns than the model was trained with.")


def feature_kinds(kinds: Sequence[str]) -> tuple[FeatureKind, ...]:
    """Return the kinds in order, each once.

    Raises
    ------
    DataError
        One is unknown, or there is none.
    """
    known: tuple[FeatureKind, ...] = get_args(FeatureKind)
    wrong = [kind for kind in kinds if kind not in known]
    if wrong or not kinds:
        raise DataError(f"features are {', '.join(known)}; got {', '.join(wrong) or 'none'}.")
    return tuple(kind for kind in known if kind in kinds)
