"""Table I: errors of the paper's six methods, and of two more, on held-out reaches: clean samples, and all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.calibration import Experiment, FitSettings, Measured, run_experiment, spread
from gpcorrect.errors import LogError
from gpcorrect.parallel import each
from gpcorrect.types import CalibrationLog, FloatArray, Progress

OFFSET = "fixed offset"
WITH_GPR, WITH_VELOCITY = f"{OFFSET} + GPR", f"{OFFSET} + GPR + velocity"
FULL = f"{WITH_VELOCITY} + cleaning"  # the paper's last column
GPR_ALONE, MEMORY = "GPR alone", f"{FULL} + memory"  # not in the paper
FITS: dict[str, dict[str, Any]] = {
    WITH_GPR: {"features": ("pose",), "clean": False},
    WITH_VELOCITY: {"clean": False},
    FULL: {},
    GPR_ALONE: {"features": ("pose",), "rigid": False, "clean": False},
    MEMORY: {"features": ("pose", "velocity", "memory")},  # of the commands that were sent before
}
# What each column is measured on: a fit, and which of its errors.
MEASURED = {
    "no correction": (WITH_GPR, "raw"),
    OFFSET: (WITH_GPR, "rigid"),
    f"{OFFSET} + cleaning": (FULL, "rigid"),
    **{name: (name, "corrected") for name in FITS},
}
METHODS = tuple(MEASURED)
PRINTED = METHODS[:-2]  # the columns of the paper's table, in its order
COMPONENTS = ("x_mm", "y_mm", "z_mm", "yaw_deg", "pitch_deg", "roll_deg")  # as printed
NORMS = ("position_mm", "rotation_deg")

Errors = dict[str, dict[str, float]]


@dataclass(frozen=True, eq=False)
class TableOne:
    """Errors of the paper's six methods in its order, of GPR without an offset, and of ours with memory.

    Parameters
    ----------
    errors : mapping
        By set ("clean": samples that pass cleaning, "dirty": all), then by method: mean and SD of the absolute error of
        each component, of the position error's length (`position_mm`) and the rotation error's angle (`rotation_deg`).
    seconds : mapping from method to s
        Of the whole experiment: cleaning, fit, intervals, measurement.
    full : Experiment
        The experiment of the paper's last column, for further figures.
    """

    errors: Mapping[str, Mapping[str, Errors]]
    seconds: Mapping[str, float]
    full: Experiment

    def percent_of_raw(self, which: str, method: str = FULL) -> dict[str, float]:
        """Mean length of a method's error as a percentage of the uncorrected one.

        Parameters
        ----------
        which : "clean" or "dirty"
            Samples that pass cleaning, or all.
        method : str
            One of :data:`METHODS`.

        Returns
        -------
        dict
            %, of `position_mm` and `rotation_deg`.
        """
        errors = self.errors[which]
        return {norm: 100 * errors[method][norm]["mean"] / errors["no correction"][norm]["mean"] for norm in NORMS}

    def gain_of_velocity(self, which: str) -> dict[str, float]:
        """Percentage by which velocity features reduce the mean length of the error.

        Parameters
        ----------
        which : "clean" or "dirty"
            Samples that pass cleaning, or all.
        """
        errors = self.errors[which]
        without, with_it = errors[WITH_GPR], errors[WITH_VELOCITY]
        return {norm: 100 * (1 - with_it[norm]["mean"] / without[norm]["mean"]) for norm in NORMS}

    def gain_of_cleaning(self, which: str) -> dict[str, float]:
        """Percentage by which cleaning the training data reduces the SD of the error's length.

        Parameters
        ----------
        which : "clean" or "dirty"
            Samples that pass cleaning, or all.
        """
        errors = self.errors[which]
        without, with_it = errors[WITH_VELOCITY], errors[FULL]
        return {norm: 100 * (1 - with_it[norm]["sd"] / without[norm]["sd"]) for norm in NORMS}


def table_one(log: CalibrationLog, settings: FitSettings, progress: Progress) -> TableOne:
    """Fit the regressions on the first 80 % of the reaches and measure all methods on the others.

    Parameters
    ----------
    log : CalibrationLog
        The simulated recording.
    settings : FitSettings
        What all fits have in common.
    progress : Progress
        Receives a step after each fit.

    Raises
    ------
    LogError
        Nothing was held out.
    """
    tasks = [replace(settings, **changes) for changes in FITS.values()]
    done = each(partial(run_experiment, log), tasks, progress, "Table I")
    experiments = dict(zip(FITS, done, strict=True))
    errors = {
        which: {name: _errors(experiments[fit], which, kind) for name, (fit, kind) in MEASURED.items()}
        for which in ("clean", "dirty")
    }
    return TableOne(errors, {name: done.seconds for name, done in experiments.items()}, experiments[FULL])


def _errors(experiment: Experiment, which: str, kind: str) -> Errors:
    if experiment.evaluation is None or experiment.test is None:
        raise LogError("nothing was held out to measure on.")
    measured: Measured = getattr(experiment.evaluation, which)
    residual = measured.of(kind)
    position, turns = 1e3 * residual[:, :3], np.rad2deg(_euler_errors(residual[:, 3:], experiment.test, measured))
    rows = dict(zip(COMPONENTS, [*position.T, *turns.T[::-1]], strict=True))
    rows |= {
        "position_mm": np.linalg.norm(position, axis=1),
        "rotation_deg": np.rad2deg(np.linalg.norm(residual[:, 3:], axis=1)),
    }
    return {name: {leaf: spread(values)[leaf] for leaf in ("mean", "sd")} for name, values in rows.items()}


def _euler_errors(turn: FloatArray, test: CalibrationLog, measured: Measured) -> FloatArray:
    """Differences `(n, 3)` of roll, pitch and yaw between what was commanded and what a method gives, within +-pi.

    Angles about fixed x, y and z, as docs/conventions.md has them.
    """
    assert test.setpoint_cp is not None
    assert test.setpoint_cp.quaternion is not None
    R_command = se3.matrix_from_quaternion(test.setpoint_cp.quaternion[measured.rows])
    R_given = np.swapaxes(se3.matrix_from_rotvec(turn), -1, -2) @ R_command
    commanded, given = (Rotation.from_matrix(R).as_euler("xyz") for R in (R_command, R_given))
    difference: FloatArray = commanded - given
    return difference - 2 * np.pi * np.round(difference / (2 * np.pi))
