"""In what two models differ."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.calibration.cartesian import CommandCorrector
from gpcorrect.calibration.history import last_measured
from gpcorrect.errors import DataError


def compare(one: Any, other: Any) -> dict[str, Any]:
    """Return in what two models differ: what they say of themselves, their errors, how far apart their commands are.

    Parameters
    ----------
    one, other : Corrector
        Models of one task.

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
        found["commands"] = _commands_apart(one, other)
    return found


def _flat(summary: Any, prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in summary.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return flat


def _commands_apart(one: CommandCorrector, other: CommandCorrector) -> dict[str, float]:
    queries = np.vstack([one.check_queries, other.check_queries])
    first, second = ([model.correct(q[:7], q[7:]) for q in queries] for model in (one, other))
    if one.route is not None or other.route is not None:  # single poses say nothing of what paths are answered by
        first += [one.correct_path([q[:7]], [0.0])[0] for q in queries]
        second += [other.correct_path([q[:7]], [0.0])[0] for q in queries]
    apart = np.linalg.norm(np.array([a.position for a in first]) - np.array([a.position for a in second]), axis=1)
    turned = np.zeros(1)
    if one.has_orientation and other.has_orientation:
        turned = se3.quaternion_angle(*(np.array([a.quaternion for a in answers]) for answers in (first, second)))
    return {
        "queries": len(queries),
        "mean_mm": 1e3 * float(apart.mean()),
        "max_mm": 1e3 * float(apart.max()),
        "max_deg": float(np.degrees(turned.max())),
    }
