"""Recordings with hidden causes, made by another simulator than the one that looks for them."""

from truth.case import make_case, make_truth
from truth.further import further_recording, joined
from truth.kinds import CATALOGUE, OUTSIDE
from truth.sealing import labels_bytes, nominal_text, open_labels, write_case
from truth.spec import AWKWARD, Case, Spec
from truth.suites import RATIOS, SUITES, short, specs

__all__ = [
    "AWKWARD",
    "CATALOGUE",
    "OUTSIDE",
    "RATIOS",
    "SUITES",
    "Case",
    "Spec",
    "further_recording",
    "joined",
    "labels_bytes",
    "make_case",
    "make_truth",
    "nominal_text",
    "open_labels",
    "short",
    "specs",
    "write_case",
]
