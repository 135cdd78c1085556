"""Published studies, done again on simulated data, each beside its own figures."""

from gpcorrect.reproduce.mahler2014 import COMPARABLE, NOT_COMPARABLE, Mahler2014, Scope, reproduce_mahler2014

__all__ = ["COMPARABLE", "NOT_COMPARABLE", "Mahler2014", "Scope", "reproduce_mahler2014"]
