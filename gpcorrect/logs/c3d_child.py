"""Run as a program: read one C3D file with ezc3d and write its markers to standard output as npz.

A process of its own, because ezc3d may loop for ever, crash, or ask for all memory on damaged bytes.
"""

from __future__ import annotations

import io
import sys
from typing import Any

import numpy as np

UNREADABLE = 3  # exit status: ezc3d itself refused the file


def main(path: str, most_bytes: int) -> int:
    """Read and write; return the exit status.

    Parameters
    ----------
    path : str
        A C3D file.
    most_bytes : int
        Memory that the process may take.
    """
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (most_bytes, most_bytes))
    except ImportError:  # only where the system has limits
        pass
    try:
        arrays = _read(path)
    except (ImportError, OSError, RuntimeError, ValueError, LookupError, AssertionError, MemoryError) as error:
        sys.stderr.write(str(error))
        return UNREADABLE
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    sys.stdout.buffer.write(buffer.getvalue())
    return 0


def _read(path: str) -> dict[str, Any]:
    """Read with ezc3d; with the library c3d, where it is installed, what ezc3d does not support."""
    import ezc3d

    try:
        return _arrays(ezc3d.c3d(path))
    except RuntimeError as error:
        if "not supported" not in str(error):
            raise
        from gpcorrect.logs import c3d_fallback

        return c3d_fallback.arrays(path)


def _arrays(content: Any) -> dict[str, Any]:
    """Points `(n, m, 3)`, residuals `(n, m)`, labels, unit, rate and first frame."""
    point = content["parameters"]["POINT"]
    names = [point[key]["value"] for key in ("LABELS", "LABELS2", "LABELS3", "LABELS4") if key in point]
    points = np.asarray(content["data"]["points"])[:3]
    return {
        "points": np.moveaxis(points, 0, -1).swapaxes(0, 1),
        "residuals": np.asarray(content["data"]["meta_points"]["residuals"])[0].T,
        "labels": np.array([label.strip() for part in names for label in part], dtype=str),
        "unit": "".join(point["UNITS"]["value"]).strip() if "UNITS" in point else "",
        "rate": float(np.ravel(point["RATE"]["value"])[0]) if "RATE" in point else 0.0,
        "first": int(content["header"]["points"]["first_frame"]),
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2])))
