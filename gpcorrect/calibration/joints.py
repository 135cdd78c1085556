"""Joints: from reported positions to true ones, or from desired true positions to commands (Peng et al., RAVEN-II)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from gpcorrect.calibration.dataset import Samples
from gpcorrect.calibration.history import step_now
from gpcorrect.calibration.joint_path import joint_path
from gpcorrect.calibration.joint_task import JointTask, complete_rows, input_signal_of
from gpcorrect.calibration.joint_view import JointView, ViewCorrector, directed
from gpcorrect.calibration.law import Prediction
from gpcorrect.calibration.leaps import Apart
from gpcorrect.calibration.metrics import joint_units, spread
from gpcorrect.calibration.queries import checked_times, numbers
from gpcorrect.calibration.sessions import sessions_apart
from gpcorrect.calibration.settings import FitSettings
from gpcorrect.calibration.stream import JointStream
from gpcorrect.calibration.task import LearnLaw, Measured, Outcome, Part
from gpcorrect.calibration.training_motion import UNITS, TrainingMotion
from gpcorrect.cleaning import FittedCleaner, Pair, joint_pair
from gpcorrect.correction import Correction
from gpcorrect.errors import DataError
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray

LEAST_RUN_SECONDS = 5.0  # s of motion from which zeros are set anew; chosen by hand
MOVED_STDS = 1.0  # a mean error of this many standard deviations of the model is beyond chance; chosen by hand
MOST_LEFT = 0.5  # of an error, that a new zero may leave: homings left 0.1 to 0.3 of it, other motion 0.6 and more


@dataclass(frozen=True, eq=False, kw_only=True)
class JointCorrector(ViewCorrector):
    """What was learned of one arm's joints.

    Parameters
    ----------
    view : JointView, which joints go in, and what comes out
    offset : (k,) array, mean error in training: what a fixed offset would have corrected
    """

    KIND: ClassVar[str] = "gpcorrect.joint_corrector"
    TASK: ClassVar[str] = "joints"
    METHODS: ClassVar[tuple[str, str, str]] = ("raw", "fixed_offset", "corrected")
    CHECK_SAMPLES: ClassVar[int] = 12  # chosen by hand

    view: JointView
    offset: FloatArray

    def __post_init__(self) -> None:
        sizes = {"offset": len(self.offset), "zero": len(self.law.zero), "moving": len(self.view.moving)}
        moved = len(self.trained.low)
        if len(set(sizes.values())) > 1 or np.ndim(self.offset) != 1 or moved != len(self.view.types):
            raise DataError(
                f"a model of {len(self.view.types)} joints does not fit together: {sizes}, trained on {moved}."
            )

    @classmethod
    def pair(cls, log: CalibrationLog, settings: FitSettings) -> Pair:
        """See :class:`Corrector`."""
        name = input_signal_of(log, settings)
        complete_rows(log, name, settings.direction, np.ones(len(log), dtype=bool))
        return joint_pair(name)

    @property
    def types(self) -> str:
        """Types of the joints, R or P each."""
        return self.view.types

    def in_joint_order(self, log: CalibrationLog) -> CalibrationLog:
        """See :class:`Corrector`; joints whose types the log does not name are of the training's types."""
        log = super().in_joint_order(log)
        widths = {getattr(log, name).shape[1] for name in log.JOINTS if name in log.signals}
        if log.meta.joint_types or widths != {len(self.types)}:
            return log
        return replace(log, meta=replace(log.meta, joint_types=self.types))

    def info(self) -> dict[str, Any]:
        """See :class:`Corrector`; with the types of the joints."""
        return {**super().info(), "types": self.types}

    @property
    def zero(self) -> FloatArray:
        """Zeros `(d,)` that are added to every answer, rad or m."""
        return np.asarray(np.nan_to_num(self.view.wide(self.law.zero[None])[0]))

    def correct_path(
        self,
        q: ArrayLike,
        times: ArrayLike,
        efforts: ArrayLike | None = None,
        sessions: ArrayLike | None = None,
        *,
        from_middle: bool = False,
        along: ArrayLike | None = None,
    ) -> Correction:
        """Return the true joints of a path of reported ones, or what to command, by the model's direction.

        Until the path has crossed their slack, intervals allow for joints having begun on either side of it.

        Parameters
        ----------
        q : (n, d) array, rad or m; NaN where missing
        times : (n,) array, seconds, increasing within a session
        efforts : (n, d) array, optional, as logged, for models that look at them
        sessions : (n,) int array, optional, where the number changes, the arm was homed or moved by hand
        from_middle : bool, whether joints are known to begin in the middle of their slack
        along : (n, d) array, optional
            The path whose velocities count, where that is not `q`: commands that were moved at will, rad or m.

        Returns
        -------
        Correction
            Of n rows.

        Raises
        ------
        DataError
            The numbers do not fit the model, or the times do not increase, or cannot be seconds.
        """
        joints = numbers(q, "joints")
        if joints.ndim != 2 or joints.shape[1] != len(self.types):
            raise DataError(f"the model knows {len(self.types)} joints, got an array of shape {joints.shape}.")
        n, moving = len(joints), self.view.moving
        homed: IntArray = np.zeros(n, dtype=np.int64)
        if sessions is not None:
            homed = np.unique(numbers(sessions, "sessions"), return_inverse=True)[1]
        effort = None if efforts is None else numbers(efforts, "efforts")
        going = self.view.reached(joints) if along is None else numbers(along, "joints to go along")
        if homed.shape != (n,) or going.shape != joints.shape or (effort is not None and effort.shape != joints.shape):
            raise DataError(f"a path of {n} samples needs {n} sessions and as many rows of efforts as of joints.")
        seconds = checked_times(times, n, homed)
        self.trained.refuse_far(joints, UNITS)
        self.trained.refuse_slow(joints, seconds, homed)
        apart = Apart.of(self.pace, joints, seconds, homed)
        if apart is not None:
            joints, seconds, homed = joints[apart.order], seconds[apart.order], apart.session
            effort = None if effort is None else effort[apart.order]
            going = going[apart.order]
        effort = None if effort is None else effort[:, moving]
        path = joint_path(seconds, homed, self.view.reached(joints)[:, moving], effort, along=going[:, moving])
        samples = self.view.samples(path, homed, np.full(path.q.shape, np.nan), np.zeros(n, dtype=bool))
        samples = replace(samples, unsure=None) if from_middle else samples
        answer = self.view.answer(joints, self.predicted(samples, apart))
        return answer if apart is None else answer[apart.back]

    def stream(self) -> JointStream:
        """Return a stream, which answers sample after sample and remembers where in its slack the arm is."""
        return JointStream(self)

    def query_path(self, log: CalibrationLog) -> FloatArray:
        """See :class:`Corrector`."""
        return directed(log, self.view.input_signal, self.view.direction, needs_truth=False)[0]

    def _errors(
        self, log: CalibrationLog, given: FloatArray, samples: Samples, prediction: Prediction
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """See :class:`ViewCorrector`; the fixed offset is that of the training."""
        wide, missed = self.view.wide, samples.target - samples.origin
        raw = missed + (self.view.reached(given) - given)[:, self.view.moving]
        return wide(raw), wide(raw - self.offset), wide(missed - prediction.residual)

    def error_table(self, errors: FloatArray) -> Any:
        """See :class:`Corrector`: RMSE, and mean, SD, 95th percentile and maximum of the size, of every joint."""
        names, scale = joint_units(self.types)
        return [{"joint": j + 1, "unit": unit, **spread(errors[:, j] * scale[j])} for j, unit in enumerate(names)]

    def parts(self, m: int) -> tuple[Part, ...]:
        """See :class:`Corrector`."""
        names, scale = joint_units(self.types)
        return tuple(Part(f"joint {j + 1}", names[j], (j,), float(scale[j])) for j in range(m))

    def rezeroed(self, log: CalibrationLog) -> Self:
        """Return the model with its zeros set anew from a short run, as after a homing: all else stays.

        Parameters
        ----------
        log : CalibrationLog, of one session

        Raises
        ------
        DataError
            The run has less than five seconds with outside encoders, or is of more than one session.
        LogError
            It names another arm.
        """
        sessions = np.unique(log.session)
        if len(sessions) > 1:
            raise DataError(
                f"every homing has zeros of its own; the run is of {len(sessions)} sessions.",
                hint="Give one recording, made after the last homing.",
            )
        self.refuse_other_arm(log)
        log = self.in_joint_order(log)
        self.refuse_misread(log)
        measured = self.measure(log, np.ones(len(log), dtype=bool))
        seconds = float(np.ptp(measured.time))
        if seconds < LEAST_RUN_SECONDS:
            raise DataError(
                f"new zeros need at least {LEAST_RUN_SECONDS:g} s of motion with external_jp, got {seconds:.1f} s.",
                hint="Record a minute over the whole range.",
            )
        shift = np.median(measured.corrected, axis=0)[self.view.moving]
        law = replace(self.law, zero=self.law.zero + shift)
        return replace(self, law=law, history=(*self.history, step_now("rezero", log)))

    def zeros(self, log: CalibrationLog, measured: Measured) -> list[dict[str, Any]]:
        """Return how far each joint's zero seems off in each session, a row each: after a homing, it is.

        Parameters
        ----------
        log : CalibrationLog, that was measured
        measured : Measured, errors on it

        Returns
        -------
        list of dict
            session, joint, unit, shift (mm or deg), and whether that is more than chance, most of the session's error,
            and not another load's (moved).
        """
        names, scale = joint_units(self.types)
        std, loaded, rows = measured.interval95 / 2.0, bool(self.other_loads(log)), []
        session = log.session[measured.rows]
        for number in np.unique(session):
            inside = session == number
            errors = np.nan_to_num(measured.corrected[inside])
            shift = np.median(errors, axis=0)
            left = np.sqrt(((errors - shift) ** 2).mean(axis=0))
            limit = MOVED_STDS * np.median(std[inside], axis=0)
            moved = (np.abs(shift) > limit) & (left < MOST_LEFT * np.sqrt((errors**2).mean(axis=0))) & (not loaded)
            for j, unit in enumerate(names):
                entry = {"session": int(number), "joint": j + 1, "unit": unit, "shift": float(shift[j] * scale[j])}
                rows.append({**entry, "moved": bool(moved[j])})
        return rows

    def cautions(self, log: CalibrationLog) -> tuple[str, ...]:
        """See :class:`Corrector`; and where efforts are those of another load."""
        loaded = ", ".join(map(str, self.other_loads(log)))
        what = f"the efforts of joint {loaded} are not those of the same motion in training: another load or tool"
        more = (f"{what}. New zeros do not mend that: train with the loads that you use",) if loaded else ()
        return (*super().cautions(log), *more)

    def other_loads(self, log: CalibrationLog) -> list[int]:
        """Return the joints, counted from 1, whose efforts the training's loads do not explain.

        Parameters
        ----------
        log : CalibrationLog
        """
        loads = self.law.domain.loads
        if loads is None:
            return []
        inputs = loads.unlike(self.samples(log, np.ones(len(log), dtype=bool)).X)
        return [int(self.view.moving[j]) + 1 for j in self.view.features.origins[1][inputs]]

    @classmethod
    def learn(
        cls, log: CalibrationLog, keep: BoolArray, cleaner: FittedCleaner, settings: FitSettings, learn_law: LearnLaw
    ) -> Outcome:
        """See :class:`Corrector`."""
        task = JointTask.of(log, keep, settings)
        view, samples = task.view, task.samples
        law, left_out = learn_law(samples, task.layout)
        usual, shortest = task.steps
        corrector = cls(
            law=law,
            cleaner=cleaner,
            trained=TrainingMotion.of(task.source, log, keep, joints=True),
            view=view,
            offset=task.offset,
            usual_step=usual,
            shortest_step=shortest,
        )
        missed, parts = (samples.target - samples.origin)[samples.rows], corrector.parts(len(view.types))
        moving = [parts[j]._replace(columns=(k,)) for k, j in enumerate(view.moving)]
        wide = samples.sessions_left_out is not None
        apart = sessions_apart(log, samples.rows, left_out.errors, missed, moving, wide=wide)
        report = {
            "features": list(view.features.kinds),
            "input": view.input_signal,
            "direction": settings.direction,
            "uncorrected_joints": list(task.still),
        }
        return Outcome(corrector, samples, left_out, law.intervals, report, (*task.remarks, *apart))
