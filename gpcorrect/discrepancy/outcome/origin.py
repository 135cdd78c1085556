"""Where a result comes from, as it is reported: recordings, seed, versions, thresholds, and what had to be assumed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gpcorrect.discrepancy.evidence.bursts import Burst
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.search.needs import Lack


@dataclass(frozen=True)
class DataSource:
    """A recording that was used: its name, its file's SHA-256 (empty for no file), and its rows."""

    name: str
    sha256: str
    rows: int


@dataclass(frozen=True)
class DecisionThresholds:
    """What evidence was held against: nats of a test and of an effect, and the probabilities of a name and a rival."""

    localisation_nats: float
    effect_nats: float
    exact_probability: float
    rival_probability: float


@dataclass(frozen=True)
class Provenance:
    """Where a result comes from, and what had to be assumed.

    Parameters
    ----------
    data : tuple of DataSource
        Recordings.
    seed : int
        Of the split and of everything drawn.
    versions : dict
        Of this package, Python and the numerical libraries.
    thresholds : DecisionThresholds
        Of this run.
    seconds : float
        Time of the run.
    noise : dict of str to ChannelNoise
        By the channel's name.
    tolerated : dict of str to float
        What is put down to tolerances of a table, over each channel's noise.
    bursts : tuple of Burst
        Rare moments far above the noise, where nothing is named.
    remarks : tuple of str
        Assumptions, for people.
    no_trace : tuple of str
        Labels of candidates that leave no trace in these channels.
    not_nameable : tuple of Lack
        Effects that these data cannot show.
    """

    data: tuple[DataSource, ...]
    seed: int
    versions: Mapping[str, str]
    thresholds: DecisionThresholds
    seconds: float
    noise: Mapping[str, ChannelNoise]
    tolerated: Mapping[str, float]
    bursts: tuple[Burst, ...]
    remarks: tuple[str, ...]
    no_trace: tuple[str, ...]
    not_nameable: tuple[Lack, ...]
