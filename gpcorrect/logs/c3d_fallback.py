"""C3D files that ezc3d refuses (those of MIPS and SPARC machines), through the slower library c3d.

Imports nothing of this package: the process that reads C3D files runs it too.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

__all__ = ["arrays"]


def arrays(path: str) -> dict[str, Any]:
    """Points `(n, m, 3)`, residuals `(n, m)`, labels, unit, rate and first frame of a C3D file.

    Parameters
    ----------
    path : str
        A C3D file.

    Raises
    ------
    ImportError
        The library is not installed.
    """
    import c3d

    with warnings.catch_warnings(), open(path, "rb") as file:
        warnings.simplefilter("ignore")  # about parameters that markers do not need
        reader = c3d.Reader(file)
        frames = [points[:, :4] for _, points, _ in reader.read_frames()]
        unit = reader.get("POINT:UNITS")
        values = np.array(frames, dtype=np.float64).reshape(len(frames), -1, 4)
        return {
            "points": values[..., :3],
            "residuals": values[..., 3],
            "labels": np.array([label.strip() for label in reader.point_labels], dtype=str),
            "unit": unit.string_value.strip() if unit is not None else "",
            "rate": float(reader.point_rate),
            "first": int(reader.first_frame),
        }
