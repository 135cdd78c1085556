"""A recording laid out for the workflow: bench, the tests and the variables of each channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.evidence.cells import Cells, all_cells
from gpcorrect.discrepancy.evidence.lens import lens_on
from gpcorrect.discrepancy.evidence.localise import EQUIVALENCE, ChannelData, Localisation, localise
from gpcorrect.discrepancy.recording.bench import Bench, build_bench
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.commanded import with_joint_paths
from gpcorrect.discrepancy.recording.covariates import Covariates, covariates_of
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.split import split_rows
from gpcorrect.discrepancy.search.candidates import Member
from gpcorrect.sim import machine_of
from gpcorrect.sim.model import Model
from gpcorrect.types import CalibrationLog

__all__ = ["Laid", "lay_out", "localise_residual"]


@dataclass(frozen=True, eq=False)
class Laid:
    """A recording on the bench.

    Parameters
    ----------
    log : CalibrationLog
        The recording, with the joint paths that its poses stand for.
    bench : Bench
        Condensed rows and simulator.
    tests : tuple of tuple of Cells
        Of each channel.
    inputs : tuple of Covariates
        Variables of each channel, at the condensed rows.
    remarks : tuple of str
        How it was split, and what had to be assumed.
    """

    log: CalibrationLog
    bench: Bench
    tests: tuple[tuple[Cells, ...], ...]
    inputs: tuple[Covariates, ...]
    remarks: tuple[str, ...]


def lay_out(log: CalibrationLog, model: Model, max_rows: int, rng: np.random.Generator) -> Laid:
    """Split a log, build its simulator, condense its rows and cut its variables.

    Raises
    ------
    DataError
        The log lacks a needed signal or is too short to split.
    """
    log, told = with_joint_paths(log, machine_of(model).body)
    split = split_rows(log.time, log.trajectory, log.session, rng)
    scene = build_scene(log, model, split.seen)
    bench = build_bench(scene, split, max_rows)
    by_joint: dict[int, Covariates] = {}
    for channel in scene.channels:
        if channel.joint not in by_joint:
            by_joint[channel.joint] = _condensed(bench, covariates_of(scene, channel.index if channel.joint else None))
    tests = {joint: tuple(all_cells(c)) for joint, c in by_joint.items()}
    return Laid(
        log,
        bench,
        tuple(tests[c.joint] for c in scene.channels),
        tuple(by_joint[c.joint] for c in scene.channels),
        (split.remark, *told, *scene.remarks),
    )


def localise_residual(
    laid: Laid,
    members: Sequence[Member],
    noises: tuple[ChannelNoise, ...],
    tolerance: float | None,
    rng: np.random.Generator,
) -> Localisation:
    """Test what a set leaves on discovery and confirmation against noise."""
    bench = laid.bench
    residual = bench.residual([m.effect for m in members])
    lens = lens_on(bench, residual, bench.seen, noises)
    names = [c.name for c in bench.scene.channels]
    # A servo model that is wrong by far less than the outside sensors see is not missing, however often it is seen.
    channels = [
        ChannelData(
            c.name,
            bench.time,
            residual[:, i],
            lens.blocks[i],
            noises[i],
            laid.tests[i],
            least=EQUIVALENCE if c.signal == "measured_jp" else 0.0,
        )
        for i, c in enumerate(bench.scene.channels)
    ]
    return localise(channels, rng, tolerance={} if tolerance is None else dict.fromkeys(names, tolerance))


def _condensed(bench: Bench, covariates: Covariates) -> Covariates:
    """Covariates of the condensed rows: the value at the middle sample, so that signs stay signs."""
    used = np.flatnonzero(bench.group >= 0)
    group = bench.group[used]
    first = np.searchsorted(group, np.arange(len(bench)))
    last = np.searchsorted(group, np.arange(len(bench)), side="right") - 1
    middle = used[(first + last) // 2]
    values = {name: v[middle] for name, v in covariates.values.items()}
    kept = {name: v for name, v in values.items() if np.std(v) > 0}
    return Covariates(kept, tuple(p for p in covariates.primary if p in kept), covariates.units)
