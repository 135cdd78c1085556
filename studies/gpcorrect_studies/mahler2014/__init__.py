"""Mahler et al. 2014: the paper's tables and figures on a simulated recording."""

from gpcorrect_studies.mahler2014.study import Mahler2014, Scope, reproduce_mahler2014

__all__ = ["Mahler2014", "Scope", "reproduce_mahler2014"]
