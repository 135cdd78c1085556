"""What the paper says of itself: the figures that were at hand, each with where it stands.

Mahler, Krishnan, Laskey, Sen, Murali, Kehoe, Patil, Wang, Franklin, Abbeel, Goldberg: "Learning accurate kinematic
control of cable-driven surgical robots using data cleaning and Gaussian Process Regression", CASE 2014. Of its Tables
I and II only the ratios below were at hand; what is not listed here is left out of the comparison, not guessed.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["MAHLER_2014", "MISSING", "Figure"]

ABSTRACT = "abstract of the paper"
DRAFT = "abstract of an earlier draft (April 2014)"
TABLE_I = "Table I, dirty set, as quoted to this project"
FIG_5 = "Fig. 5, as quoted to this project"


@dataclass(frozen=True)
class Figure:
    """One published number, its unit, and where it stands."""

    value: float
    unit: str
    source: str


MAHLER_2014 = {
    "position_raw": Figure(26.0, "mm", ABSTRACT),
    "position_corrected": Figure(2.0, "mm", ABSTRACT),
    "rotation_raw": Figure(20.6, "deg", ABSTRACT),
    "rotation_corrected": Figure(2.8, "deg", ABSTRACT),
    "position_percent_of_raw_dirty": Figure(9.8, "%", TABLE_I),
    "rotation_percent_of_raw_dirty": Figure(10.4, "%", TABLE_I),
    "position_gain_of_velocity": Figure(50.0, "%", DRAFT),
    "rotation_gain_of_velocity": Figure(21.0, "%", DRAFT),
    "fit_seconds_460_states": Figure(18.6, "s", FIG_5),
    "fit_seconds_all_states": Figure(4228.8, "s", FIG_5),
}

MISSING = (
    "the six components of Table I one by one, and the standard deviations",
    "the errors of Fig. 5 (its two fitting times are here)",
    "all of Table II",
)
