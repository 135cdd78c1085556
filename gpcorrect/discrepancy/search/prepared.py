"""A recording prepared for the workflow: dataset, the tests and the variables of each channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gpcorrect.discrepancy.evidence.bursts import Burst
from gpcorrect.discrepancy.evidence.localise import ChannelData, Localisation, localise
from gpcorrect.discrepancy.evidence.variables import Cells, Covariates, all_cells, covariates_of
from gpcorrect.discrepancy.evidence.whitener import whitener_on
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.commanded import with_joint_paths
from gpcorrect.discrepancy.recording.dataset import Dataset, build_dataset
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.split import Split, split_rows
from gpcorrect.discrepancy.search.candidates import FittedEffect
from gpcorrect.discrepancy.settings import BURSTS, SPLIT, TESTS
from gpcorrect.logs.checks.signals import held_rows
from gpcorrect.logs.copies import OUTSIDE
from gpcorrect.sim import machine_of
from gpcorrect.sim.effects import Effect
from gpcorrect.sim.model import Model
from gpcorrect.types import BoolArray, CalibrationLog, PoseSignal

MOST = 0.5  # of a joint's usual way: what remembers more depends on the beginning all along, as the fit has taken it


@dataclass(frozen=True, eq=False)
class PreparedData:
    """What the workflow needs of a recording."""

    log: CalibrationLog  # with the joint paths that its poses stand for
    split: Split
    dataset: Dataset
    tests: tuple[tuple[Cells, ...], ...]  # of each channel
    inputs: tuple[Covariates, ...]  # of each channel, at the condensed rows
    remarks: tuple[str, ...]  # how it was split, and what had to be assumed

    def without(self, samples: BoolArray) -> PreparedData:
        """Return the recording without samples that may be off by how a motion began, and a remark on them.

        Parameters
        ----------
        samples : (n, c) bool array, of the log's rows and the channels
        """
        if not samples.any():
            return self
        part = f"{100 * samples.mean():.1f} % of the samples"
        remark = f"{part} count for nothing but names: no log says how the motion began, and an effect remembers it"
        dataset = replace(self.dataset, good=self.dataset.good & ~samples)
        return replace(self, dataset=dataset, remarks=(*self.remarks, remark))


def prepare_data(log: CalibrationLog, model: Model, rng: np.random.Generator) -> PreparedData:
    """Split a log, build its simulator, condense its rows and cut its variables.

    Parameters
    ----------
    log : CalibrationLog
    model : Model
    rng : numpy.random.Generator, deals the parts

    Raises
    ------
    DataError
        The log lacks a needed signal or is too short to split.
    """
    log, held = _as_sampled(log)
    log, anew = _one_after_the_other(log)
    log, remarks = with_joint_paths(log, machine_of(model).body)
    split = split_rows(log.trajectory, log.session, rng)
    scene = build_scene(log, model, np.isin(split.part, [0, 1]))  # the test set must not register the tracker
    dataset = build_dataset(scene, split, SPLIT.most_rows)
    return _prepared(log, split, dataset, (split.remark, *held, *anew, *remarks, *scene.remarks))


def _as_sampled(log: CalibrationLog) -> tuple[CalibrationLog, tuple[str, ...]]:
    """Return the log without what outside sensors that are held between slower samples say again, and that in words.

    A value that is a row old is noise that grows with speed.
    """
    words = []
    for name in OUTSIDE:
        signal, again = getattr(log, name), held_rows(log, name)
        if again.any():
            table = signal.table if isinstance(signal, PoseSignal) else signal
            table = np.where(again[:, None], np.nan, table)
            sampled: dict[str, Any] = {name: PoseSignal.of(table) if isinstance(signal, PoseSignal) else table}
            log = replace(log, **sampled)
            part = f"{100 * again.mean():.0f} % of its rows repeat the one before"
            words.append(f"{name} is held between slower samples: {part}, and count as not measured")
    return log, tuple(words)


def _one_after_the_other(log: CalibrationLog) -> tuple[CalibrationLog, tuple[str, ...]]:
    """Return the log with one time for all motions of a session, and in words where their stamps start anew.

    What a session remembers, such as since when a cable has slipped, knows no other time.
    """
    step, change = np.diff(log.time), np.diff(log.trajectory) != 0
    anew = change & (step <= 0) & (np.diff(log.session) == 0)
    if not anew.any():
        return log, ()
    pause = 2.0 * step[~change].max()  # longer than a step: no motion goes on into the next
    later = np.concatenate([[0.0], np.cumsum(np.where(anew, pause - step, 0.0))])
    words = f"the stamps of {anew.sum()} motions start anew: the motions of a session are taken to follow each other"
    return replace(log, time=log.time + later), (words,)


def in_pieces(prepared: PreparedData, bursts: Sequence[Burst], rng: np.random.Generator) -> PreparedData:
    """Cut the trajectories in which something rare happens so short that it happens in many of the pieces.

    Parameters
    ----------
    prepared : PreparedData, by whole trajectories
    bursts : sequence of Burst, what happens in it; not empty
    rng : numpy.random.Generator, deals the pieces
    """
    dataset = prepared.dataset
    rows = np.isin(dataset.scene.trajectory, [t for b in bursts for t in b.trajectories])
    length = max(BURSTS.shortest, min(b.rows for b in bursts) // BURSTS.pieces)  # of condensed rows
    stride = round(np.count_nonzero(dataset.group >= 0) / len(dataset))
    split = prepared.split.in_pieces(rows, length * stride, rng)
    numbers = ", ".join(str(t) for t in np.unique(dataset.scene.trajectory[rows]))
    remark = f"something rare happens in trajectory {numbers}: cut into pieces of {length * stride} samples"
    cut = build_dataset(dataset.scene, split, SPLIT.most_rows)
    cut = replace(cut, good=dataset.good)  # what is an outlier shows beside its neighbours, not in a short piece
    return _prepared(prepared.log, split, cut, (*prepared.remarks, remark))


def _prepared(log: CalibrationLog, split: Split, dataset: Dataset, remarks: tuple[str, ...]) -> PreparedData:
    scene = dataset.scene
    used = np.flatnonzero(dataset.group >= 0)
    first, last = (np.searchsorted(dataset.group[used], np.arange(len(dataset)), side) for side in ("left", "right"))
    middle = used[(first + last - 1) // 2]  # not the mean, so that signs stay signs
    columns = [channel.index if channel.joint else None for channel in scene.channels]
    inputs = {column: covariates_of(scene, column, middle) for column in dict.fromkeys(columns)}
    tests = {column: tuple(all_cells(covariates)) for column, covariates in inputs.items()}
    return PreparedData(
        log, split, dataset, tuple(tests[c] for c in columns), tuple(inputs[c] for c in columns), remarks
    )


def localise_residual(
    prepared: PreparedData,
    fitted: Sequence[FittedEffect],
    noises: tuple[ChannelNoise, ...],
    rng: np.random.Generator,
) -> Localisation:
    """Test what a set leaves on discovery and confirmation against noise.

    Parameters
    ----------
    prepared : PreparedData
    fitted : sequence of FittedEffect
    noises : tuple of ChannelNoise
    rng : numpy.random.Generator, draws the null law
    """
    dataset = prepared.dataset
    residual = dataset.residual([m.effect for m in fitted])
    blocks = whitener_on(dataset, residual, dataset.training, noises).blocks
    channels = [
        ChannelData(c, dataset.time, residual[:, i], blocks[i], noises[i], prepared.tests[i])
        for i, c in enumerate(dataset.scene.channels)
    ]
    return localise(channels, rng)


def open_beginnings(dataset: Dataset, effects: Sequence[Effect], noises: Sequence[ChannelNoise]) -> BoolArray:
    """Return samples `(n, c)` that may be off by an effect only because no log says how the motion began.

    A play stands anywhere in its gap, and friction holds a joint where it came to rest, until the joint has moved far
    enough. The model begins in the middle. A channel counts where the effect changes it by more than matters.

    Parameters
    ----------
    dataset : Dataset
    effects : sequence of Effect, those that are named
    noises : sequence of ChannelNoise, of every channel
    """
    scene = dataset.scene
    left_open = np.zeros(dataset.good.shape, dtype=np.bool_)
    way, run, nominal = scene.way(), scene.run_of_row(), dataset.predict()
    least = TESTS.resolution * np.ptp(scene.motor_path(), axis=0)
    usual = np.median([np.nan_to_num(way[run == k]).max(axis=0) for k in np.unique(run)], axis=0)
    for effect in effects:
        if not (needed := effect.forgets_after()):
            continue
        change = np.sqrt(np.mean((dataset.predict([effect]) - nominal) ** 2, axis=0))
        shows = change > TESTS.equivalence * np.array([n.std for n in noises])
        columns = [effect.column(scene.joints, joint) for joint in needed]
        enough = np.maximum(np.minimum(list(needed.values()), MOST * usual[columns]), least[columns])
        moved = (way[:, columns] > enough).all(axis=1)
        left_open |= ~moved[:, None] & shows
    return left_open
