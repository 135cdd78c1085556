"""Sessions of one log that err apart from each other, or that cleaning rejects: frames moved, or a homing between."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import fdtrc  # scipy.stats has it too, and takes half a second to import

from gpcorrect.calibration.dataset import Samples, of_few, pieces
from gpcorrect.calibration.settings import LIMITS
from gpcorrect.calibration.task import Part
from gpcorrect.cleaning import CleaningReport, Reason
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray


def sessions_apart(
    log: CalibrationLog,
    rows: IntArray,
    errors: FloatArray,
    left: FloatArray,
    parts: Sequence[Part],
    *,
    wide: bool | None = None,
) -> tuple[str, ...]:
    """Return a note where what is not predicted differs from session to session by more than motions differ in one.

    One-way analysis of variance of the mean errors of motions, component by component. A log whose sessions lie apart
    by a small part of the error is left in peace, however certain that is.

    Parameters
    ----------
    log : CalibrationLog, n samples
    rows : (k,) int array, samples that were predicted
    errors : (k, m) array, of predictions at motions that were not learned from, m and rad; NaN where none is
    left : (k, m) array, what was to be predicted: by this the distance between sessions is quoted
    parts : sequence of Part, components that are quoted together: position and rotation, or each joint
    wide : bool, optional, whether intervals were calibrated on sessions that were left out; None says nothing of them
    """
    columns = [column for part in parts for column in part.columns]
    known = np.isfinite(errors[:, columns]).all(axis=1) & np.isfinite(left[:, columns]).all(axis=1)
    rows, errors, left = rows[known], errors[known], left[known]
    motion = pieces(log.time[rows], log.trajectory[rows])
    names, means, session = _means(log.session[rows], motion, np.hstack([errors, left]))
    if len(names) < 2:
        return ()
    width = errors.shape[1]
    differ = [part for part in parts if _differ(means[:, part.columns], session, errors[:, part.columns], width)]
    if not differ:
        return ()
    centres = np.array([means[session == name, width:].mean(axis=0) for name in names])
    found = " and ".join(_farthest(names, centres, part) for part in differ)
    hold = "" if wide is None else f"; intervals {'are wide enough for' if wide else 'do not hold in'} a new one"
    return (
        f"{found}, more than motions of one session differ: the sensor's frame or the base was moved, or the robot was "
        f"homed anew, and one model answers for none of them well{hold}. Fit them apart, or see what a new session "
        "costs: --hold-out-by session",
    )


def widening(samples: Samples, errors: FloatArray, groups: Sequence[int]) -> FloatArray:
    """Return by how much `(m,)` intervals are too narrow that the motions, or sessions that lie apart, tell of.

    Parameters
    ----------
    samples : Samples, of which k may be learned from
    errors : (k, m) array, of predictions at folds that were not learned from; NaN where none is
    groups : sequence of int, how many outputs in turn belong together
    """
    wider, out = np.full(errors.shape[1], samples.widening), samples.sessions_left_out
    known = np.isfinite(errors).all(axis=1)
    if out is None or not known.any():
        return wider
    rows = samples.rows[known]
    motion = pieces(samples.time[rows], samples.trajectory[rows])
    names, means, session = _means(out[known], motion, errors[known])
    for part in np.split(np.arange(len(wider)), np.cumsum(groups)[:-1]):
        if len(names) > 1 and _differ(means[:, part], session, errors[np.ix_(known, part)], len(wider)):
            wider[part] = of_few(len(np.unique(out)))
    return wider


def sessions_lost(log: CalibrationLog, cleaning: CleaningReport) -> tuple[str, ...]:
    """Return a note for each session most of which cleaning rejects, where most of another one passes.

    Parameters
    ----------
    log : CalibrationLog, n samples
    cleaning : CleaningReport, of these; what is no number, or was dropped by hand, does not count
    """
    counted = ~np.isin(cleaning.reason, (Reason.INVALID, Reason.MANUAL))
    names = np.unique(log.session[counted])
    rows = [counted & (log.session == name) for name in names]
    lost = [bool(np.mean(~cleaning.keep[mine]) > LIMITS.lost_session) for mine in rows]
    if all(lost):
        return ()
    return tuple(
        _lost(log, cleaning, mine, int(name)) for name, mine, gone in zip(names, rows, lost, strict=True) if gone
    )


def _lost(log: CalibrationLog, cleaning: CleaningReport, mine: BoolArray, name: int) -> str:
    first, last = log.trajectory[mine].min(), log.trajectory[mine].max()
    return (
        f"cleaning rejects {np.count_nonzero(mine & ~cleaning.keep)} of {np.count_nonzero(mine)} samples of session "
        f"{name} (trajectories {first} to {last}; files are sessions in the order given, from 0), which is hardly "
        "learned from: the tracker's frame, the base or the tool was moved, or the robot was homed anew. The model and "
        "its errors are of the other sessions: fit this one apart"
    )


def _means(session: IntArray, motion: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray, IntArray]:
    """Return the sessions of two motions or more, and the mean values of their motions with the session of each."""
    labels, first, index, count = np.unique(motion, return_index=True, return_inverse=True, return_counts=True)
    means = np.zeros((len(labels), values.shape[1]))
    np.add.at(means, index, values)
    session = session[first]
    names, motions = np.unique(session, return_counts=True)
    names = names[motions > 1]
    told = np.isin(session, names)
    return names, (means / count[:, None])[told], session[told]


def _differ(means: FloatArray, session: IntArray, errors: FloatArray, width: int) -> bool:
    """Whether a part of m = `width` components lies apart by session: surely, and by a good part of its errors."""
    total, within = ((means - means.mean(axis=0)) ** 2).sum(axis=0), np.zeros(means.shape[1])
    names = np.unique(session)
    for name in names:
        of_one = means[session == name]
        within += ((of_one - of_one.mean(axis=0)) ** 2).sum(axis=0)
    freedom = len(names) - 1, len(means) - len(names)
    between = total - within
    ratio = (between / freedom[0]) / np.maximum(within / freedom[1], np.finfo(float).tiny)
    sure = fdtrc(*freedom, ratio) < LIMITS.apart_chance / width
    return bool(sure.any() and between.sum() / len(means) > LIMITS.apart_fraction * (errors**2).mean(axis=0).sum())


def _farthest(names: IntArray, centres: FloatArray, part: Part) -> str:
    """Say which two sessions lie farthest from each other, and by how much."""
    apart = part.scale * np.linalg.norm((centres[:, None] - centres)[:, :, part.columns], axis=2)
    one, other = sorted(np.unravel_index(int(apart.argmax()), apart.shape))
    return f"{part.name}: session {names[other]} lies {apart[one, other]:.2g} {part.unit} from session {names[one]}"
