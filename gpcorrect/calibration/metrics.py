"""Statistics of errors for reports: mean, SD, RMSE, 95th percentile, maximum, by axis and norm, in mm and degrees."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray

AXES = ("x", "y", "z")
Z95 = 1.959964  # half width of the central 95 % of a standard normal

JointErrors = list[dict[str, object]]
Leaf = dict[str, float]
ErrorTable = dict[str, dict[str, Leaf]]


def spread(errors: FloatArray) -> Leaf:
    """Return mean, SD, RMSE, 95th percentile and maximum of the absolute values of `errors` (n,); NaN are left out.

    Parameters
    ----------
    errors : (n,) array, in any unit
    """
    size = np.abs(errors[np.isfinite(errors)])
    if size.size == 0:
        return dict.fromkeys(("mean", "sd", "rmse", "p95", "max"), float("nan"))
    return {
        "mean": float(size.mean()),
        "sd": float(size.std()),
        "rmse": float(np.sqrt(np.mean(size**2))),
        "p95": float(np.percentile(size, 95)),
        "max": float(size.max()),
    }


def _by_axis(vectors: FloatArray) -> dict[str, Leaf]:
    table = {axis: spread(vectors[:, i]) for i, axis in enumerate(AXES)}
    table["norm"] = spread(np.linalg.norm(vectors, axis=1))
    return table


def error_table(residual: FloatArray) -> ErrorTable:
    """Return the table of pose errors `(n, 6)` (m, then rad): `position_mm` and, where measured, `rotation_deg`.

    Parameters
    ----------
    residual : (n, 6) array, m, then rad; NaN where not measured
    """
    table = {"position_mm": _by_axis(1e3 * residual[:, :3])}
    if np.isfinite(residual[:, 3:]).any():
        table["rotation_deg"] = _by_axis(np.rad2deg(residual[:, 3:]))
    return table


def coverage(residual: FloatArray, half_width: FloatArray) -> FloatArray:
    """Return the fraction of errors `(n, k)` inside intervals of half width `(n, k)`, by column; NaN where unknown.

    Parameters
    ----------
    residual : (n, k) array, errors
    half_width : (n, k) array, half widths of their intervals, same unit
    """
    known = np.isfinite(residual) & np.isfinite(half_width)
    inside = (np.abs(residual) <= half_width) & known
    count = known.sum(axis=0)
    return np.where(count > 0, inside.sum(axis=0) / np.maximum(count, 1), np.nan)


def joint_units(types: str) -> tuple[list[str], FloatArray]:
    """Return each joint's unit for people, and what one rad or m is in it.

    Parameters
    ----------
    types : str, "R" or "P" for each joint

    Returns
    -------
    names : list of str, "deg" or "mm"
    scale : (d,) array, of one rad or m
    """
    names = ["mm" if kind == "P" else "deg" for kind in types]
    return names, np.array([1e3 if kind == "P" else np.rad2deg(1.0) for kind in types])
