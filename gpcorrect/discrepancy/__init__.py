"""Where a simulator and recordings disagree: the missing effect by name, or an honest answer that none can be given.

from gpcorrect.discrepancy import find_discrepancy

result = find_discrepancy(model, log)
result.level, [effect.name for effect in result.effects], result.to_report()
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from gpcorrect.lazy import imported_on_demand

if TYPE_CHECKING:
    from gpcorrect.discrepancy.naming.posterior import Level
    from gpcorrect.discrepancy.outcome.result import DiscrepancyResult, NamedEffect, Verdict
    from gpcorrect.discrepancy.run import find_discrepancy

__all__ = ["DiscrepancyResult", "Level", "NamedEffect", "Verdict", "find_discrepancy"]

__getattr__ = imported_on_demand(
    __name__,
    {
        "naming.posterior": "Level",
        "outcome.result": "DiscrepancyResult NamedEffect Verdict",
        "run": "find_discrepancy",
    },
)
