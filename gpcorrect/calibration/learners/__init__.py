"""Learners by name: a new one is a file here and a line in the registry."""

from gpcorrect.calibration.learners.auto import Auto, MixedMap
from gpcorrect.calibration.learners.gp import GP, GPMap
from gpcorrect.calibration.learners.learner import Fitted, Learner, TargetMap
from gpcorrect.calibration.learners.network import Network, NetworkMap
from gpcorrect.calibration.learners.polynomial import Polynomial, PolynomialMap, Scaler
from gpcorrect.calibration.learners.trees import Trees, TreesMap
from gpcorrect.calibration.learners.ukf import Cable, CableFilter, CableModel
from gpcorrect.errors import DataError

__all__ = [
    "LEARNERS",
    "CableFilter",
    "CableModel",
    "Fitted",
    "GPMap",
    "Learner",
    "MixedMap",
    "NetworkMap",
    "PolynomialMap",
    "Scaler",
    "TargetMap",
    "TreesMap",
    "learner_named",
]

LEARNERS: dict[str, Learner] = {
    "offset": Polynomial(0),
    "linear": Polynomial(1),
    "quadratic": Polynomial(2),
    "network": Network(),
    "ukf": Cable(),
    "gp": GP(),
    "trees": Trees(),
    "auto": Auto(),
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
