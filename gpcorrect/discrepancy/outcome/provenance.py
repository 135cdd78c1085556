"""Where a result comes from: recordings, seed, versions, thresholds, and what had to be assumed."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import scipy

from gpcorrect.discrepancy.evidence.bursts import Burst
from gpcorrect.discrepancy.recording.noise import ChannelNoise, NoiseSource
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.needs import Lack, lacks_of_traces, limits_of
from gpcorrect.discrepancy.search.prepared import PreparedData
from gpcorrect.discrepancy.search.state import Search, penalty
from gpcorrect.sim.resolve import robot_of
from gpcorrect.types import CalibrationLog


@dataclass(frozen=True)
class Provenance:
    """Where a result comes from, and what had to be assumed."""

    name: str  # of the recording
    sha256: str  # of its file; empty for no file
    rows: int  # of it
    seed: int  # of the split and of everything drawn
    versions: Mapping[str, str]  # of this package, Python and the numerical libraries
    effect_nats: float  # that an effect had to gain
    seconds: float  # time of the run
    noise: Mapping[str, ChannelNoise]  # by the channel's name
    tolerated: Mapping[str, float]  # what is put down to tolerances of a table, over each channel's noise
    bursts: tuple[Burst, ...]  # rare moments far above the noise, beyond what is named
    servo_unseen: bool  # whether no channel shows the servo loop: motors as measured, and no closed loop simulated
    remarks: tuple[str, ...]  # assumptions, for people
    no_trace: tuple[str, ...]  # labels of candidates that leave no trace in these channels
    not_nameable: tuple[Lack, ...]  # effects that these data cannot show


def provenance_of(
    log: CalibrationLog,
    seed: int,
    prepared: PreparedData,
    state: Search,
    lacks: Sequence[Lack],
    bursts: tuple[Burst, ...],
    seconds: float,
) -> Provenance:
    """Collect where a result comes from.

    Parameters
    ----------
    log : CalibrationLog, as it was given
    seed : int
    prepared : PreparedData
    state : Search, after the naming
    lacks : sequence of Lack, known before the search
    bursts : tuple of Burst, beyond what is named
    seconds : float, time of the run
    """
    dataset, noises = prepared.dataset, state.whitener.noises
    scene = dataset.scene
    return Provenance(
        name=log.name,
        sha256=log.digest,
        rows=len(log),
        seed=seed,
        versions={
            "gpcorrect": version("gpcorrect"),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        effect_nats=penalty(state.n_kinds),
        seconds=seconds,
        noise={channel.name: noise for channel, noise in zip(scene.channels, noises, strict=True)},
        tolerated=dataset.tolerated(noises),
        bursts=bursts,
        servo_unseen=scene.plan is None and log.measured_jp is not None,
        remarks=(*log.remarks, *prepared.remarks, *_model_remarks(scene), *limits_of(scene), _noise_remark(state)),
        no_trace=tuple(c.label for c in state.without_trace),
        not_nameable=(*lacks, *lacks_of_traces(state)),
    )


def _noise_remark(state: Search) -> str:
    """Return whether the noise was given or estimated."""
    noises, channels = state.whitener.noises, state.dataset.scene.channels
    stated = [n.source == NoiseSource.STATED for n in noises]
    if all(stated):
        return "noise: as [noise] of the model file gives it, tails from the recording"
    if noisier := [c.name for c, n in zip(channels, noises, strict=True) if n.times_stated is not None]:
        there = ", ".join(noisier)
        return f"noise: the recording is clearly noisier than [noise] says in {there}; there it is estimated"
    return f"noise: {'as [noise] gives it where it does, else ' if any(stated) else ''}estimated from the recording"


def _model_remarks(scene: Scene) -> list[str]:
    robot = robot_of(scene.model)
    remarks = [] if robot is None else [f"robot file: {remark}" for remark in robot.remarks]
    parts = ("controller", "transmission", "links", "T_tracker_base")
    if absent := ", ".join(name for name in parts if getattr(scene.model, name) is None):
        remarks.append(f"absent from the model file, taken from the arm's description or from the data: {absent}")
    return remarks
