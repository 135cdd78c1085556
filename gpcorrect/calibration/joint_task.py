"""What is learned from a log of joints, before it is: which joints go in, what they show, what a person should know."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gpcorrect.calibration.dataset import Layout, Samples
from gpcorrect.calibration.joint_features import JointFeatures
from gpcorrect.calibration.joint_path import effort_kind, usual_steps
from gpcorrect.calibration.joint_view import JointView, directed, joint_layout, path_and_error
from gpcorrect.calibration.settings import LIMITS, FitSettings, InputSignal
from gpcorrect.calibration.stops import Stops
from gpcorrect.errors import DataError, DegenerateError, LogError
from gpcorrect.logs import validate_log
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

LEAST_MOTION = {"R": 1e-5, "P": 1e-6}  # rad and m: a joint that moves less shows its encoder's noise; chosen by hand
INDUCING = 500  # points of the Gaussian process; by hand


@dataclass(frozen=True, eq=False)
class JointTask:
    """What is learned from a log of joints, before it is."""

    view: JointView  # what is seen of a log
    samples: Samples  # the log as a law sees it
    source: FloatArray  # (n, d) joints that go in, back at their stops, rad or m
    offset: FloatArray  # (k,) mean of what is to be added to those that move
    steps: tuple[float, float]  # usual and shortest time between samples, s
    still: tuple[int, ...]  # joints that never move, counted from 1
    remarks: tuple[str, ...]

    @property
    def layout(self) -> Layout:
        """How features and targets are grouped."""
        return joint_layout(self.view.features, len(self.view.moving), owned=True, inducing=INDUCING)

    @classmethod
    def of(cls, log: CalibrationLog, keep: BoolArray, settings: FitSettings, *, searched: bool = True) -> Self:
        """Return what a log shows.

        Parameters
        ----------
        log : CalibrationLog, n samples
        keep : (n,) mask, samples that are not rejected
        settings : FitSettings
        searched : bool, whether the play is searched for, see :meth:`JointFeatures.learn`
        """
        remarks = list(_remarks(log))
        signal = input_signal_of(log, settings)
        if settings.direction == "command" and settings.input_signal is None and log.measured_jp is not None:
            why = "which the robot was sent; from what it reports: --input measured_jp"
            why = why if signal == "setpoint_jp" else "for what the robot was sent, setpoint_jp, is not logged"
            remarks.append(f"commands are learned from {signal}, {why}")
        source, truth, rows = complete_rows(log, signal, settings.direction, keep)
        types = log.joint_types(source.shape[1])
        if not log.meta.joint_types:
            slides = "all joints turn (rad)" if "P" not in types else "joint 3 slides (m) and the others turn (rad)"
            example = 'joint_types = "RRPR"'
            remarks.append(f"joint_types are not named: taken that {slides}. Name them beside the log: {example}")
        moving = _moving(source[rows], types)
        still = tuple(j + 1 for j in range(len(types)) if j not in moving)
        if still:
            remarks.append(f"joint {', '.join(map(str, still))} never moves in training: left uncorrected")
        kinds = settings.features or _default_features(log, settings, len(types), moving)
        sent, ended = (source, truth) if settings.direction == "estimate" else (truth, source)
        stops = Stops.of(sent, ended)
        path, error = path_and_error(log, source, truth, keep, stops, moving, settings.direction, kinds)
        if stops is not None:
            remarks += stops.remarks(sent, types, signal)
            source = stops.reached(source)
        missed = np.abs(truth - source)[np.ix_(rows, np.setdiff1d(np.arange(len(types)), moving))]
        features = JointFeatures.learn(kinds, path, error, rows, searched=searched)
        view = JointView(
            direction=settings.direction,
            input_signal=signal,
            types=types,
            moving=moving,
            rest=np.median(source[rows], axis=0),
            features=features,
            end_to_end=settings.end_to_end and settings.method != "ukf",
            stops=stops,
            state_names=path.state_names,
            missed=np.percentile(missed, LIMITS.range_quantiles[1], axis=0),
        )
        samples = replace(view.samples(path, log.trajectory, error, keep), session=log.session)
        remarks += features.remarks((moving + 1).tolist())
        return cls(view, samples, source, error[rows].mean(axis=0), usual_steps(path), still, tuple(remarks))


def require_joints(log: CalibrationLog) -> None:
    """Refuse, before any work, a log from which no joint calibration can be learned.

    Parameters
    ----------
    log : CalibrationLog, to be learned from
    """
    source, _, rows = complete_rows(log, input_signal_of(log, FitSettings()), "estimate", np.ones(len(log), dtype=bool))
    _moving(source[rows], log.joint_types(source.shape[1]))


def input_signal_of(log: CalibrationLog, settings: FitSettings) -> InputSignal:
    """Return the signal of the robot's side: what it reports, or for commands what it was sent, where that is logged.

    A robot is commanded by setpoints, and its servo follows them late: a law of what it reports is blind to that.

    Parameters
    ----------
    log : CalibrationLog
    settings : FitSettings
    """
    wanted: tuple[InputSignal, ...] = ("measured_jp", "setpoint_jp")
    logged = [n for n in (wanted if settings.direction == "estimate" else wanted[::-1]) if n in log.signals]
    return settings.input_signal or (logged[0] if logged else "setpoint_jp")


def _default_features(log: CalibrationLog, settings: FitSettings, dof: int, moving: IntArray) -> tuple[str, ...]:
    """Return the method's own choice: positions and, where logged, efforts; for the Gaussian process the past too."""
    if settings.method == "offset":
        return ("position",)
    logged = effort_kind(log, dof, moving) if settings.direction == "estimate" else ()
    past = ("velocity", "acceleration", "memory", "lags")
    return ("position", *logged, *(past if settings.method in ("gp", "trees", "auto") and not log.static else ()))


def complete_rows(
    log: CalibrationLog, signal: InputSignal, direction: str, keep: BoolArray
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return joints that go in and come out, `(n, d)` each, and the rows that are complete.

    Parameters
    ----------
    log : CalibrationLog, n samples
    signal, direction : str, see :func:`directed`
    keep : (n,) mask, samples that are not rejected
    """
    source, truth = directed(log, signal, direction)
    assert truth is not None
    rows = np.flatnonzero(keep & np.isfinite(source).all(axis=1) & np.isfinite(truth).all(axis=1))
    if rows.size < LIMITS.fewest_samples:
        raise DataError(
            f"a joint calibration needs at least {LIMITS.fewest_samples} complete samples, got {rows.size}.",
            hint="Look at what is wrong with the recording: gpcorrect validate LOG",
        )
    return source, truth, rows


def _moving(q: FloatArray, types: str) -> IntArray:
    """Return the joints `(k,)` that move."""
    span = np.ptp(q, axis=0)
    moving: IntArray = np.flatnonzero([span[j] >= LEAST_MOTION[kind] for j, kind in enumerate(types)])
    if moving.size == 0:
        raise DegenerateError(
            "no joint ever moves in the training data: no error can be learned.",
            hint="Record motion of every joint. See: gpcorrect zigzag --help",
        )
    return moving


def _remarks(log: CalibrationLog) -> tuple[str, ...]:
    """Return what is odd but bearable about a log's joints, a sentence each."""
    for number, rows in log.trajectories():
        sessions = np.unique(log.session[rows])
        if len(sessions) > 1:
            raise LogError(
                f"trajectory {number} runs through sessions {', '.join(map(str, sessions))}: a homing lies inside it.",
                hint="Number the motions before and after the homing apart in the `trajectory` column.",
                path=log.name,
            )
    report = validate_log(log, ("joint_limits",))
    if report.errors:
        raise LogError(report.errors[0].message, hint=report.errors[0].hint, path=log.name)
    return tuple(f"{finding.signal}: {finding.message}" for finding in report.findings)
