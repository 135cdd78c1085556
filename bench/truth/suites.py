"""The protocol's sets: which cause, size, motion and sensors each seed stands for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from truth.kinds import CATALOGUE, OUTSIDE, kind_named
from truth.kinds.kind import Cause
from truth.spec import AWKWARD, Spec

RATIOS = (2.0, 1.0, 0.5, 0.25)
# What constant-speed runs of one payload show at all; the rest would be hidden from everyone
ZIGZAG = (
    "homing_offset", "transmission_ratio", "cable_coupling", "pulley_eccentricity", "cable_stretch", "gravity_sag",
    "backlash", "coulomb_friction", "viscous_friction", "hysteresis", "drift", "delay", "cable_slip",
)  # fmt: skip


def joint_causes(catalogue: Mapping[str, Cause]) -> tuple[str, ...]:
    """Return the causes that may be hidden together: those that joint sensors see, and that are no noise."""
    noise = ("noise_change", "encoder_quantisation")
    return tuple(n for n, k in catalogue.items() if not k.tracker_only and n not in noise)


def drawn(suites: Mapping[str, Callable[[int], Any]], suite: str, number: int, first: int) -> Iterator[tuple[Any, int]]:
    """Yield `number` wishes of a suite with their seeds, from `first` on; a seed always means the same case."""
    for seed in range(first, first + number):
        yield suites[suite](seed), seed


def sessions_of(name: str, rng: np.random.Generator) -> int:
    """Return how many sessions a recording with one cause has; a zero set anew shows in two."""
    return 2 if name == "homing_offset" or rng.random() < 0.25 else 1


def short(spec: Any) -> Any:
    """Return the same wish with 12 trajectories of 10 s, for tests."""
    return replace(spec, trajectories=12, seconds=10.0)


def chance(seed: int, suite: str) -> np.random.Generator:
    return np.random.default_rng([seed, len(suite), *suite.encode()])


def _sensors(name: str, rng: np.random.Generator) -> str:
    """Signals for a cause: the only ones that see it, else mostly joints."""
    kind = kind_named(name)
    if kind.tracker_only:
        return "tracker"
    if kind.channel != "outside":
        return "bare" if rng.random() < 0.2 else "joints"
    draw = rng.random()
    return "tracker" if draw < 0.15 else "bare" if draw < 0.3 and kind.bare else "joints"


def _null(seed: int) -> Spec:
    rng = chance(seed, "null")
    return Spec(
        "null",
        signals=str(rng.choice(["joints", "joints", "tracker", "bare"])),
        motion=str(rng.choice(["separating", "separating", "zigzag"])),
        sessions=int(rng.choice([1, 1, 2])),
    )


def _null_awkward(seed: int) -> Spec:
    return replace(_null(seed), suite="null_awkward", awkward=AWKWARD[seed % len(AWKWARD)])


def _one(seed: int) -> Spec:
    """Effects in turn, each at the four sizes in turn."""
    rng = chance(seed, "one")
    names = tuple(CATALOGUE)
    name = names[seed % len(names)]
    ratio = RATIOS[seed // len(names) % len(RATIOS)]
    sessions = sessions_of(name, rng)
    return Spec("one", (name,), ratio, _sensors(name, rng), sessions=sessions)


def _zigzag(seed: int) -> Spec:
    rng = chance(seed, "zigzag")
    signals = "joints" if rng.random() < 0.8 else "tracker"
    ratio = RATIOS[int(rng.integers(2))]
    return Spec("zigzag", (ZIGZAG[seed % len(ZIGZAG)],), ratio, signals, motion="zigzag")


def _several(suite: str, number: int) -> Callable[[int], Spec]:
    def make(seed: int) -> Spec:
        rng = chance(seed, suite)
        names = tuple(str(n) for n in rng.choice(joint_causes(CATALOGUE), number, replace=False))
        return Spec(suite, names, RATIOS[int(rng.integers(2))], sessions=int(rng.choice([1, 1, 2])))

    return make


def _outside(seed: int) -> Spec:
    rng = chance(seed, "outside")
    names = tuple(OUTSIDE)
    name = names[seed % len(names)]
    return Spec("outside", (name,), RATIOS[int(rng.integers(2))], _sensors(name, rng))


def _advised(seed: int) -> Spec:
    """Cases of which many are ambiguous at first: poor motion, or weak effects."""
    if seed % 2:
        return replace(_zigzag(seed // 2), suite="advised")
    rng = chance(seed, "advised")
    names = tuple(n for n, k in CATALOGUE.items() if k.channel == "outside" and not k.tracker_only)
    return Spec("advised", (names[seed // 2 % len(names)],), RATIOS[1 + int(rng.integers(3))])


SUITES: dict[str, Callable[[int], Spec]] = {
    "null": _null,
    "null_awkward": _null_awkward,
    "one": _one,
    "zigzag": _zigzag,
    "pairs": _several("pairs", 2),
    "triples": _several("triples", 3),
    "outside": _outside,
    "advised": _advised,
}
specs = partial(drawn, SUITES)
