"""Features of a joint path: position, velocity, effort, memory, or the whole state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from gpcorrect.errors import DataError
from gpcorrect.joint.coupled_play import CoupledPlay, learn_coupled_play
from gpcorrect.joint.dataset import JointData
from gpcorrect.joint.shown import has_many_speeds, turns_back
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
    kept : (k,) int array or None
        Which of all columns are used, because the training motion tells their effect from others'; all when None.
    """

    kinds: tuple[FeatureKind, ...]
    centre: FloatArray
    half: FloatArray
    play: CoupledPlay | None = None
    n_state: int = 0
    kept: IntArray | None = None

    @classmethod
    def learn(cls, kinds: Sequence[str], data: JointData, rows: IntArray) -> JointFeatures:
        """Learn ranges, and for `memory` the coupled play, from these rows of a log.

        Raises
        ------
        DataError
            A kind is unknown, or the log does not hold what it needs.
        """
        chosen = feature_kinds(kinds)
        low, high = data.q[rows].min(axis=0), data.q[rows].max(axis=0)
        half = np.maximum((high - low) / 2, 1e-12)
        known = cls(chosen, (low + high) / 2, half, None, 0 if data.state is None else data.state.shape[1])
        known._check(data)
        if "memory" in chosen:
            path = known.scaled(data.q)
            play = learn_coupled_play(path, data.error, data.new, rows, turns_back(path, data.new))
            known = replace(known, play=play)
        return replace(known, kept=known._told_apart(data, rows))

    def scaled(self, q: FloatArray) -> FloatArray:
        """Return joints `(..., d)` in units of half their ranges, from the middle."""
        path: FloatArray = (q - self.centre) / self.half
        return path

    def transform(self, data: JointData) -> FloatArray:
        """Return features `(n, k)`; rows with a missing number are NaN."""
        self._check(data)
        return self.chosen(np.hstack([self._columns(kind, data) for kind in self.kinds]))

    def chosen(self, columns: FloatArray) -> FloatArray:
        """Return those of all columns `(..., all)` that are used."""
        return columns if self.kept is None else columns[..., self.kept]

    @cached_property
    def ladder(self) -> FloatArray:
        """Radii `(h, d)` of the single plays of `memory`, in units of half the ranges."""
        return np.outer(LADDER, np.ones(len(self.centre)))

    @property
    def smooth(self) -> IntArray:
        """Columns on which the error may depend in a curved way: all but the ladder of single plays."""
        single = len(self.centre) * len(LADDER)
        curved = [np.arange(size) < (size - single if kind == "memory" else size) for kind, size in self._sizes]
        return np.flatnonzero(np.concatenate(curved)[self._kept])

    @property
    def origins(self) -> tuple[NDArray[np.str_], IntArray]:
        """Kind, and index of the joint, of each column that is used; columns of `state` belong to no joint, -1."""
        dof = len(self.centre)
        kinds = np.concatenate([np.full(size, kind) for kind, size in self._sizes])
        owners = [np.full(size, -1) if kind == "state" else np.arange(size) % dof for kind, size in self._sizes]
        return kinds[self._kept], np.concatenate(owners)[self._kept]

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the training motion could not tell apart, a sentence each."""
        named = {"velocity": "always moves at one speed", "memory": "hardly turns back"}
        used, start, said = set(self._kept.tolist()), 0, []
        for kind, size in self._sizes:
            for joint in range(len(self.centre)) if kind in named else ():
                if start + joint not in used:
                    said.append(f"joint {joint + 1} {named[kind]} in training: its {kind} is not used")
            start += size
        return tuple(said)

    @property
    def _kept(self) -> IntArray:
        return np.arange(sum(size for _, size in self._sizes)) if self.kept is None else self.kept

    @property
    def _sizes(self) -> list[tuple[FeatureKind, int]]:
        """Kinds with their numbers of columns, before any is left out."""
        dof = len(self.centre)
        sizes = {"memory": dof * (1 + len(LADDER)), "state": self.n_state}
        return [(kind, sizes.get(kind, dof)) for kind in self.kinds]

    def _told_apart(self, data: JointData, rows: IntArray) -> IntArray:
        """Columns whose effect this motion shows: slack needs joints that turn back, velocity more than one speed."""
        shown = {
            "memory": np.tile(turns_back(self.scaled(data.q), data.new), 1 + len(LADDER)),
            "velocity": has_many_speeds(data.velocity[rows]),
        }
        masks = [shown.get(kind, np.ones(size, dtype=bool)) for kind, size in self._sizes]
        kept = np.flatnonzero(np.concatenate(masks))
        if kept.size == 0:
            raise DataError(
                f"this motion shows nothing of {', '.join(self.kinds)}: one speed, no turning back.",
                hint="Add position to the features, or record a speed ladder.",
            )
        return kept

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
