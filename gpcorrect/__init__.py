"""Learns how a cable-driven robot misses its commanded pose, and tells the planner what to command instead.

>>> import gpcorrect
>>> corrector = gpcorrect.fit_corrector(gpcorrect.read_log("reaches.csv"))  # doctest: +SKIP
>>> answer = corrector.correct([0.1, 0.02, -0.11, 1, 0, 0, 0])  # doctest: +SKIP
>>> gpcorrect.save(corrector, "model.gpc")  # doctest: +SKIP
"""

from importlib.metadata import version

from gpcorrect.artifact import load, save
from gpcorrect.corrector import CommandCorrector, FitSettings, PathCorrection, fit_corrector
from gpcorrect.errors import GpCorrectError
from gpcorrect.logs import read_log, validate_log, write_log
from gpcorrect.types import CalibrationLog, Correction, PoseSignal

__all__ = [
    "CalibrationLog",
    "CommandCorrector",
    "Correction",
    "FitSettings",
    "GpCorrectError",
    "PathCorrection",
    "PoseSignal",
    "fit_corrector",
    "load",
    "read_log",
    "save",
    "validate_log",
    "write_log",
]

__version__ = version("gpcorrect")
