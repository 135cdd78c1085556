"""Recordings with hidden causes, made by MuJoCo: the second truth of the blind protocol.

Seeds 1 to 9999 are for development; a published run uses seeds from 500000, which nobody looks at before it.
"""

from truth_mujoco.case import make_case, make_truth
from truth_mujoco.causes import AHEAD, CATALOGUE, OUTSIDE
from truth_mujoco.spec import Spec
from truth_mujoco.suites import RATIOS, SUITES, short, specs

__all__ = ["AHEAD", "CATALOGUE", "OUTSIDE", "RATIOS", "SUITES", "Spec", "make_case", "make_truth", "short", "specs"]
