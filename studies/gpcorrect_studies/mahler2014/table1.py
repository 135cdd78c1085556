"""Table I: errors of the paper's six methods, and of two more, on held-out reaches: clean samples, and all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect import se3
from gpcorrect.calibration import Evaluation, Experiment, FitSettings, run_experiment, spread
from gpcorrect.errors import LogError
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, Progress
from gpcorrect_studies.parts import Parts

OFFSET = "fixed offset"  # a column's name, as printed
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
SETS, KINDS = ("clean", "dirty"), ("raw", "rigid", "corrected")
# Steps of the recipe: the columns without and with it, and what of the error's length it reduces.
STEPS = {"velocity": (WITH_GPR, WITH_VELOCITY, "mean"), "cleaning": (WITH_VELOCITY, FULL, "sd")}

Errors = dict[str, dict[str, float]]


@dataclass(frozen=True, eq=False)
class TableOne:
    """Errors of the paper's six methods in its order, of GPR without an offset, and of ours with memory."""

    # by set ("clean": samples that pass cleaning, "dirty": all), then by method: mean and SD of the absolute error of
    # each component, of the position error's length (`position_mm`) and the rotation error's angle (`rotation_deg`)
    errors: Mapping[str, Mapping[str, Errors]]
    # by method, s of the whole experiment: cleaning, fit, intervals, measurement
    seconds: Mapping[str, float]
    full: Experiment  # the experiment of the paper's last column, for further figures

    def percent_of_raw(self, which: str, method: str = FULL) -> dict[str, float]:
        """Mean length of a method's error as a percentage of the uncorrected one.

        Parameters
        ----------
        which : "clean" or "dirty"
        method : str, one of :data:`METHODS`
        """
        errors = self.errors[which]
        return {norm: 100 * errors[method][norm]["mean"] / errors["no correction"][norm]["mean"] for norm in NORMS}

    def gain(self, which: str, of: str) -> dict[str, float]:
        """Percentage by which a step of the recipe reduces the error's length, or its spread.

        Parameters
        ----------
        which : "clean" or "dirty"
        of : str, one of :data:`STEPS`
        """
        without, with_it, leaf = STEPS[of]
        before, after = self.errors[which][without], self.errors[which][with_it]
        return {norm: 100 * (1 - after[norm][leaf] / before[norm][leaf]) for norm in NORMS}


def table_one(log: CalibrationLog, settings: FitSettings, progress: Progress, parts: Parts) -> TableOne:
    """Fit the regressions on the first 80 % of the reaches and measure all methods on the others, if any (LogError).

    Parameters
    ----------
    log : CalibrationLog
    settings : FitSettings, what all fits have in common
    progress : Progress
    parts : Parts
        What an earlier run has done; the fit of the paper's last column is always made, for further figures need it.
    """
    full = run_experiment(log, replace(settings, **FITS[FULL]))
    parts.done(f"Table I: {FULL}", partial(_columns, full))
    tasks = {name: replace(settings, **changes) for name, changes in FITS.items()}
    found = parts.each("Table I", partial(fitted_columns, log), tasks, progress)
    return TableOne(columns_of(found), {name: columns["seconds"] for name, columns in found.items()}, full)


def columns_of(found: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Errors]]:
    """Return the columns of the table that some fits tell, by set.

    Parameters
    ----------
    found : mapping, what :func:`fitted_columns` returns, by the name of the fit
    """
    return {
        which: {name: found[fit][which][kind] for name, (fit, kind) in MEASURED.items() if fit in found}
        for which in SETS
    }


def fitted_columns(log: CalibrationLog, settings: FitSettings) -> dict[str, Any]:
    """Return the errors of one fit by set and kind ("raw", "rigid", "corrected"), and the seconds of the experiment.

    Parameters
    ----------
    log : CalibrationLog
    settings : FitSettings
    """
    return _columns(run_experiment(log, settings))


def held_out_of(experiment: Experiment) -> tuple[CalibrationLog, Evaluation]:
    """Return the held-out reaches and what was measured on them; LogError where nothing was held out.

    Parameters
    ----------
    experiment : Experiment
    """
    if experiment.evaluation is None or experiment.test is None:
        raise LogError("nothing was held out to measure on.")
    return experiment.test, experiment.evaluation


def _columns(experiment: Experiment) -> dict[str, Any]:
    test, evaluation = held_out_of(experiment)
    columns: dict[str, Any] = {"seconds": experiment.seconds}
    for which, measured in zip(SETS, (evaluation.clean, evaluation.dirty), strict=True):
        columns[which] = {kind: component_errors(measured.of(kind), test, measured.rows) for kind in KINDS}
    return columns


def component_errors(residual: FloatArray, test: CalibrationLog, rows: IntArray) -> Errors:
    """Return mean and SD of each component of errors and of their lengths, mm and deg.

    Parameters
    ----------
    residual : (n, 6) array, commanded minus given, m and rad
    test : CalibrationLog
    rows : (n,) int array, of the log
    """
    position, turns = 1e3 * residual[:, :3], np.rad2deg(_euler_errors(residual[:, 3:], test, rows))
    columns = dict(zip(COMPONENTS, [*position.T, *turns.T[::-1]], strict=True))
    columns |= {
        "position_mm": np.linalg.norm(position, axis=1),
        "rotation_deg": np.rad2deg(np.linalg.norm(residual[:, 3:], axis=1)),
    }
    return {name: {leaf: spread(values)[leaf] for leaf in ("mean", "sd")} for name, values in columns.items()}


def _euler_errors(turn: FloatArray, test: CalibrationLog, rows: IntArray) -> FloatArray:
    """Differences `(n, 3)` of roll, pitch and yaw between what was commanded and what a method gives, within +-pi.

    Angles about fixed x, y and z, as docs/conventions.md has them.
    """
    assert test.setpoint_cp is not None
    assert test.setpoint_cp.quaternion is not None
    R_command = se3.matrix_from_quaternion(test.setpoint_cp.quaternion[rows])
    R_given = np.swapaxes(se3.matrix_from_rotvec(turn), -1, -2) @ R_command
    commanded, given = (Rotation.from_matrix(R).as_euler("xyz") for R in (R_command, R_given))
    difference: FloatArray = commanded - given
    return difference - 2 * np.pi * np.round(difference / (2 * np.pi))
