"""Learns the residual a second time, with memory features, and says what they brought."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.corrector.bounds import Bounds
from gpcorrect.corrector.joint_map import JointMap
from gpcorrect.corrector.memory import History, MemoryMap, choose_memory
from gpcorrect.corrector.recall import Recall
from gpcorrect.corrector.residual_model import ResidualModel, trajectory_folds
from gpcorrect.types import FloatArray, IntArray

__all__ = ["Samples", "learn_recall", "memory_remark"]

WORTH_IT = 0.02  # least share of the error that memory must take away not to be called useless
Learn = Callable[[FloatArray, tuple[tuple[int, ...], ...]], ResidualModel]


@dataclass(frozen=True, eq=False)
class Samples:
    """What the residual is learned from.

    Parameters
    ----------
    X : (n, d) array
        Features of pose and velocity, whose columns act by `groups`.
    groups : tuple of tuples of int
    residual : (n, 6) array
        NaN in the rotation of a position-only log.
    history : History
        The same samples as memory sees them, along paths that may hold several trajectories.
    trajectory : (n,) array
    """

    X: FloatArray
    groups: tuple[tuple[int, ...], ...]
    residual: FloatArray
    history: History
    trajectory: IntArray


def learn_recall(
    samples: Samples, joints: JointMap | None, without: ResidualModel, bounds: Bounds, learn: Learn
) -> tuple[Recall, ResidualModel]:
    """Return what was learned with memory features chosen by what they explain of the errors `without` them."""
    candidates = (None,) if joints is None else (None, joints)
    memory = choose_memory(candidates, samples.history, without.errors, trajectory_folds(samples.trajectory))
    width = samples.X.shape[1]
    X = np.hstack([samples.X, memory.transform(samples.history)])
    learned = learn(X, (*samples.groups, tuple(range(width, width + memory.size))))
    bounds = replace(bounds, novelty=learned.novelty)
    return Recall(memory, learned.predictor, learned.intervals, bounds, learned.statistics), learned


def memory_remark(memory: MemoryMap, without: ResidualModel, learned: ResidualModel) -> str:
    """Say what the memory acts on and how it changed the errors at left-out training trajectories."""
    change = np.sqrt((learned.errors**2).mean(axis=0) / (without.errors**2).mean(axis=0)) - 1.0
    parts = zip(("position", "rotation"), change.reshape(-1, 3).mean(axis=1), strict=False)
    said = ", ".join(f"{100 * value:+.0f} % in {name}" for name, value in parts)
    verdict = "" if change.mean() <= -WORTH_IT else ": not worth its time here, features pose,velocity do as well"
    return f"memory acts on the {memory.acts_on}; error at left-out trajectories {said}{verdict}"
