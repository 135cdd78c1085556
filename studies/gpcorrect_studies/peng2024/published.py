"""What the RAVEN-II joint calibration study says of itself: the figures that were at hand, each with where it stands.

Peng, Lewis, Su, Lin, Chiang, Jiang, Lai, Hannaford: "Efficient data-driven joint-level calibration of cable-driven
surgical robots", npj Robotics 2 (2024), arXiv 2408.01604. Its tables were not at hand, only what is listed here; the
rest is left out of the comparison, not guessed.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["PENG_2024", "PENG_MISSING", "Figures"]

ABSTRACT = "abstract of the paper"
QUOTED = "as quoted to this project"


@dataclass(frozen=True)
class Figures:
    """Published numbers that belong together, what they are of, their unit, and where they stand."""

    values: tuple[float, ...]
    of: str
    unit: str
    source: str


JOINTS = "joints 1, 2, 3"
LENGTHS = "deg, deg, mm"

PENG_2024 = {
    "raw": Figures((2.0, 8.0, 11.7), f"RMSE of {JOINTS} as reported", LENGTHS, QUOTED),
    "fixed_offset": Figures((0.87, 1.1, 0.5), f"RMSE of {JOINTS} after a fixed offset", LENGTHS, QUOTED),
    "network": Figures((0.104, 0.120, 0.118), f"error of {JOINTS} after the network", LENGTHS, ABSTRACT),
    "network_share": Figures((12.0, 11.0, 24.0), f"the network's, of the fixed offset's, {JOINTS}", "%", QUOTED),
    "reduction": Figures((76.0,), "of the fixed offset's error that the network takes away further", "%", ABSTRACT),
    "minutes": Figures((8.0, 21.0), "the whole calibration, shortest and longest", "min", ABSTRACT),
    "drift": Figures((0.4, 0.75), "joint 1 after 6 h, unloaded and under 500 g", "deg", QUOTED),
    "inference": Figures((61.0, 0.38), "an estimate by the network and by linear regression", "ms", QUOTED),
    "speedup": Figures((160.0,), "linear regression over the network, inference", "times", ABSTRACT),
}
"""The two inference times are quoted without their methods; the abstract's factor of 160 between them names these."""

PENG_MISSING = (
    "Table I by direction and method",
    "the curves of Figs. 5, 6, 8 and 9 (but of Fig. 6 the ends for joint 1, and of Fig. 9 that a homing shifts joint 2 "
    "by a few tenths of a degree)",
    "the numbers of Tables II, III and IV",
    "the fitting times of Table V",
)
