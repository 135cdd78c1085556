"""Ablations: a supposed cause is taken away, and the claim that it is blamed for is measured again.

Each returns figures in the places of the study's own, as far as it measures them. `claims.toml` says in words what each
takes away and which claims try it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from gpcorrect.calibration import Experiment, FitSettings, run_experiment
from gpcorrect.calibration.poses import pose_pair
from gpcorrect.cleaning import POSES, fit_cleaner
from gpcorrect.rigid import fit_pose, pose_residual
from gpcorrect.sim import Model, debridement_log, machine_of, preset
from gpcorrect.sim.reaches import DEBRIDEMENT_PRESET
from gpcorrect.sim.record import Fault
from gpcorrect.types import CalibrationLog, FloatArray, Progress
from gpcorrect_studies.mahler2014.closed_loop import closed_loop, places_to_visit, summary_of
from gpcorrect_studies.mahler2014.table1 import (
    FITS,
    FULL,
    OFFSET,
    SETS,
    WITH_GPR,
    WITH_VELOCITY,
    columns_of,
    component_errors,
    fitted_columns,
    held_out_of,
)
from gpcorrect_studies.parts import Parts

MEMORY_EFFECTS = ("coulomb_friction", "viscous_friction", "backlash")  # what the arm's past and speed leave behind
MUCH_LOST = 0.15  # of the training in which a fiducial is lost, five times the recording's own; chosen by hand
EARLY = 0.03  # s before its stop at which a path's last command is given; chosen by hand: one cycle of a camera


@dataclass(frozen=True, eq=False)
class Base:
    """What the study has measured already: its recording, settings, fit of the last column, and Table II's places."""

    log: CalibrationLog
    settings: FitSettings
    full: Experiment
    places: FloatArray
    repetitions: int


def ablations(base: Base, names: tuple[str, ...], progress: Progress, parts: Parts) -> dict[str, Any]:
    """Return the figures of the ablations by name.

    Parameters
    ----------
    base : Base
    names : tuple of str, of :data:`ABLATIONS`
    progress : Progress
    parts : Parts
    """
    figures = {}
    for done, name in enumerate(names):
        progress.step("ablations", done / len(names))
        figures[name] = parts.done(f"ablation: {name}", partial(ABLATIONS[name], base))
    progress.step("ablations", 1.0)
    return figures


def _no_memory(base: Base, *, noise: bool = True, faults: bool = True) -> dict[str, Any]:
    """Columns of an arm without play and friction, seen by a tracker without noise or faults too."""
    model = preset(DEBRIDEMENT_PRESET)
    model = model.with_effects(*(e for e in model.effects if e.to_dict()["name"] not in MEMORY_EFFECTS))
    model = model if noise else model.model_copy(update={"noise": None})
    return _columns(base, (WITH_GPR,), _recording(base, model=model, faults=faults))


def _true_poses(base: Base) -> dict[str, Any]:
    """Columns of the dirty set, of held-out samples whose desired pose is true."""
    experiments = {
        WITH_VELOCITY: run_experiment(base.log, replace(base.settings, **FITS[WITH_VELOCITY])),
        FULL: base.full,
    }
    columns = {}
    for name, experiment in experiments.items():
        test, evaluation = held_out_of(experiment)
        dirty = evaluation.dirty
        good = test.extra["fault"][dirty.rows] == Fault.GOOD
        columns[name] = component_errors(dirty.corrected[good], test, dirty.rows[good])
    return {"table1": {"dirty": columns}}


def _recording(base: Base, *, model: Model | None = None, faults: bool = True) -> CalibrationLog:
    reaches = len(base.log.trajectory_ids)
    return debridement_log(base.settings.seed, reaches=reaches, model=model, faults=faults)


def _columns(base: Base, fits: tuple[str, ...], log: CalibrationLog) -> dict[str, Any]:
    return {"table1": columns_of({fit: fitted_columns(log, replace(base.settings, **FITS[fit])) for fit in fits})}


def _least_squares(base: Base, *, lost: float | None = None) -> dict[str, Any]:
    """Return fixed offsets by the paper's least squares, from all training samples and from those that pass.

    `lost` is the fraction of the training in which a fiducial is lost; the recording's own when None.
    """
    test, evaluation = held_out_of(base.full)
    train, keep = base.full.fit.log, base.full.fit.cleaning.keep
    if lost is not None:
        model = preset(DEBRIDEMENT_PRESET)
        assert model.faults is not None
        model = model.model_copy(update={"faults": model.faults.model_copy(update={"lost_share": lost})})
        log = _recording(base, model=model)
        train = log.select(~np.isin(log.trajectory, test.trajectory_ids))
        rng = np.random.default_rng(base.settings.seed)
        keep = fit_cleaner(train, base.settings.cleaning, rng=rng, pair=POSES, marker="none")[1].keep
    observed, command = pose_pair(train)
    finite = observed.finite & command.finite
    seen, wanted = pose_pair(test)
    table: dict[str, dict[str, Any]] = {which: {} for which in SETS}
    for name, rows in ((OFFSET, finite), (f"{OFFSET} + cleaning", finite & keep)):
        rigid = fit_pose(observed[rows], command[rows])
        for which in SETS:
            held_out = getattr(evaluation, which).rows
            residual = pose_residual(rigid.apply(seen[held_out]), wanted[held_out])
            table[which][name] = component_errors(residual, test, held_out)
    return {"table1": table}


def _ends_early(base: Base) -> dict[str, Any]:
    """Table II with corrected paths whose last command is one of a moving arm."""
    rng, end = np.random.default_rng([base.settings.seed, 6]), float(base.log.time[-1])
    machine = machine_of(preset(DEBRIDEMENT_PRESET))
    corrector = base.full.corrector
    places = places_to_visit(base.full, len(base.places) - 1, rng)  # drawn again, so that they are visited as before
    landings = closed_loop(corrector, machine, places, base.repetitions, end, rng, early=EARLY)
    return {"table2": {name: {"at_rest": summary_of(landing["at_rest"])} for name, landing in landings.items()}}


ABLATIONS: Mapping[str, Callable[[Base], dict[str, Any]]] = {
    "no play or friction": _no_memory,
    "no play, friction or faults": partial(_no_memory, faults=False),
    "no play, friction, faults or noise": partial(_no_memory, faults=False, noise=False),
    "no faults": lambda base: _columns(base, (WITH_VELOCITY, FULL), _recording(base, faults=False)),
    "true poses": _true_poses,
    "least squares": _least_squares,
    "least squares, more lost": partial(_least_squares, lost=MUCH_LOST),
    "paths end early": _ends_early,
}
