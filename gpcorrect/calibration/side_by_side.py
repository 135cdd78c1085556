"""Two models of one task: measured on the same samples of a recording, and in what they differ."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.evaluate import Evaluation, evaluate_model, part_errors
from gpcorrect.calibration.history import last_measured
from gpcorrect.calibration.joints import JointCorrector
from gpcorrect.calibration.metrics import spread
from gpcorrect.calibration.task import Corrector, Measured, Part
from gpcorrect.errors import DataError, LogError
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, PoseSignal

DRAWS = 2000  # of whole trajectories, for the interval of a difference: its ends are known to a hundredth of it or so
FEWEST = 4  # trajectories from which an interval is drawn; fewer say nothing of others. Chosen by hand


@dataclass(frozen=True)
class Difference:
    """By how much the second model's mean error is above the first's, and its 95 % interval where it is known."""

    part: str
    unit: str
    mean: float
    interval95: tuple[float, float] | None

    def sentence(self, names: tuple[str, str]) -> str:
        """Return which model errs less, by how much, and how sure that is.

        Parameters
        ----------
        names : (str, str), of the models
        """
        less = f"{names[int(self.mean < 0)]} errs less"
        apart = f"{names[1]} - {names[0]} = {self.mean:+.3g} {self.unit}"
        if self.interval95 is None:
            return f"{self.part}: {less}, {apart} (too few trajectories to say how sure that is)"
        low, high = self.interval95
        found = "no certain difference" if low <= 0 <= high else less
        return f"{self.part}: {found}, {apart} (95 % {low:+.3g} to {high:+.3g})"


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Two models on the samples that both could be measured on.

    Parameters
    ----------
    log : CalibrationLog
    evaluations : (Evaluation, Evaluation), each model by itself
    measured : (Measured, Measured), the same n samples of each
    """

    log: CalibrationLog
    evaluations: tuple[Evaluation, Evaluation]
    measured: tuple[Measured, Measured]

    @property
    def parts(self) -> list[Part]:
        """Parts of errors that were measured of both."""
        one, other = self.measured
        parts = self.evaluations[0].corrector.parts(min(one.raw.shape[1], other.raw.shape[1]))
        return [p for p in parts if all(np.isfinite(m.corrected[:, p.columns]).any() for m in self.measured)]

    def trajectories(self) -> dict[int, IntArray]:
        """Return the samples of each trajectory, in recorded order."""
        numbers = self.measured[0].trajectory
        return {n: np.flatnonzero(numbers == n) for n in dict.fromkeys(numbers.tolist())}

    def differences(self) -> list[Difference]:
        """Return the difference of the mean errors of each part; its interval by drawing whole trajectories."""
        groups, found = list(self.trajectories().values()), []
        for part in self.parts:
            one, other = (part.sizes(m.corrected) for m in self.measured)
            sums = np.array([[np.nansum(other[g] - one[g]), np.isfinite(other[g] - one[g]).sum()] for g in groups])
            total = sums.sum(axis=0)
            interval = None
            if len(groups) >= FEWEST:
                rng = np.random.default_rng(0)
                drawn = sums[rng.integers(0, len(sums), (DRAWS, len(sums)))].sum(axis=1)
                low, high = np.percentile(drawn[:, 0] / drawn[:, 1], [2.5, 97.5])
                interval = (float(low), float(high))
            found.append(Difference(part.name, part.unit, float(total[0] / total[1]), interval))
        return found

    def to_dict(self, names: tuple[str, str]) -> dict[str, Any]:
        """Return all figures, JSON-able.

        Parameters
        ----------
        names : (str, str), of the models
        """
        groups = self.trajectories()
        models = [
            {
                "name": name,
                "errors": [asdict(row) for row in part_errors(e.corrector, m)],
                "coverage95": m.share_held,
                "in_domain": float(m.in_domain.mean()),
                "rejected": dict(e.cleaning.counts),
                "cautions": list(e.cautions),
            }
            for name, e, m in zip(names, self.evaluations, self.measured, strict=True)
        ]
        rows = [
            {
                "trajectory": number,
                "samples": len(index),
                "mean": {
                    p.name: [spread(p.sizes(m.corrected[index]))["mean"] for m in self.measured] for p in self.parts
                },
                "in_domain": [float(m.in_domain[index].mean()) for m in self.measured],
            }
            for number, index in groups.items()
        ]
        return {
            "samples": len(self.measured[0].rows),
            "models": models,
            "differences": [asdict(d) for d in self.differences()],
            "trajectories": rows,
        }


def refuse_unlike(one: Corrector, other: Corrector, names: tuple[str, str]) -> None:
    """Refuse two models whose errors cannot stand beside each other.

    Parameters
    ----------
    one, other : Corrector
    names : (str, str), of the models, for the message

    Raises
    ------
    DataError
        They are of different tasks, directions, joints or arms.
    """
    pairs: list[tuple[str, Any, Any]] = [("corrects", one.TASK.replace("_", " "), other.TASK.replace("_", " "))]
    if isinstance(one, JointCorrector) and isinstance(other, JointCorrector):
        pairs.append(("answers in the direction", one.view.direction, other.view.direction))
        pairs.append(("has joints of the types", one.types, other.types))
    for word in ("robot", "arm", *(("joint_names",) if one.TASK == JointCorrector.TASK else ())):
        first, second = one.summary.get(word), other.summary.get(word)
        if first and second:
            pairs.append((f"is of the {word.replace('_', ' ')}", first, second))
    for words, first, second in pairs:
        if first != second:
            raise DataError(
                f"{names[0]} {words} {first}, {names[1]} {second}: their errors cannot be compared.",
                hint="Give two models of one task, made for the same arm; what models are: gpcorrect info MODEL",
            )


def measure_both(one: Corrector, other: Corrector, log: CalibrationLog) -> SideBySide:
    """Measure two models on the samples of a recording that pass both models' cleaning.

    Parameters
    ----------
    one, other : Corrector, of one task, as :func:`refuse_unlike` asks
    log : CalibrationLog, on one clock

    Raises
    ------
    LogError
        A signal is missing, or no sample can be measured with both.
    """
    first, second = evaluate_model(one, log), evaluate_model(other, log)
    rows = np.intersect1d(first.clean.rows, second.clean.rows)
    if rows.size == 0:
        raise LogError(
            "no sample passes the cleaning of both models.",
            hint="Measure each by itself and see what is rejected: gpcorrect evaluate MODEL LOG --report page.html",
            path=log.name,
        )
    one_measured, other_measured = (e.clean.at(np.isin(e.clean.rows, rows)) for e in (first, second))
    return SideBySide(log, (first, second), (one_measured, other_measured))


def compare(one: Any, other: Any) -> dict[str, Any]:
    """Return in what two models differ: what they say of themselves, their errors, how far apart their commands are.

    Parameters
    ----------
    one, other : Corrector, models of one task

    Returns
    -------
    dict
        `made` and `held_out`: the last step of each and the last measured errors (JSON-able, None where not known);
        `differs`: by name, what the one and the other say; `commands`: distances (mm, deg) on the recorded check
        queries of both, for models of poses.

    Raises
    ------
    DataError
        They are not of one task.
    """
    if one.TASK != other.TASK:
        raise DataError(f"one model corrects {one.TASK}, the other {other.TASK}: they cannot be compared.")
    both = (one, other)
    left, right = (_flat(model.summary) for model in both)
    names = [name for name in (*left, *(n for n in right if n not in left)) if left.get(name) != right.get(name)]
    measured = [last_measured(model.history) for model in both]
    found: dict[str, Any] = {
        "made": [asdict(model.history[-1]) if model.history else None for model in both],
        "held_out": [asdict(errors) if errors else None for errors in measured],
        "differs": {name: (left.get(name), right.get(name)) for name in names},
    }
    if isinstance(one, CommandCorrector):
        found["commands"] = commands_apart(one, other)
    return found


def _flat(summary: Any, prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in summary.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return flat


def commands_apart(one: CommandCorrector, other: CommandCorrector) -> dict[str, float]:
    """Return how far the commands of two models lie apart on the check queries that both recorded.

    Parameters
    ----------
    one, other : CommandCorrector

    Returns
    -------
    dict
        `queries`, how many; `mean_mm`, `max_mm` and `max_deg` between the commands (0 deg where one has no rotations).
    """
    queries = np.vstack([one.check_queries, other.check_queries])
    paths = one.route is not None or other.route is not None  # single poses say nothing of what these are answered by
    first, second = (_commands(model, queries, paths=paths) for model in (one, other))
    apart, turned = np.linalg.norm(first.position - second.position, axis=1), np.zeros(1)
    if first.quaternion is not None and second.quaternion is not None:
        turned = se3.quaternion_angle(first.quaternion, second.quaternion)
    return {
        "queries": len(queries),
        "mean_mm": 1e3 * float(apart.mean()),
        "max_mm": 1e3 * float(apart.max()),
        "max_deg": float(np.degrees(turned.max())),
    }


def _commands(model: CommandCorrector, queries: FloatArray, *, paths: bool) -> PoseSignal:
    """Return what a model commands for each query, however far from its training; then as the only pose of a path."""
    desired, each = PoseSignal.of(queries[:, :7]), np.arange(len(queries))
    answers = [model.correct_observed(desired, queries[:, 7:])]
    if paths and model.route is not None:
        in_joints = model.route.correct(model.rigid.apply(desired), each.astype(np.float64), each, model.law.bounds)
        answers.append(model.joined(in_joints, answers[0]))
    elif paths:
        answers *= 2
    commands = PoseSignal.of(np.vstack([answer.poses.table for answer in answers]))
    return commands if model.has_orientation else PoseSignal(commands.position)
