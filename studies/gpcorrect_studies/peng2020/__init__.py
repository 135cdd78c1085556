"""Peng et al. 2020: ground truth from four webcams, and a position estimator learned from it."""

from gpcorrect_studies.peng2020.study import Peng2020, Peng2020Scope, calibrated_cameras, reproduce_peng2020

__all__ = ["Peng2020", "Peng2020Scope", "calibrated_cameras", "reproduce_peng2020"]
