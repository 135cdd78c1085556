"""Where a result comes from: recordings, seed, versions, thresholds, and what had to be assumed."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import scipy

from gpcorrect.discrepancy.evidence.bursts import Burst, bursts_of
from gpcorrect.discrepancy.evidence.localise import Localisation
from gpcorrect.discrepancy.recording.noise import ChannelNoise, NoiseSource
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.needs import Lack, lacks_of_traces, limits_of
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.search.state import Search, penalty
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.sim.resolve import robot_of
from gpcorrect.types import CalibrationLog


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
    seed : int
        Of the split and of everything drawn.
    versions : dict
        Of this package, Python and the numerical libraries.
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


def provenance_of(
    log: CalibrationLog,
    seed: int,
    prepared: PreparedData,
    state: Search,
    before: Localisation,
    lacks: Sequence[Lack],
    seconds: float,
) -> Provenance:
    """Collect where a result comes from.

    Parameters
    ----------
    log : CalibrationLog
        As it was given.
    seed : int
    prepared : PreparedData
    state : Search
        After the naming.
    before : Localisation
        Of the nominal model's residual.
    lacks : sequence of Lack
        Known before the search.
    seconds : float
        Time of the run.
    """
    dataset, noises = prepared.dataset, state.whitener.noises
    scene, names = dataset.scene, [c.name for c in dataset.scene.channels]
    return Provenance(
        data=(DataSource(log.name, log.digest, len(log)),),
        seed=seed,
        versions={
            "gpcorrect": version("gpcorrect"),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        thresholds=DecisionThresholds(before.threshold, penalty(max(state.n_kinds, 1)), NAMING.exact, NAMING.stable),
        seconds=seconds,
        noise=dict(zip(names, noises, strict=True)),
        tolerated=dataset.tolerated(noises),
        bursts=() if state.fitted else bursts_of(dataset, noises),
        remarks=(*prepared.remarks, *_model_remarks(scene), *limits_of(scene), _noise_remark(state)),
        no_trace=tuple(c.label for c in state.without_trace),
        not_nameable=(*lacks, *lacks_of_traces(state)),
    )


def _noise_remark(state: Search) -> str:
    """Return whether the noise was given or estimated."""
    noises, channels = state.whitener.noises, state.dataset.scene.channels
    stated = [n.source == NoiseSource.STATED for n in noises]
    noisier = [c.name for c, n in zip(channels, noises, strict=True) if n.times_stated is not None]
    if all(stated):
        return "noise: as [noise] of the model file gives it, tails from the recording"
    if noisier:
        return (
            f"noise: the recording is clearly noisier than [noise] says in {', '.join(noisier)}; there it is estimated"
        )
    return f"noise: {'as [noise] gives it where it does, else ' if any(stated) else ''}estimated from the recording"


def _model_remarks(scene: Scene) -> list[str]:
    robot = robot_of(scene.model)
    remarks = [] if robot is None else [f"robot file: {remark}" for remark in robot.remarks]
    parts = ("controller", "transmission", "links", "T_tracker_base")
    absent = [name for name in parts if getattr(scene.model, name) is None]
    if absent:
        names = ", ".join(absent)
        remarks.append(f"absent from the model file, taken from the arm's description or from the data: {names}")
    return remarks
