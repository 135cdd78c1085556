"""What the reproduced papers report: the figures that were at hand, each with where it stands.

Only ratios of Mahler's Tables I and II and none of Peng's 2024 tables were at hand; what is not listed here is left out
of the comparison, not guessed. "As quoted to this project" means that the figure was given without the page it is on.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

__all__ = [
    "MAHLER_2014",
    "MAHLER_MISSING",
    "PENG_2020",
    "PENG_2020_MISSING",
    "PENG_2024",
    "PENG_MISSING",
    "Figures",
    "Source",
]


class Source(StrEnum):
    """Where a figure stands."""

    ABSTRACT = "abstract of the paper"
    DRAFT = "abstract of an earlier draft (April 2014)"
    TABLE_I = "Table I, dirty set, as quoted to this project"
    FIG_5 = "Fig. 5, as quoted to this project"
    QUOTED = "as quoted to this project"


@dataclass(frozen=True)
class Figures:
    """Published numbers that belong together: what they are of, their unit, and where they stand."""

    values: tuple[float, ...]
    of: str
    unit: str
    source: Source


def _mahler(value: float, unit: str, source: Source) -> Figures:
    return Figures((value,), "", unit, source)


MAHLER_2014 = {
    "position_raw": _mahler(26.0, "mm", Source.ABSTRACT),
    "position_corrected": _mahler(2.0, "mm", Source.ABSTRACT),
    "rotation_raw": _mahler(20.6, "deg", Source.ABSTRACT),
    "rotation_corrected": _mahler(2.8, "deg", Source.ABSTRACT),
    "position_percent_of_raw_dirty": _mahler(9.8, "%", Source.TABLE_I),
    "rotation_percent_of_raw_dirty": _mahler(10.4, "%", Source.TABLE_I),
    "position_gain_of_velocity": _mahler(50.0, "%", Source.DRAFT),
    "rotation_gain_of_velocity": _mahler(21.0, "%", Source.DRAFT),
    "fit_seconds_460_states": _mahler(18.6, "s", Source.FIG_5),
    "fit_seconds_all_states": _mahler(4228.8, "s", Source.FIG_5),
}
"""Mahler, Krishnan, Laskey, Sen, Murali, Kehoe, Patil, Wang, Franklin, Abbeel, Goldberg: "Learning accurate kinematic
control of cable-driven surgical robots using data cleaning and Gaussian Process Regression", CASE 2014."""

MAHLER_MISSING = (
    "the six components of Table I one by one, and the standard deviations",
    "the errors of Fig. 5 (its two fitting times are here)",
    "all of Table II",
)

PENG_2020 = {
    "single_ball_rms_mm": 0.99,
    "end_effector_rms_mm": 0.53,
    "rms_reduction_percent": 83.6,
    "sd_reduction_percent": 59.4,
}
"""Peng et al.: "Real-time data driven precision estimator for RAVEN-II surgical robot end effector position", 2020; as
quoted to this project."""

PENG_2020_MISSING = "Table I axis by axis, and the errors in mm behind the two reductions"  # of what is compared

PENG_2024 = {
    "raw": Figures((2.0, 8.0, 11.7), "RMSE of joints 1, 2, 3 as reported", "deg, deg, mm", Source.QUOTED),
    "fixed_offset": Figures(
        (0.87, 1.1, 0.5), "RMSE of joints 1, 2, 3 after a fixed offset", "deg, deg, mm", Source.QUOTED
    ),
    "network": Figures(
        (0.104, 0.120, 0.118), "error of joints 1, 2, 3 after the network", "deg, deg, mm", Source.ABSTRACT
    ),
    "network_share": Figures(
        (12.0, 11.0, 24.0), "the network's, of the fixed offset's, joints 1, 2, 3", "%", Source.QUOTED
    ),
    "reduction": Figures(
        (76.0,), "of the fixed offset's error that the network takes away further", "%", Source.ABSTRACT
    ),
    "minutes": Figures((8.0, 21.0), "the whole calibration, shortest and longest", "min", Source.ABSTRACT),
    "drift": Figures((0.4, 0.75), "joint 1 after 6 h, unloaded and under 500 g", "deg", Source.QUOTED),
    "inference": Figures((61.0, 0.38), "an estimate by the network and by linear regression", "ms", Source.QUOTED),
    "speedup": Figures((160.0,), "linear regression over the network, inference", "times", Source.ABSTRACT),
}
"""Peng, Lewis, Su, Lin, Chiang, Jiang, Lai, Hannaford: "Efficient data-driven joint-level calibration of cable-driven
surgical robots", npj Robotics 2 (2024), arXiv 2408.01604. The two inference times are quoted without their methods; the
abstract's factor of 160 between them names these."""

PENG_MISSING = (
    "Table I by direction and method",
    "the curves of Figs. 5, 6, 8 and 9 (but of Fig. 6 the ends for joint 1, and of Fig. 9 that a homing shifts joint 2 "
    "by a few tenths of a degree)",
    "the numbers of Tables II, III and IV",
    "the fitting times of Table V",
)
