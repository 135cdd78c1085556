"""Learns how a cable-driven robot misses its commanded pose, and tells the planner what to command instead.

>>> import gpcorrect
>>> corrector = gpcorrect.fit_corrector(gpcorrect.read_log("reaches.csv"))  # doctest: +SKIP
>>> answer = corrector.correct([0.1, 0.02, -0.11, 1, 0, 0, 0])  # doctest: +SKIP
>>> gpcorrect.save(corrector, "model.gpc")  # doctest: +SKIP

Names are imported when they are first used (PEP 562), so that `import gpcorrect` costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

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

_MODULES = {
    "CalibrationLog": "types",
    "CommandCorrector": "calibration",
    "Correction": "correction",
    "FitSettings": "calibration",
    "GpCorrectError": "errors",
    "JointCorrector": "calibration",
    "PoseSignal": "types",
    "Reason": "correction",
    "Status": "correction",
    "fit_corrector": "calibration",
    "fit_model": "calibration",
    "load": "calibration",
    "read_log": "logs",
    "save": "calibration",
    "validate_log": "logs",
    "write_log": "logs",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # reads the installed package's files

        return version("gpcorrect")
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"gpcorrect.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*globals(), *__all__, "__version__"]
