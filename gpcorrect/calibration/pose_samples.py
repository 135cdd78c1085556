"""Complete samples of a log of poses, as the regression sees them, and the memory features that help it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples, evenly_spread, path_starts
from gpcorrect.calibration.memory import MemoryMap
from gpcorrect.calibration.poses import observed_twists, pose_pair, reference_twists, rotations_of
from gpcorrect.calibration.settings import JOINTS, LIMITS, MEMORY, FitSettings
from gpcorrect.errors import DataError, LogError
from gpcorrect.gpr import FeatureMap, LeftOut
from gpcorrect.rigid import Registration, RigidModel, pose_residual, register
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray, PoseSignal

INDUCING = 700
"""Points of the Gaussian process: within a tenth of 1500 points' error on simulated reaches (bench/gpr_choices.py)."""
CHECK_QUERIES = 8  # training queries that a model file asks again at load; chosen by hand
WORTH_IT = 0.02  # least fraction of the error that memory must take away not to be called useless; chosen by hand


@dataclass(frozen=True, eq=False)
class PosePairs:
    """The k samples of a log with both poses and a velocity: their rows, and where among them a path begins."""

    observed: PoseSignal
    command: PoseSignal
    twist: FloatArray
    rows: IntArray
    new: BoolArray

    @classmethod
    def of(cls, log: CalibrationLog, keep: BoolArray, velocity_step: float | None) -> Self:
        """Return the complete ones of a log's samples.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that are not rejected
        velocity_step : float or None, step of the stencil, s; None takes five neighbouring samples
        """
        observed, commanded = pose_pair(log)
        twist = observed_twists(log, observed, keep, velocity_step)
        rows = np.flatnonzero(keep & observed.finite & commanded.finite & np.isfinite(twist[:, :3]).all(axis=1))
        if rows.size < LIMITS.fewest_samples:
            raise LogError(
                f"only {rows.size} of {len(log)} samples can be learned from; at least {LIMITS.fewest_samples} are"
                " needed.",
                hint="Look at what is wrong with the recording: gpcorrect validate LOG; or keep everything: --no-clean",
                path=log.name,
            )
        new = path_starts(log.time[rows], log.session[rows], np.ones(len(rows), dtype=bool))
        return cls(observed[rows], commanded[rows], twist[rows], rows, new)

    @property
    def check_queries(self) -> FloatArray:
        """Training queries `(k, 13)` spread over the recording: pose (unturned in a position-only log) and twist."""
        rows = evenly_spread(len(self.rows), CHECK_QUERIES)
        observed = self.observed[rows]
        unturned = np.tile([1.0, 0.0, 0.0, 0.0], (len(rows), 1))
        quaternion = unturned if observed.quaternion is None else observed.quaternion
        return np.hstack([observed.position, quaternion, np.nan_to_num(self.twist[rows])])

    def register(self, log: CalibrationLog, settings: FitSettings) -> Registration:
        """Return the rigid model from the observer's frame to the command's.

        Parameters
        ----------
        log : CalibrationLog, that the samples are of
        settings : FitSettings, whether frames are registered, and whether the marker may be away from the tool tip
        """
        if not settings.rigid:
            return Registration(RigidModel(), "the registration was switched off", (), None)
        return register(self.observed, self.command, log.trajectory[self.rows], settings.marker)


def features_of(log: CalibrationLog, settings: FitSettings) -> tuple[tuple[str, ...], FeatureMap]:
    """Return the kinds of features, memory among them, and the map of the others; unknown ones are refused.

    Parameters
    ----------
    log : CalibrationLog, to learn from
    settings : FitSettings, Kinds, where the user names them
    """
    kinds = settings.features or (("pose",) if log.static else ("pose", "velocity"))
    if MEMORY in kinds and JOINTS in kinds:
        raise DataError("memory is of the pose, joints have a memory of their own: name one of the two.")
    return kinds, FeatureMap(tuple(kind for kind in kinds if kind not in (MEMORY, JOINTS)))


def pose_layout(features: FeatureMap, states: MemoryMap | None) -> Layout:
    """Return how the regression's columns are grouped: pose, velocity, memory.

    Parameters
    ----------
    features : FeatureMap, of poses and twists
    states : MemoryMap or None, of the memory features behind them, if any
    """
    groups, width = features.groups, features.n_features
    if states is not None:
        groups = (*groups, tuple(range(width, width + states.radii.size)))
    return Layout(
        targets=(3, 3) if features.has_orientation else (3,),
        inputs=groups,
        smooth=np.arange(sum(map(len, groups))),
        penalties=None,
        slack=features.slack,
        inducing=INDUCING,
        fading=np.array(features.groups[-1] if features.uses_velocity else (), dtype=np.int64),
    )


def samples_of_poses(
    pairs: PosePairs, log: CalibrationLog, rigid: RigidModel, features: FeatureMap, states: MemoryMap | None
) -> Samples:
    """Return the log as a law sees it: NaN where a sample is none of the pairs.

    Parameters
    ----------
    pairs : PosePairs, complete samples
    log : CalibrationLog, n samples
    rigid : RigidModel, from the observer's frame to the command's
    features : FeatureMap, of poses and twists
    states : MemoryMap or None, of the memory features behind them, if any
    """
    reference, rows, n = rigid.apply(pairs.observed), pairs.rows, len(log)
    moved = reference_twists(rigid, rotations_of(pairs.observed), pairs.twist)
    known = features.transform(reference.position, rotations_of(reference), moved)
    if states is not None:
        known = np.hstack([known, states.transform(pairs.command, reference, np.cumsum(pairs.new, dtype=np.int64))])
    size = 6 if features.has_orientation else 3
    X, target = np.full((n, known.shape[1]), np.nan), np.full((n, size), np.nan)
    begins, usable = np.zeros((2, n), dtype=bool)
    X[rows], begins[rows], usable[rows] = known, pairs.new, True
    target[rows] = pose_residual(reference, pairs.command)[:, :size]
    nothing = np.zeros((n, size))
    return Samples(log.time, log.trajectory, log.session, begins, X, target, nothing, usable, np.zeros((n, 0)))


def changes(with_it: LeftOut, without: LeftOut) -> FloatArray:
    """Return the relative change of the errors of positions and, where learned, rotations at left-out trajectories.

    Parameters
    ----------
    with_it, without : LeftOut, of two ways to answer the same log
    """
    sizes = [np.sqrt(np.nanmean(left_out.errors**2, axis=0)) for left_out in (with_it, without)]
    relative: FloatArray = (sizes[0] / sizes[1] - 1.0).reshape(-1, 3).mean(axis=1)
    return relative


def changes_text(change: FloatArray) -> str:
    """Return such changes in words.

    Parameters
    ----------
    change : (1,) or (2,) array, of position and rotation
    """
    parts = zip(("position", "rotation"), change, strict=False)
    return "error at left-out trajectories " + ", ".join(f"{100 * value:+.0f} % in {name}" for name, value in parts)


def require_poses(log: CalibrationLog) -> None:
    """Refuse, before any work, a log from which no correction of poses can be learned whatever the cleaning keeps.

    Parameters
    ----------
    log : CalibrationLog, to be learned from
    """
    pairs = PosePairs.of(log, np.ones(len(log), dtype=np.bool_), None)
    pairs.register(log, FitSettings(marker="none"))
