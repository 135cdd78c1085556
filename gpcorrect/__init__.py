"""Learns how a cable-driven robot misses its commanded pose, and tells the planner what to command instead.

>>> import gpcorrect
>>> corrector = gpcorrect.fit_corrector(gpcorrect.read_log("reaches.csv"))  # doctest: +SKIP
>>> answer = corrector.correct([0.1, 0.02, -0.11, 1, 0, 0, 0])  # doctest: +SKIP
>>> gpcorrect.save(corrector, "model.gpc")  # doctest: +SKIP

Names are imported when they are first used (PEP 562), so that `import gpcorrect` costs next to nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gpcorrect.lazy import imported_on_demand

if TYPE_CHECKING:
    from gpcorrect.calibration import (
        CommandCorrector,
        FitSettings,
        JointCorrector,
        fit_corrector,
        fit_model,
        load,
        save,
    )
    from gpcorrect.correction import Correction, Reason, Status
    from gpcorrect.errors import GpCorrectError
    from gpcorrect.logs import read_log, validate_log, write_log
    from gpcorrect.types import CalibrationLog, PoseSignal

    __version__: str

__all__ = [
    "CalibrationLog",
    "CommandCorrector",
    "Correction",
    "FitSettings",
    "GpCorrectError",
    "JointCorrector",
    "PoseSignal",
    "Reason",
    "Status",
    "fit_corrector",
    "fit_model",
    "load",
    "read_log",
    "save",
    "validate_log",
    "write_log",
]

_find = imported_on_demand(
    __name__,
    {
        "calibration": "CommandCorrector FitSettings JointCorrector fit_corrector fit_model load save",
        "correction": "Correction Reason Status",
        "errors": "GpCorrectError",
        "logs": "read_log validate_log write_log",
        "types": "CalibrationLog PoseSignal",
    },
)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # reads the installed package's files

        return version("gpcorrect")
    return _find(name)


def __dir__() -> list[str]:
    return [*globals(), *__all__, "__version__"]
