"""The rigid model a recording calls for: the simplest that predicts left-out trajectories as well as any."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.rigid.handeye import fit_marker, fit_separate, require_observable
from gpcorrect.rigid.model import RigidKind, RigidModel, pose_residual
from gpcorrect.rigid.observability import Observability, rotation_observability
from gpcorrect.rigid.registration import check_pair, evenly_spaced, fit_balanced, fit_pose, fit_robustly
from gpcorrect.robust import MAD_TO_STD, medians_of
from gpcorrect.types import FloatArray, IntArray, PoseSignal

MarkerOption = Literal["none", "solve", "auto"]

Fit = Callable[[PoseSignal, PoseSignal, RigidModel | None], RigidModel]
"""Of observed and commanded poses, and the solution of nearly the same ones where there is one."""

FOLDS = 5  # the usual number for choosing between models
BLOCKS = 10  # parts of a recording that has too few trajectories to leave some out
LEAST_BLOCK = 3  # samples
MAX_SAMPLES = 1000  # in a fold's fit, or a first one: enough to rank the kinds
MAX_JUDGED, LEAST_JUDGED = 200, 20  # in each unit, for its median
MOST_JUDGED = 6000  # in all units, but for the least of each: their medians are then compared by a median again
# Standard error of a median from the median absolute deviation of normal data.
ONE_MEDIAN = math.sqrt(math.pi / 2) * MAD_TO_STD
LEAST_ERROR = 1e-6  # m and rad: errors below a micrometre or microradian are not distinguished


@dataclass(frozen=True)
class Candidate:
    """How one kind of model did on left-out trajectories.

    Parameters
    ----------
    kind : str, kind of the model
    position_mm, rotation_deg : float
        Median over the left-out trajectories of the median error in each; NaN where it does not apply.
    score : float, mean of both errors, each divided by the least of all candidates: 1 is best in both
    refused : str, why it could not be fitted; empty when it could
    """

    kind: RigidKind
    position_mm: float
    rotation_deg: float
    score: float
    refused: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return the numbers by name, None for those that do not apply."""
        numbers = {name: getattr(self, name) for name in ("position_mm", "rotation_deg", "score")}
        finite = {name: value if np.isfinite(value) else None for name, value in numbers.items()}
        return {"kind": self.kind, **finite, "refused": self.refused}


@dataclass(frozen=True, eq=False)
class Registration:
    """A rigid model and why it was chosen.

    Parameters
    ----------
    model : RigidModel, fitted to all samples
    reason : str, why this kind, in one sentence
    candidates : tuple of Candidate, every kind that was tried, from the simplest
    observability : Observability or None
        What the recorded rotations say of a marker offset; None where no orientations were observed.
    """

    model: RigidModel
    reason: str
    candidates: tuple[Candidate, ...]
    observability: Observability | None

    def to_dict(self) -> dict[str, Any]:
        """Return model, reason, candidates and observability as plain lists, numbers and text."""
        return {
            "model": self.model.to_dict(),
            "reason": self.reason,
            "candidates": [c.to_dict() for c in self.candidates],
            "observability": None if self.observability is None else self.observability.to_dict(),
        }


def register(
    observed: PoseSignal,
    command: PoseSignal,
    trajectory: IntArray,
    marker: MarkerOption = "none",
    *,
    held_out: bool = True,
) -> Registration:
    """Rigid model of the recording, with what was tried and why it was chosen.

    "none" is the registration of :func:`fit_pose`, "solve" that of :func:`fit_marker`. "auto" compares
    identity, pose (or position), marker and separate, each fitted robustly, on left-out trajectories (five
    folds; blocks of the recording where there are fewer trajectories). The score of a kind in a trajectory
    is the mean of its median position and rotation errors there, each divided by the least that any kind
    reaches as median over the trajectories; the median score ranks. The simplest kind is chosen whose
    excess over the best, trajectory by trajectory, is within one standard error.

    Parameters
    ----------
    observed, command : PoseSignal, n samples each, all finite
    trajectory : (n,) int array
    marker : {"none", "solve", "auto"}, whether the marker may be another point of the tool than its tip
    held_out : bool
        Whether kinds are judged on trajectories that they were not fitted to. A first registration, before cleaning,
        does without: a dozen unknowns fit thousands of samples little better than others, and it takes a fifth of the
        time.

    Raises
    ------
    DataError
        An unknown option, signals of unequal length, missing samples.
    DegenerateError
        Data that do not determine the model asked for; "auto" falls back to simpler ones instead.
    """
    if marker not in get_args(MarkerOption):
        raise DataError(f"marker must be one of {', '.join(get_args(MarkerOption))}, got {marker!r}.")
    check_pair(observed, command)
    if marker == "solve":
        require_observable(observed, command)
    fits = _fits(observed, command, marker)
    if len(trajectory) != len(observed):
        raise DataError(f"{len(observed)} samples need a trajectory each, got {len(trajectory)}.")
    units = hold_out_units(np.asarray(trajectory))
    if marker == "auto" and units.max() == 0:
        raise DegenerateError(
            f"choosing by left-out samples needs at least {2 * LEAST_BLOCK} samples, got {len(observed)}.",
            hint='Record more, or say which registration to use: marker="none" or "solve".',
        )
    folds = min(FOLDS, int(units.max()) + 1) if held_out else 1
    few = slice(None) if held_out else evenly_spaced(len(observed), MAX_SAMPLES)
    wholes = {kind: _attempted(fit, observed[few], command[few]) for kind, fit in fits.items()}
    tried = [_errors(kind, fits[kind], whole, observed, command, units, folds) for kind, whole in wholes.items()]
    scores = _scores(tried)
    chosen, reason = _choose(tried, scores, marker)
    if isinstance(model := wholes[chosen], DegenerateError):
        raise model
    return Registration(
        model=model,
        reason=reason,
        candidates=tuple(
            Candidate(
                errors.kind,
                position_mm=1e3 * float(np.median(errors.position)),
                rotation_deg=float(np.degrees(np.median(errors.rotation))),
                score=float(np.median(score)),
                refused=errors.refused,
            )
            for errors, score in zip(tried, scores, strict=True)
        ),
        observability=rotation_observability(observed, command),
    )


@dataclass(frozen=True, eq=False)
class _UnitErrors:
    """Held-out errors of one kind of model, one row a unit (a trajectory, or a block of a single one)."""

    kind: RigidKind  # kind of the model
    position: FloatArray  # (m,) median position error in each unit, m; NaN where the kind was refused
    rotation: FloatArray  # (m,) median rotation error in each unit, rad; NaN where there are no orientations
    refused: str = ""  # why the kind could not be fitted; empty when it could


def _fits(observed: PoseSignal, command: PoseSignal, marker: MarkerOption) -> Mapping[RigidKind, Fit]:
    """Return the kinds to compare, simplest first; the last is what "none" and "solve" ask for."""
    has_orientation = observed.quaternion is not None and command.quaternion is not None
    plain: RigidKind = "pose" if has_orientation else "position"
    fits: dict[RigidKind, Fit] = {
        "identity": lambda observed, command, near: RigidModel(),
        plain: lambda observed, command, near: fit_pose(observed, command),
    }
    if marker == "none":
        return fits
    fits[plain] = fit_balanced if has_orientation else fit_robustly
    if observed.quaternion is not None:
        fits["marker"] = fit_marker
    if marker == "auto" and has_orientation:
        fits["separate"] = fit_separate
    return fits


def _scores(tried: list[_UnitErrors]) -> list[FloatArray]:
    """Score `(m,)` of each kind in each unit, in units of the least median of any; NaN where the kind was refused."""
    ratios = []
    for part in (np.array([errors.position for errors in tried]), np.array([errors.rotation for errors in tried])):
        if np.isfinite(part).any():
            fitted = part[np.isfinite(part).all(axis=1)]
            ratios.append(part / max(float(np.median(fitted, axis=1).min()), LEAST_ERROR))
    return list(np.mean(ratios, axis=0))


def _choose(tried: list[_UnitErrors], scores: list[FloatArray], marker: MarkerOption) -> tuple[RigidKind, str]:
    if marker != "auto":
        return tried[-1].kind, f'{tried[-1].kind} as asked for by marker="{marker}".'
    fitted = [index for index, errors in enumerate(tried) if not errors.refused]
    if fitted == [0]:
        raise DegenerateError(
            tried[1].refused,
            hint="Record motion that fills the workspace, with orientations where the tracker has them.",
        )
    best = min(fitted, key=lambda index: float(np.median(scores[index])))
    chosen = next(index for index in fitted if _within_one_error(scores[index], scores[best]))
    return tried[chosen].kind, _reason(tried, scores, best, chosen)


def _within_one_error(score: FloatArray, best: FloatArray) -> bool:
    """Whether the median excess over the best, unit by unit, is within its standard error."""
    excess = score - best
    middle = float(np.median(excess))
    error = ONE_MEDIAN * float(np.median(np.abs(excess - middle))) / np.sqrt(len(excess))
    return bool(middle <= error)


def _reason(tried: list[_UnitErrors], scores: list[FloatArray], best: int, chosen: int) -> str:
    rank = [f"{np.median(score):.3g}" for score in scores]
    why = f"{tried[chosen].kind} predicts left-out trajectories best (score {rank[chosen]})"
    if chosen != best:
        why = (
            f"{tried[chosen].kind} (score {rank[chosen]}) is the simplest within one standard error of the "
            f"best, {tried[best].kind} ({rank[best]}), on left-out trajectories"
        )
    refused = [f"; {errors.kind} was refused: {errors.refused}" for errors in tried if errors.refused]
    return why + "".join(refused)


def hold_out_units(trajectory: IntArray) -> IntArray:
    """Return the unit `(n,)` of each sample, in recorded order: its trajectory, or its block.

    Samples of one motion repeat each other, so whole trajectories are left out where there are at least as
    many as folds; otherwise the recording is cut into contiguous blocks.

    Parameters
    ----------
    trajectory : (n,) array
    """
    _, first, label = np.unique(trajectory, return_index=True, return_inverse=True)
    if len(first) >= FOLDS:
        rank: IntArray = np.argsort(np.argsort(first))
        return rank[label.reshape(-1)]
    n = len(trajectory)
    blocks = max(min(BLOCKS, n // LEAST_BLOCK), 1)
    return np.arange(n) * blocks // max(n, 1)


def _attempted(
    fit: Fit, observed: PoseSignal, command: PoseSignal, near: RigidModel | None = None
) -> RigidModel | DegenerateError:
    """Return the model, or why the samples do not determine it."""
    try:
        return fit(observed, command, near)
    except DegenerateError as error:
        return error


def _errors(
    kind: RigidKind,
    fit: Fit,
    whole: RigidModel | DegenerateError,
    observed: PoseSignal,
    command: PoseSignal,
    units: IntArray,
    folds: int,
) -> _UnitErrors:
    """Errors in each unit of the model fitted without its fold, a run of neighbouring units; of a single fold, with it.

    A kind that the data, or some fold's, do not determine is refused as a whole.
    """
    n_units = int(units.max()) + 1
    position, rotation = np.full(n_units, np.nan), np.full(n_units, np.nan)
    rows_of = np.split(np.argsort(units, kind="stable"), np.cumsum(np.bincount(units))[:-1])
    most = min(MAX_JUDGED, max(LEAST_JUDGED, MOST_JUDGED // n_units))
    judged = [rows[evenly_spaced(len(rows), most)] for rows in rows_of]
    for fold in range(folds):
        held, model = units * folds // n_units == fold, whole
        if folds > 1 and isinstance(whole, RigidModel):
            rows = np.flatnonzero(~held)
            rows = rows[evenly_spaced(len(rows), MAX_SAMPLES)]
            model = _attempted(fit, observed[rows], command[rows], whole)
        if isinstance(model, DegenerateError):
            nothing = np.full(n_units, np.nan)
            return _UnitErrors(kind, nothing, nothing, refused=model.message)
        asked = np.unique(units[held])
        position[asked], rotation[asked] = _median_errors(model, observed, command, [judged[unit] for unit in asked])
    return _UnitErrors(kind, position, rotation)


def _median_errors(
    model: RigidModel, observed: PoseSignal, command: PoseSignal, units: list[IntArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the median position and rotation error in each unit, given by its rows."""
    rows, label = np.concatenate(units), np.repeat(np.arange(len(units)), [len(unit) for unit in units])
    residual = pose_residual(model.apply(observed[rows]), command[rows])
    position, rotation = (
        medians_of(np.linalg.norm(part, axis=1), label) for part in (residual[:, :3], residual[:, 3:])
    )
    return position, rotation
