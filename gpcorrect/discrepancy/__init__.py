"""Where a simulator and recordings disagree: the missing effect by name, or an honest answer that none can be given.

from gpcorrect.discrepancy import find_discrepancy

result = find_discrepancy(model, log)
result.level, [effect.name for effect in result.effects], result.to_report()
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gpcorrect.discrepancy.naming.posterior import Level
    from gpcorrect.discrepancy.outcome.result import DiscrepancyResult, NamedEffect, Verdict
    from gpcorrect.discrepancy.run import find_discrepancy

__all__ = ["DiscrepancyResult", "Level", "NamedEffect", "Verdict", "find_discrepancy"]

PLACES = {
    "DiscrepancyResult": "outcome.result",
    "Level": "naming.posterior",
    "NamedEffect": "outcome.result",
    "Verdict": "outcome.result",
    "find_discrepancy": "run",
}


def __getattr__(name: str) -> object:
    """Import a public name when it is asked for: the simulator and numba take their time."""
    if name not in PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{PLACES[name]}"), name)
