"""Learners by name: a new one is a file here and a line in the registry."""

from functools import partial

from gpcorrect.calibration.learners.auto import MixedMap, learn_mixture
from gpcorrect.calibration.learners.gp import GPMap, learn_gp
from gpcorrect.calibration.learners.learner import Learner
from gpcorrect.calibration.learners.network import NetworkMap, learn_network
from gpcorrect.calibration.learners.polynomial import PolynomialMap, learn_polynomial
from gpcorrect.calibration.learners.trees import TreesMap, learn_trees
from gpcorrect.calibration.learners.ukf import CableModel, learn_cable
from gpcorrect.errors import DataError

__all__ = ["LEARNERS", "CableModel", "GPMap", "MixedMap", "NetworkMap", "PolynomialMap", "TreesMap", "learner_named"]

LEARNERS: dict[str, Learner] = {
    "offset": partial(learn_polynomial, 0),
    "linear": partial(learn_polynomial, 1),
    "quadratic": partial(learn_polynomial, 2),
    "network": learn_network,
    "ukf": learn_cable,
    "gp": learn_gp,
    "trees": learn_trees,
    "auto": learn_mixture,
}


def learner_named(name: str) -> Learner:
    """Return the learner of that name.

    Parameters
    ----------
    name : str, A key of :data:`LEARNERS`

    Raises
    ------
    DataError
        There is none.
    """
    if name not in LEARNERS:
        raise DataError(f"a method is one of {', '.join(LEARNERS)}; got {name!r}.")
    return LEARNERS[name]
