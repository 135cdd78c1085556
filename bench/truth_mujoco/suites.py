"""The protocol's sets: which arm, cause, size and sensors each seed stands for."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from truth.suites import RATIOS, chance, drawn, joint_causes, sessions_of, short

from truth_mujoco.causes import AHEAD, CATALOGUE, OUTSIDE, cause_named
from truth_mujoco.causes.masses import CAUSES as MASSES
from truth_mujoco.spec import Signals, Spec

__all__ = ["RATIOS", "SUITES", "short", "specs"]

SENSORS: dict[str, tuple[Signals, ...]] = {
    "everything": ("joints", "tracker", "both"),
    "tracker_only": ("tracker", "both"),
    "encoders": ("joints", "both"),  # its size is measured on joint sensors
}


def _scene(names: tuple[str, ...], rng: np.random.Generator) -> tuple[str, Signals]:
    """Arm and sensors: any that can show the causes."""
    causes = [cause_named(n) for n in names]
    kind = "everything"
    if any(c.channel != "outside" for c in causes):
        kind = "encoders"
    if any(c.tracker_only for c in causes):
        kind = "tracker_only"
    if all(c.bare for c in causes) and rng.random() < 0.25:
        return "ur5", "bare"
    arm = "raven2_left" if rng.random() < 0.6 else "dvrk_psm"
    if {"length_dependent_stiffness", "capstan_friction", *MASSES} & set(names):
        arm = "raven2_left"  # whose links weigh on their joints
    choice = SENSORS[kind]
    return arm, choice[int(rng.integers(len(choice)))]


def _null(seed: int) -> Spec:
    rng = chance(seed, "null")
    arm, signals = _scene((), rng)
    return Spec("null", arm, signals=signals, sessions=int(rng.choice([1, 1, 2])))


def _in_turn(suite: str, names: tuple[str, ...], ratios: tuple[float, ...]) -> Callable[[int], Spec]:
    """Causes in turn, each at the sizes in turn."""

    def make(seed: int) -> Spec:
        rng = chance(seed, suite)
        name, ratio = names[seed % len(names)], ratios[seed // len(names) % len(ratios)]
        sessions = sessions_of(name, rng)
        arm, signals = _scene((name,), rng)
        return Spec(suite, arm, (name,), ratio, signals, sessions)

    return make


def _pairs(seed: int) -> Spec:
    rng = chance(seed, "pairs")
    names = tuple(str(n) for n in rng.choice(joint_causes(CATALOGUE), 2, replace=False))
    arm, signals = _scene(names, rng)
    return Spec("pairs", arm, names, RATIOS[int(rng.integers(2))], signals, int(rng.choice([1, 1, 2])))


SUITES: dict[str, Callable[[int], Spec]] = {
    "null": _null,
    "one": _in_turn("one", tuple(CATALOGUE), RATIOS),
    "ahead": _in_turn("ahead", tuple(AHEAD), RATIOS[:2]),
    "pairs": _pairs,
    "outside": _in_turn("outside", tuple(OUTSIDE), RATIOS[:2]),
}
specs = partial(drawn, SUITES)
