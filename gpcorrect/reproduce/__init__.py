"""Published studies, done again on simulated data, each beside its own figures."""

from gpcorrect.reproduce.mahler2014 import Mahler2014, Scope, reproduce_mahler2014

__all__ = ["Mahler2014", "Scope", "reproduce_mahler2014"]
