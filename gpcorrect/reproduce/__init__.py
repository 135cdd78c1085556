"""Published studies, done again on simulated data, each beside its own figures."""

from gpcorrect.reproduce.mahler2014 import COMPARABLE, NOT_COMPARABLE, Mahler2014, Scope, reproduce_mahler2014
from gpcorrect.reproduce.peng2020 import Peng2020Scope, reproduce_peng2020
from gpcorrect.reproduce.peng2024 import PENG_COMPARABLE, PENG_NOT_COMPARABLE, Peng2024, reproduce_peng2024
from gpcorrect.reproduce.peng_bench import PengScope
from gpcorrect.reproduce.raven_runs import RavenStudy

__all__ = [
    "COMPARABLE",
    "NOT_COMPARABLE",
    "PENG_COMPARABLE",
    "PENG_NOT_COMPARABLE",
    "Mahler2014",
    "Peng2020Scope",
    "Peng2024",
    "PengScope",
    "RavenStudy",
    "Scope",
    "reproduce_mahler2014",
    "reproduce_peng2020",
    "reproduce_peng2024",
]
