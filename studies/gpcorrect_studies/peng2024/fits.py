"""Recordings and fits of the joint-level study, each made once; errors as means and deviations over repeats."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from gpcorrect.calibration import DIRECTIONS, Direction, FitSettings, JointCorrector, fit_model
from gpcorrect.types import CalibrationLog, FloatArray, Progress
from gpcorrect_studies.parts import Parts
from gpcorrect_studies.peng2024.recordings import RavenStudy, whole_state

METHODS = ("linear", "quadratic", "network", "ukf", "gp")
QUICK_EPOCHS = 50  # a quarter of the paper's; chosen by hand
UNITS = np.array([np.rad2deg(1.0), np.rad2deg(1.0), 1e3])  # deg, deg, mm
Cell = dict[str, Any]
Item = TypeVar("Item")


@dataclass(frozen=True)
class PengScope:
    """How much is done."""

    directions: tuple[str, ...] = DIRECTIONS  # zig-zags of Table I
    # n of the sparsities 1/n of Fig. 5, rising, two at least; Table I has the one in the middle
    sparsities: tuple[int, ...] = (2, 3, 4, 5, 6)
    minutes: float = 4.0  # of a test run
    hours: tuple[float, ...] = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)  # of Fig. 6
    homings: int = 5  # of Fig. 9, after the first
    # training recordings with other noise and other seeds, for every method and for the network
    repeats: int = 2
    network_repeats: int = 5
    inducing: int = 300  # points of the Gaussian process
    # samples that the Gaussian process learns its hyperparameters from; its own number when None
    search_samples: int | None = None
    epochs: int = FitSettings().epochs  # of the network; the paper's by default
    later: Direction = "J2-J3"  # direction of the zig-zag of all parts after Table I; the paper's is J2-J3
    ablations: tuple[str, ...] | None = None  # which are done; None does all

    @classmethod
    def short(cls) -> PengScope:
        """Return a study of a few minutes: every part, fewer directions, sparsities and repeats."""
        return cls(("J1", "J2-J3", "J1-J2-J3"), (2, 3), 2.0, (0.0, 5.0, 6.0), 2, 1, 1, 100, 300)

    @classmethod
    def quick(cls) -> PengScope:
        """Return a study of a minute: every part, one direction, short zig-zags and a network of few epochs."""
        hours, cheap = (0.0, 5.0, 6.0), ("slow", "processor time", "laws alone", "library")
        return cls(("J2-J3",), (1, 2), 1.0, hours, 1, 1, 1, 40, 150, QUICK_EPOCHS, ablations=cheap)

    @property
    def middle(self) -> Run:
        """The zig-zag of the later parts, of the sparsity in the middle."""
        return Run(self.later, self.sparsities[len(self.sparsities) // 2])

    @property
    def longest(self) -> Run:
        """The longest zig-zag of the later parts."""
        return Run(self.later, self.sparsities[-1])


@dataclass(frozen=True)
class Run:
    """A training recording, and how a model learns from it."""

    direction: str  # of the zig-zag
    sparsity: int  # n of its sparsity 1/n
    homings_seen: int = 0  # how many homings after the first are in the training, a zig-zag each
    state: bool = False  # whether the model sees the whole state instead of positions and efforts
    end_to_end: bool = False  # whether it learns positions themselves, not their error


@dataclass(eq=False)
class StudyFits:
    """Makes each recording and each fit of the study once."""

    study: RavenStudy
    scope: PengScope
    progress: Progress
    parts: Parts = field(default_factory=Parts)
    _logs: dict[Any, CalibrationLog] = field(default_factory=dict, init=False)
    _models: dict[Any, JointCorrector] = field(default_factory=dict, init=False)

    def training(self, run: Run, repeat: int) -> CalibrationLog:
        """Return the zig-zags of a run, a trajectory each.

        Parameters
        ----------
        run : Run
        repeat : int, of its noise
        """
        key = run.direction, run.sparsity, run.homings_seen, repeat
        if key not in self._logs:
            self._logs[key] = self.study.zigzags(
                run.direction, run.sparsity, sessions=range(run.homings_seen + 1), repeat=repeat
            )
        log = self._logs[key]
        return whole_state(log, repeat) if run.state else log

    def models(self, run: Run, method: str) -> list[JointCorrector]:
        """Return what a method learns of a run, a model for each repeat; the repeat is its seed too.

        Parameters
        ----------
        run : Run
        method : str
        """
        repeats = self.scope.network_repeats if method == "network" else self.scope.repeats
        return [self._model(run, method, repeat) for repeat in range(repeats)]

    def settings(self, run: Run, method: str, repeat: int) -> FitSettings:
        """Return how a method learns of a run.

        Parameters
        ----------
        run : Run
        method : str
        repeat : int, its seed
        """
        return FitSettings(
            method=method,
            clean=False,  # a simulated encoder has no faults
            features=("position", "state") if run.state else (),
            end_to_end=run.end_to_end,
            inducing=self.scope.inducing,
            search_samples=self.scope.search_samples,
            epochs=self.scope.epochs,
            time_offset="none",
            seed=repeat,
        )

    def _model(self, run: Run, method: str, repeat: int) -> JointCorrector:
        key = run, method, repeat
        if key not in self._models:
            settings = self.settings(run, method, repeat)
            self._models[key] = fit_model(self.training(run, repeat), settings, task=JointCorrector).corrector
        return self._models[key]

    def rmse(self, run: Run, method: str, test: CalibrationLog) -> Cell:
        """Return the RMSE of a method's estimates on a test run, deg, deg and mm.

        Parameters
        ----------
        run : Run, that it learns from
        method : str
        test : CalibrationLog
        """
        return cell(rmse(model, test) for model in self.models(run, method))

    def all_rmse(self, run: Run, test: CalibrationLog) -> dict[str, Cell]:
        """Return the RMSE of raw positions, of the fixed offset and of every method, deg, deg and mm.

        Parameters
        ----------
        run : Run, that they learn from
        test : CalibrationLog
        """
        linear = self.models(run, "linear")
        row = {name: cell(rmse(model, test, name) for model in linear) for name in ("raw", "fixed_offset")}
        return row | {method: self.rmse(run, method, test) for method in METHODS}

    def over(self, stage: str, items: Iterable[Item], make: Callable[[Item], Any]) -> dict[str, Any]:
        """Return what is made of each item, by its name; what an earlier run has made is not made again.

        Parameters
        ----------
        stage : str, name of the part
        items : iterable
        make : callable, returns what JSON can hold
        """
        return self.parts.each(stage, make, {str(item): item for item in items}, self.progress)


def rmse(model: JointCorrector, log: CalibrationLog, name: str = "corrected") -> list[float]:
    """Return the RMSE of the joints, deg, deg and mm.

    Parameters
    ----------
    model : JointCorrector
    log : CalibrationLog, with external joints
    name : str, of `raw`, `fixed_offset` or `corrected` positions
    """
    left = model.measure(log, np.ones(len(log), dtype=bool)).of(name)  # of every sample: nothing here is faulty
    errors: list[float] = (UNITS * np.sqrt(np.nanmean(left**2, axis=0))).tolist()
    return errors


def cell(repeats: Iterable[list[float] | FloatArray | float]) -> Cell:
    """Return mean and standard deviation over repeats, and their number.

    Parameters
    ----------
    repeats : iterable, a number or a list of numbers a repeat
    """
    values = np.array(list(repeats))
    return {"mean": values.mean(axis=0).tolist(), "sd": values.std(axis=0).tolist(), "repeats": len(values)}
