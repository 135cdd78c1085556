"""Features of a joint path: position, velocity, acceleration, effort, memory, lags, or the whole state.

Where effects look alike in a training motion, none of them may be learned: a joint that never turns back holds its
slack on one side, like an offset; a joint that moves at one speed shows friction and damping as one. A calibration that
learned such a feature would be wrong on every other motion, and its held-out trajectories would not show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from gpcorrect.calibration.coupled_play import CoupledPlay, learn_coupled_play, uncoupled_play
from gpcorrect.calibration.joint_path import JointPath, usual_steps
from gpcorrect.calibration.memory import lagged, left_out_squares
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.errors import DataError
from gpcorrect.play import play_states
from gpcorrect.types import BoolArray, FloatArray, IntArray

FeatureKind = Literal["position", "velocity", "acceleration", "effort", "memory", "lags", "state"]

LADDER = (0.02, 0.1, 0.3)
"""Radii of single plays beside the coupled one, in units of half the joints' ranges; chosen by hand on dvrk_random."""
LAGS = 4  # time constants of creep and drag, evenly spaced in their logarithm; chosen by hand
SHORTEST_LAG, LONGEST_LAG = 2.0, 60.0
"""Usual steps, and s, between which they lie: below, a lag is the velocity; above, an arm rests before it has settled;
chosen by hand."""
RATES = (2.0, 5.0)
"""Usual steps over which accelerations are taken. On a simulated stretched cable, of which .0158 deg is noise, a ridge
regression left .0267 deg without them, .0170 with these, .0178 with the first alone, .0198 with the second alone."""
CLEARLY = 0.9
"""Fraction of a joint's squared error without lags or accelerations that it must come under with them. On six machines
of bench/joint_foreign.py and three real ones they come under .85 where they act. At .95 another one had lags, and 1.6
times the error, and joints 4 and 6 of the real pick-and-place had 3 and 4 % less."""
SLACK = 0.05  # half ranges that a joint must turn back by to show its slack; chosen by hand
FEWEST_TURNS = 8  # of the slack from one side to the other, to distinguish it from position and effort; chosen by hand
MOVING = 0.05  # of a joint's highest speed: below it the joint rests; chosen by hand
LEAST_SPEEDS = 1.5
"""Ratio of faster to slower motion, to separate what grows with speed from what does not; chosen by hand."""
PLAIN, REMEMBERED, SLOW, OTHERS = 1e-5, 1e-2, 0.1, 0.3
"""Penalties on squared weights of the linear law, for unit spreads: see :func:`law_penalties`; chosen by hand."""


@dataclass(frozen=True, eq=False)
class JointFeatures:
    """How a path becomes columns; learned from training rows, the same for every log."""

    kinds: tuple[FeatureKind, ...]  # which columns, in this order
    # (d,) each: middle and half of the range of each joint in training, rad or m
    centre: FloatArray
    half: FloatArray
    play: CoupledPlay | None  # the coupled play of `memory`
    lags: FloatArray  # (t,) time constants of `lags`, s
    n_state: int  # columns of `state`
    # (k,) which of all columns are used, because the training motion shows their effect apart from others'
    used: IntArray
    # (r,) times over which the changes of velocities are taken for `acceleration`, s
    rates: FloatArray = field(default_factory=lambda: np.zeros(0))
    # (h, d) radii of the single plays of `memory`, in units of half the ranges
    ladder: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        alike = {len(self.centre), len(self.half), len(self.centre if self.play is None else self.play.gap)}
        unknown = "memory" in self.kinds and self.play is None and self.used.size
        twice = len(set(self.kinds)) < len(self.kinds)
        if len(alike) > 1 or np.ndim(self.lags) != 1 or np.ndim(self.rates) != 1 or unknown or twice:
            raise DataError(f"features of {len(self.centre)} joints do not fit together.")
        object.__setattr__(self, "ladder", np.outer(LADDER, np.ones(len(self.centre))))

    @classmethod
    def learn(
        cls, kinds: Sequence[str], path: JointPath, errors: FloatArray, rows: IntArray, *, searched: bool = True
    ) -> JointFeatures:
        """Learn ranges, and for `memory` the coupled play.

        Parameters
        ----------
        kinds : sequence of str, which features
        path : JointPath, n samples of d joints
        errors : (n, m) array, what the slack is to explain; NaN where unknown
        rows : (k,) int array, samples that may be learned from
        searched : bool
            Whether the coupled play is searched for, which takes most of the time; else it is a usual one, good enough
            to see whether joints are where an arm misses.

        Raises
        ------
        DataError
            A kind is unknown, or the log does not hold what it needs, or the motion shows nothing of it.
        """
        known: tuple[FeatureKind, ...] = get_args(FeatureKind)
        wrong = [kind for kind in kinds if kind not in known]
        if wrong or not kinds:
            raise DataError(f"features are {', '.join(known)}; got {', '.join(wrong) or 'none'}.")
        low, high = path.q[rows].min(axis=0), path.q[rows].max(axis=0)
        usual, _ = usual_steps(path)
        shortest = SHORTEST_LAG * usual
        features = cls(
            kinds=tuple(kind for kind in known if kind in kinds),
            centre=(low + high) / 2,
            half=np.maximum((high - low) / 2, 1e-12),
            play=None,
            lags=np.geomspace(shortest, max(LONGEST_LAG, 10 * shortest), LAGS),
            n_state=0 if path.state is None else path.state.shape[1],
            used=np.zeros(0, dtype=np.int64),
            rates=np.array(RATES) * usual,
        )
        if "effort" in kinds and path.effort is None:
            raise DataError(
                "effort is among the features, but the log has no efforts (measured_jf) for this direction.",
                hint="Leave effort out: --features position,velocity,memory",
            )
        features._check(path)
        scaled = features.scaled(path.q)
        turning = _turns_back(scaled, path.new)
        if "memory" in features.kinds:
            found = (scaled, errors, path.new, rows, turning)
            play = learn_coupled_play(*found) if searched else uncoupled_play(path.q.shape[1])
            features = replace(features, play=play)
        varied = _has_many_speeds(path.velocity[rows])
        shown = {
            "lags": np.tile(varied, LAGS * features.n_lagged),
            "memory": np.tile(turning, 1 + len(LADDER)),
            "velocity": varied,
            "acceleration": np.tile(varied, len(RATES)),
        }
        masks = [shown.get(kind, np.ones(size, dtype=bool)) for kind, size in features._sizes]
        used = np.flatnonzero(np.concatenate(masks))
        if {"lags", "acceleration"} & set(features.kinds):
            used = features._earned(path, errors, rows, used)
        if used.size == 0:
            raise DataError(
                f"this motion shows nothing of {', '.join(features.kinds)}: one speed, no turning back.",
                hint="Add position to the features, or record a speed ladder.",
            )
        return replace(features, used=used)

    def scaled(self, q: FloatArray) -> FloatArray:
        """Return joints `(..., d)` in units of half their ranges, from the middle.

        Parameters
        ----------
        q : (..., d) array, joints, rad or m
        """
        return (q - self.centre) / self.half

    def transform(self, path: JointPath) -> FloatArray:
        """Return features `(n, k)` of a path; rows with a missing number are NaN.

        Parameters
        ----------
        path : JointPath, n samples
        """
        self._check(path)
        return np.hstack([self._columns(kind, path) for kind in self.kinds])[:, self.used]

    def unsure(self, span: FloatArray) -> FloatArray | None:
        """Return by how much inputs `(..., k)` may be off on a path that has covered so much; None without `memory`.

        Where in its slack a joint lay when the path began is not known until the joint has crossed it: after a span s
        a play of radius r can still be in any place of r - s / 2 to either side; and joints pull on each other.

        Parameters
        ----------
        span : (..., d) array, between the ends of what each joint covered, in units of half the ranges
        """
        if self.play is None or "memory" not in self.kinds:
            return None
        alone = np.maximum(1 - span[..., None, :] / (2 * self.ladder), 0.0).reshape(*span.shape[:-1], -1)
        pull = np.abs(self.play.stiffness) / np.diagonal(self.play.stiffness)[:, None]
        slack = np.concatenate([np.maximum(self.play.gap - span / 2, 0.0) @ pull.T, alone], axis=-1)
        off = [slack if kind == "memory" else np.zeros((*span.shape[:-1], size)) for kind, size in self._sizes]
        return np.concatenate(off, axis=-1)[..., self.used]

    @property
    def smooth(self) -> IntArray:
        """Columns on which the error may depend in a curved way: no single plays, lags or accelerations."""
        first = {"memory": len(self.centre), "lags": 0, "acceleration": 0}
        curved = [np.arange(size) < first.get(kind, size) for kind, size in self._sizes]
        return np.flatnonzero(np.concatenate(curved)[self.used])

    @property
    def origins(self) -> tuple[NDArray[np.str_], IntArray]:
        """Kind, and index of the joint, of each column that is used; columns of `state` belong to no joint, -1."""
        dof = len(self.centre)
        kinds = np.concatenate([np.full(size, kind) for kind, size in self._sizes])
        owners = [np.full(size, -1) if kind == "state" else np.arange(size) % dof for kind, size in self._sizes]
        return kinds[self.used], np.concatenate(owners)[self.used]

    def remarks(self, numbers: Sequence[int]) -> tuple[str, ...]:
        """Return what the training motion could not separate, a sentence each.

        Parameters
        ----------
        numbers : sequence of int, of the d joints, counted from 1
        """
        why = {"velocity": "always moves at one speed", "memory": "hardly turns back"}
        used, start, sentences = set(self.used.tolist()), 0, []
        for kind, size in self._sizes:
            for joint, number in enumerate(numbers if kind in why else ()):
                if start + joint not in used:
                    sentences.append(f"joint {number} {why[kind]} in training: its {kind} is not used")
            start += size
        return tuple(sentences)

    @property
    def n_lagged(self) -> int:
        """Signals of each joint that `lags` follow: its position, and its effort where efforts are features."""
        return 2 if "effort" in self.kinds else 1

    def lagged_signals(self, scaled: FloatArray, effort: FloatArray | None) -> FloatArray:
        """Return what `lags` follow `(..., d)` or `(..., 2 d)`: scaled positions, then efforts.

        Parameters
        ----------
        scaled : (..., d) array, joints in units of half their ranges
        effort : (..., d) array or None, as logged
        """
        if self.n_lagged == 1:
            return scaled
        return np.concatenate([scaled, np.full(scaled.shape, np.nan) if effort is None else effort], axis=-1)

    def _earned(self, path: JointPath, errors: FloatArray, rows: IntArray, used: IntArray) -> IntArray:
        """Return the columns `used` without what does not pay: lags of efforts, those of positions, accelerations.

        They pay where some joint's errors in left-out parts are clearly better predicted with them, under the law's own
        penalties: what a lag says of an acceleration, for one, the law will not use.
        """
        dof, doubted = len(self.centre), []
        for kind, size in self._sizes:
            turn = self.n_lagged - np.arange(size) // dof % self.n_lagged  # 2 or 1 of positions, 1 of efforts
            doubted.append(turn if kind == "lags" else np.full(size, 3 if kind == "acceleration" else 0))
        group: IntArray = np.concatenate(doubted)[used]
        candidate = replace(self, used=used)
        X = candidate.transform(path)
        known = rows[np.isfinite(X[rows]).all(axis=1) & np.isfinite(errors[rows]).all(axis=1)]
        paid: BoolArray = group == 0
        if len(known) < LIMITS.fewest_samples:
            return used[paid]
        folds = np.arange(len(known)) * LIMITS.folds // len(known)
        penalties = np.where(candidate.origins[0] == "lags", SLOW, PLAIN)
        unit = (X[known] - X[known].mean(axis=0)) / np.maximum(X[known].std(axis=0), np.finfo(float).tiny)

        def squared(columns: BoolArray) -> FloatArray:
            return left_out_squares(unit[:, columns], errors[known], folds, penalties[columns])

        squares = squared(paid)
        for number in np.unique(group[~paid]):
            more = squared(paid | (group == number))
            if (more < CLEARLY * squares).any():
                paid, squares = paid | (group == number), more
        return used[paid]

    @property
    def _sizes(self) -> list[tuple[FeatureKind, int]]:
        """Kinds with their numbers of columns, before any is left out."""
        dof = len(self.centre)
        sizes = {"memory": dof * (1 + len(LADDER)), "lags": dof * LAGS * self.n_lagged, "state": self.n_state}
        sizes["acceleration"] = dof * len(self.rates)
        return [(kind, sizes.get(kind, dof)) for kind in self.kinds]

    def _columns(self, kind: FeatureKind, path: JointPath) -> FloatArray:
        scaled = self.scaled(path.q)
        match kind:
            case "position":
                return scaled
            case "velocity":
                return path.velocity / self.half
            case "acceleration":
                changes = lagged(path.velocity / self.half, path.time, path.new, self.rates)
                return (changes / self.rates[:, None]).reshape(len(scaled), -1)
            case "effort":
                assert path.effort is not None
                return path.effort
            case "memory":
                assert self.play is not None
                steps = np.diff(scaled, axis=0, prepend=scaled[:1])
                ladder = play_states(steps, self.ladder, np.cumsum(path.new)) / self.ladder
                return np.hstack([self.play.lags(scaled, path.new), ladder.reshape(len(scaled), -1)])
            case "lags":
                signals = self.lagged_signals(scaled, path.effort)
                return lagged(signals, path.time, path.new, self.lags).reshape(len(scaled), -1)
            case "state":
                assert path.state is not None
                return path.state

    def _check(self, path: JointPath) -> None:
        if path.q.shape[1] != len(self.centre):
            raise DataError(f"the model knows {len(self.centre)} joints, the log has {path.q.shape[1]}.")
        if "effort" in self.kinds and (path.effort is None or not np.isfinite(path.effort).any()):
            raise DataError(
                "the model looks at efforts (measured_jf), and none came with the joints.",
                hint="Send the effort of every joint, or ask for a model that was fitted without them.",
            )
        if "state" in self.kinds and (0 if path.state is None else path.state.shape[1]) != self.n_state:
            raise DataError("the log's state has other columns than the model was trained with.")


def law_penalties(features: JointFeatures, targets: int, owned: bool) -> FloatArray:
    """Return the penalties `(k, m)` of the features' weights in the linear law of each target.

    Along one straight stripe all joints turn back together, and their efforts and slacks cannot be separated; a law
    without a prior spreads one joint's friction over all of them, and is wrong wherever joints move on their own, or
    under another load. So where efforts are logged, those of other joints, and memory, are penalised.

    Parameters
    ----------
    features : JointFeatures, with k columns
    targets : int, m
    owned : bool, whether each target is the error of the joint of its number
    """
    kinds, owners = features.origins
    penalties = np.full((len(kinds), targets), PLAIN)
    penalties[kinds == "lags"] = SLOW
    if "effort" not in features.kinds or not owned:
        return penalties
    past = np.isin(kinds, ("velocity", "acceleration", "memory"))
    penalties[past] = REMEMBERED
    foreign = owners[:, None] != np.arange(targets)
    penalties[(past | np.isin(kinds, ("effort", "lags")))[:, None] & foreign] = OTHERS
    return penalties


def _turns_back(path: FloatArray, new: BoolArray) -> BoolArray:
    """Return which joints `(d,)` of a path `(n, d)`, in half ranges, turn back often enough to show their slack."""
    steps = np.diff(path, axis=0, prepend=path[:1])
    states = play_states(steps, np.full((1, path.shape[1]), SLACK), np.cumsum(new))[:, 0]
    sides = [column[np.abs(column) > 0.99 * SLACK] > 0 for column in states.T]
    return np.array([np.count_nonzero(side[1:] != side[:-1]) >= FEWEST_TURNS for side in sides])


def _has_many_speeds(velocity: FloatArray) -> BoolArray:
    """Return which joints `(d,)` of velocities `(n, d)` move at speeds far enough apart."""
    ratios = []
    for speed in np.abs(velocity).T:
        moving = speed[speed > MOVING * speed.max()]
        low, high = np.percentile(moving, (25, 75)) if moving.size else (1.0, 1.0)
        ratios.append(high / low)
    return np.array(ratios) >= LEAST_SPEEDS
