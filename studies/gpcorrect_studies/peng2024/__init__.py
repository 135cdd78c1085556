"""Peng et al. 2024: joint-level calibration of a RAVEN-II on simulated recordings."""

from gpcorrect_studies.peng2024.fits import PengScope
from gpcorrect_studies.peng2024.recordings import RavenStudy
from gpcorrect_studies.peng2024.study import Peng2024, reproduce_peng2024

__all__ = ["Peng2024", "PengScope", "RavenStudy", "reproduce_peng2024"]
