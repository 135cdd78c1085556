"""Facts about a log: sizes, rates and signals, without judgement."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpcorrect.types import CalibrationLog, FloatArray, PoseSignal

__all__ = ["facts_of"]


def facts_of(log: CalibrationLog) -> dict[str, Any]:
    """Describe a log, JSON-able; what cannot be said of it is None."""
    steps = [] if log.static else [np.diff(log.time[rows]) for _, rows in log.trajectories()]
    step = np.concatenate(steps) if steps else np.empty(0)
    step = step[np.isfinite(step)]
    return {
        "name": log.name,
        "digest": log.digest,
        "robot": log.meta.robot,
        "arm": log.meta.arm,
        "tracker": log.meta.tracker,
        "samples": len(log),
        "trajectories": _sizes(log),
        "static": log.static,
        "sessions": len(np.unique(log.session)),
        "seconds": float(step[step > 0].sum()),
        "rate_hz": _rate(step),
        "step_s": _distribution(step),
        "signals": {name: _signal(getattr(log, name)) for name in log.signals},
        "extra_columns": sorted(log.extra),
        "remarks": list(log.remarks),
    }


def _sizes(log: CalibrationLog) -> dict[str, int]:
    sizes = np.unique(log.trajectory, return_counts=True)[1]
    if not sizes.size:
        return {"count": 0, "shortest": 0, "median": 0, "longest": 0}
    return {
        "count": int(sizes.size),
        "shortest": int(sizes.min()),
        "median": int(np.median(sizes)),
        "longest": int(sizes.max()),
    }


def _rate(step: FloatArray) -> float | None:
    forward = step[step > 0]
    return float(1.0 / np.median(forward)) if forward.size else None


def _distribution(values: FloatArray) -> dict[str, float] | None:
    if not values.size:
        return None
    low, middle, high = np.percentile(values, [5, 50, 95])
    return {
        "min": float(values.min()),
        "p5": float(low),
        "median": float(middle),
        "p95": float(high),
        "max": float(values.max()),
    }


def _columns(values: FloatArray) -> FloatArray:
    return values[:, None] if values.ndim == 1 else values


def _signal(value: PoseSignal | FloatArray) -> dict[str, Any]:
    pose = isinstance(value, PoseSignal)
    table = value.position if isinstance(value, PoseSignal) else _columns(value)
    known = value.finite if isinstance(value, PoseSignal) else np.asarray(np.isfinite(table).all(axis=1))
    found = table[known]
    return {
        "columns": int(table.shape[1]),
        "orientation": isinstance(value, PoseSignal) and value.quaternion is not None if pose else None,
        "missing": float(1.0 - known.mean()) if len(known) else 0.0,
        "min": [float(v) for v in found.min(axis=0)] if len(found) else None,
        "max": [float(v) for v in found.max(axis=0)] if len(found) else None,
    }
