"""The protocol's sets: which arm, cause, size and sensors each seed stands for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from truth_mujoco.causes import AHEAD, CATALOGUE, OUTSIDE, cause_named
from truth_mujoco.spec import Signals, Spec

RATIOS = (2.0, 1.0, 0.5, 0.25)
TOGETHER = tuple(
    n for n, c in CATALOGUE.items() if not c.tracker_only and n not in ("noise_change", "encoder_quantisation")
)
SENSORS: dict[str, tuple[Signals, ...]] = {
    "everything": ("joints", "tracker", "both"),
    "tracker_only": ("tracker", "both"),
    "encoders": ("joints", "both"),  # its size is measured on joint sensors
}


def specs(suite: str, number: int, first_seed: int) -> Iterator[tuple[Spec, int]]:
    """Yield `number` wishes of a suite with their seeds, from `first_seed` on; a seed always means the same case.

    Raises
    ------
    KeyError
        There is no such suite.
    """
    make = SUITES[suite]
    for seed in range(first_seed, first_seed + number):
        yield make(seed), seed


def short(spec: Spec) -> Spec:
    """Return the same wish with 12 trajectories of 10 s."""
    return replace(spec, trajectories=12, seconds=10.0)


def _chance(seed: int, suite: str) -> np.random.Generator:
    return np.random.default_rng([seed, len(suite), *suite.encode()])


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
    if "length_dependent_stiffness" in names or "capstan_friction" in names:
        arm = "raven2_left"  # whose links weigh on their joints
    choice = SENSORS[kind]
    return arm, choice[int(rng.integers(len(choice)))]


def _null(seed: int) -> Spec:
    rng = _chance(seed, "null")
    arm, signals = _scene((), rng)
    return Spec("null", arm, signals=signals, sessions=int(rng.choice([1, 1, 2])))


def _in_turn(suite: str, names: tuple[str, ...], ratios: tuple[float, ...]) -> Callable[[int], Spec]:
    """Causes in turn, each at the sizes in turn."""

    def make(seed: int) -> Spec:
        rng = _chance(seed, suite)
        name, ratio = names[seed % len(names)], ratios[seed // len(names) % len(ratios)]
        sessions = 2 if name == "homing_offset" or rng.random() < 0.25 else 1
        arm, signals = _scene((name,), rng)
        return Spec(suite, arm, (name,), ratio, signals, sessions)

    return make


def _pairs(seed: int) -> Spec:
    rng = _chance(seed, "pairs")
    names = tuple(str(n) for n in rng.choice(TOGETHER, 2, replace=False))
    arm, signals = _scene(names, rng)
    return Spec("pairs", arm, names, RATIOS[int(rng.integers(2))], signals, int(rng.choice([1, 1, 2])))


SUITES: dict[str, Callable[[int], Spec]] = {
    "null": _null,
    "one": _in_turn("one", tuple(CATALOGUE), RATIOS),
    "ahead": _in_turn("ahead", tuple(AHEAD), RATIOS[:2]),
    "pairs": _pairs,
    "outside": _in_turn("outside", tuple(OUTSIDE), RATIOS[:2]),
}
