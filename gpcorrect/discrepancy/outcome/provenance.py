"""Where a result comes from: data hashes, seed, versions, thresholds, and what had to be assumed."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
import scipy

from gpcorrect.discrepancy.evidence.bursts import bursts_of
from gpcorrect.discrepancy.evidence.localise import Localisation
from gpcorrect.discrepancy.outcome.origin import DataSource, DecisionThresholds, Provenance
from gpcorrect.discrepancy.recording.noise import NoiseSource
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.needs import Lack, lacks_of_traces, limits_of
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.search.state import Search, penalty
from gpcorrect.discrepancy.settings import NAMING
from gpcorrect.sim.resolve import robot_of
from gpcorrect.types import CalibrationLog


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
        Of the run.
    prepared : PreparedData
        The recording.
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
