"""One experiment: split by trajectory, fit on the first, measure on the last, clean and dirty."""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect.cleaning import CleaningReport, require_segments
from gpcorrect.corrector import (
    CommandCorrector,
    FitResult,
    FitSettings,
    fit_command_corrector,
    observed_twists,
    on_one_clock,
    pose_pair,
)
from gpcorrect.errors import LogError
from gpcorrect.metrics import ErrorTable, coverage, error_table
from gpcorrect.play import path_labels
from gpcorrect.rigid import pose_residual
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal, Progress

__all__ = ["Evaluation", "Experiment", "Measured", "evaluate", "run_experiment", "split_trajectories"]

METHODS = ("raw", "rigid", "corrected")
UNITS = {"position_mm": "mm", "rotation_deg": "deg"}
COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Measured:
    """How far off each method is on some samples of a log: before, after the rigid part, and corrected.

    Parameters
    ----------
    raw, rigid, corrected : (n, 6) arrays
        Command minus what each method would have commanded for the observed pose: m, then rad; NaN where not measured.
    interval95 : (n, 6) array
        Half widths of the corrected method's 95 % intervals.
    in_domain : (n,) bool array
        Whether the observed pose lies near training data.
    speed : (n,) array
        Linear speed of the observed pose, m/s.
    rows : (n,) int array
        Rows of the log that were measured.
    """

    raw: FloatArray
    rigid: FloatArray
    corrected: FloatArray
    interval95: FloatArray
    in_domain: BoolArray
    speed: FloatArray
    rows: IntArray

    def errors(self) -> dict[str, ErrorTable]:
        """Return the table of errors of each method."""
        return {name: error_table(getattr(self, name)) for name in METHODS}

    @property
    def coverage95(self) -> FloatArray:
        """(6,) share of errors inside their 95 % intervals, a component each; NaN where not measured."""
        return coverage(self.corrected, self.interval95)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A model measured on one log twice: on the samples that pass cleaning, and on all of them as they came.

    The clean set has velocities that never cross a rejected sample; the dirty set has those that the path as it came
    shows.
    """

    clean: Measured
    dirty: Measured
    cleaning: CleaningReport

    @property
    def cautions(self) -> tuple[str, ...]:
        """What a reader must know before using the model: parts where learning did not beat the registration."""
        errors, said = self.clean.errors(), []
        for part, unit in UNITS.items():
            rigid, corrected = (errors[m].get(part, {}).get("norm", {}).get("rmse") for m in ("rigid", "corrected"))
            if rigid is not None and corrected is not None and corrected >= rigid:
                said.append(
                    f"on held-out trajectories the learned part does not lessen the {part.split('_')[0]} error (RMSE "
                    f"{rigid:.3g} {unit} after registration, {corrected:.3g} {unit} corrected): record more motion"
                )
        return tuple(said)

    def to_dict(self) -> dict[str, Any]:
        """Return `errors` (samples that pass cleaning), `errors_dirty` (all) and the coverage of the 95 % intervals."""
        shares = self.clean.coverage95
        known = np.isfinite(shares)
        return {
            "errors": self.clean.errors(),
            "errors_dirty": self.dirty.errors(),
            "coverage95": float(shares[known].mean()) if known.any() else math.nan,
            "coverage95_axes": dict(zip(COMPONENTS, shares.tolist(), strict=True)),
            "in_domain": float(self.clean.in_domain.mean()),
            "cautions": list(self.cautions),
        }


@dataclass(frozen=True, eq=False)
class Experiment:
    """A fit and its measurement on held-out trajectories."""

    fit: FitResult
    test: CalibrationLog | None
    evaluation: Evaluation | None
    seconds: float

    @property
    def corrector(self) -> CommandCorrector:
        """The fitted corrector."""
        return self.fit.corrector

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON of `gpcorrect fit`: counts, what was dropped, seconds, errors and coverage."""
        dropped = Counter(self.fit.cleaning.counts)
        if self.evaluation is not None:
            dropped.update(self.evaluation.cleaning.counts)
        return {
            "n_train": self.fit.n_train,
            "n_test": len(self.evaluation.clean.rows) if self.evaluation else 0,
            "dropped": dict(dropped),
            "seconds": self.seconds,
            **(
                self.evaluation.to_dict() if self.evaluation else {"errors": {}, "errors_dirty": {}, "coverage95": None}
            ),
            "model": self.fit.summary,
        }


def split_trajectories(
    log: CalibrationLog, holdout: float, *, rng: np.random.Generator | None = None
) -> tuple[CalibrationLog, CalibrationLog | None]:
    """Split whole trajectories: the last share `holdout` of them, or a random one when `rng` is given.

    Returns
    -------
    train, test : CalibrationLog
        `test` is None when `holdout` is 0.

    Raises
    ------
    LogError
        `holdout` is not in [0, 1), or there are too few trajectories to hold one out.
    """
    if not 0 <= holdout < 1:
        raise LogError(f"the held-out share must be at least 0 and below 1, got {holdout}.")
    ids = log.trajectory_ids
    if holdout == 0:
        return log, None
    if len(ids) < 2:
        raise LogError(
            "the log holds one trajectory: nothing can be held out to measure the error on.",
            hint="Number the motions in the `trajectory` column, give more logs, or measure nothing: --holdout 0",
            path=log.name,
        )
    if rng is not None:
        ids = rng.permutation(ids)
    count = min(len(ids) - 1, max(1, round(holdout * len(ids))))
    held = np.isin(log.trajectory, ids[-count:])
    return log.select(~held), log.select(held)


def run_experiment(
    log: CalibrationLog,
    settings: FitSettings | None = None,
    *,
    holdout: float = 0.2,
    shuffle: bool = False,
    progress: Progress | None = None,
) -> Experiment:
    """Fit on some trajectories of `log` and measure the error on the others.

    Raises
    ------
    LogError
        Signals are missing, or nothing can be held out.
    DataError
        The data do not determine a model, or a segment to keep or drop is not in the log.
    """
    settings = settings or FitSettings()
    start = time.perf_counter()
    require_segments(log, (*settings.cleaning.keep, *settings.cleaning.drop))
    log, clocks = on_one_clock(log, settings.time_offset)
    rng = np.random.default_rng(settings.seed) if shuffle else None
    train, test = split_trajectories(log, holdout, rng=rng)
    fit = fit_command_corrector(train, settings, clocks=clocks, progress=progress)
    measured = evaluate(fit.corrector, test) if test is not None else None
    return Experiment(fit, test, measured, time.perf_counter() - start)


def evaluate(corrector: CommandCorrector, log: CalibrationLog, cleaning: CleaningReport | None = None) -> Evaluation:
    """Measure what `corrector` would have commanded for the observed poses of `log` against what was commanded.

    Samples are judged by the training's ruler, or as `cleaning` says.

    Raises
    ------
    LogError
        The log lacks `tracker_cp` or `setpoint_cp`, or no sample can be measured.
    """
    cleaning = cleaning or corrector.clean(log)
    everything = np.ones(len(log), dtype=bool)
    return Evaluation(
        clean=_measure(corrector, log, cleaning.keep),
        dirty=_measure(corrector, log, everything),
        cleaning=cleaning,
    )


def _measure(corrector: CommandCorrector, log: CalibrationLog, keep: BoolArray) -> Measured:
    observed, command = pose_pair(log)
    possible, _ = corrector.possible(observed, log.time, np.where(keep & observed.finite, log.trajectory, -1))
    twist = observed_twists(log.time, log.trajectory, possible, keep, corrector.velocity_step)
    rows = np.flatnonzero(keep & observed.finite & command.finite & np.isfinite(twist[:, :3]).all(axis=1))
    if rows.size == 0:
        raise LogError(
            "no sample that passes has both poses and a velocity.",
            hint="See: gpcorrect validate LOG",
            path=log.name,
        )
    observed, command, twist = observed[rows], command[rows], twist[rows]
    path = corrector.correct_observed(possible[rows], twist, command, path_labels(log.time[rows], log.session[rows]))
    return Measured(
        raw=pose_residual(observed, command),
        rigid=pose_residual(corrector.rigid.apply(observed), command),
        corrected=pose_residual(PoseSignal(path.positions, path.quaternions), command),
        interval95=path.interval95,
        in_domain=path.in_domain,
        speed=np.linalg.norm(twist[:, :3], axis=1),
        rows=rows,
    )
