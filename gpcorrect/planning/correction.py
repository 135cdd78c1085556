"""From the path that is wanted to the path to command: corrected all along, or at its ends only.

Mahler 2014, Sec. V-C commands corrected trajectories and corrected end points; both are here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.planning.paths import DesiredPath
from gpcorrect.types import BoolArray, FloatArray

Mode = Literal["full", "endpoints"]
REST = 1e4  # s between two poses: so slow that both are at rest for any model


class Corrects(Protocol):
    """A correction, served or in process: a `CommandCorrector` or a `CorrectionClient`."""

    def correct_path(self, poses: FloatArray, times: FloatArray) -> Any:
        """Return what to command instead of a path: a `Correction`, or the service's `Reply` around one.

        Parameters
        ----------
        poses : (n, 7) array
            Positions (m) and quaternions wxyz.
        times : (n,) array
            Seconds.
        """


@dataclass(frozen=True, eq=False)
class CommandPath:
    """A path to command, and how sure its correction is.

    Parameters
    ----------
    times : (n,) array
        Seconds.
    T : (n, 4, 4) array
        Tool poses to command, base frame.
    interval95 : (m, 6) array
        Half widths at the poses that were asked for: all of them, or the two ends; m then rad.
    in_domain : (m,) array
        Whether each lies near training data.
    status : tuple of m str
        Of each, as `Correction` has it.
    """

    times: FloatArray
    T: FloatArray
    interval95: FloatArray
    in_domain: BoolArray
    status: tuple[str, ...]


def corrected(corrector: Corrects, path: DesiredPath, mode: Mode = "full") -> CommandPath:
    """Return what to command so that the tool follows a path, or at least begins and ends where the path does.

    Parameters
    ----------
    corrector : Corrects
    path : DesiredPath
        In the frame that the model was trained in.
    mode : "full" or "endpoints"
        Correct every pose with its velocity; or the two ends, at rest, with the path's own course between.

    Raises
    ------
    DataError
        The model does not correct orientations, or there is no such mode.
    """
    if mode not in get_args(Mode):
        raise DataError(f"a path is corrected in full or at its endpoints, got {mode!r}.")
    ends = [0, len(path.times) - 1]
    if mode == "full":
        answer = corrector.correct_path(path.poses, path.times)
    else:
        answer = corrector.correct_path(path.poses[ends], np.array([0.0, REST]))
    if answer.position is None or answer.quaternion is None:
        raise DataError("this model corrects positions only.", hint="Plan with a model that was fitted to full poses.")
    T = se3.from_parts(answer.position, answer.quaternion)
    command = T if mode == "full" else _between(path, T)
    return CommandPath(path.times, command, answer.interval95, answer.in_domain, tuple(answer.status))


def _between(path: DesiredPath, ends: FloatArray) -> FloatArray:
    """Move the path rigidly with its first pose, and remove the miss of its last one in proportion to the way gone."""
    moved = se3.compose(ends[0], se3.invert(path.T[0]), path.T)
    miss = se3.compose(se3.invert(moved[-1]), ends[1])
    gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.T[:, :3, 3], axis=0), axis=1))])
    if gone[-1] < 1e-9:  # nothing moves: in proportion to time
        gone = path.times - path.times[0]
    return se3.compose(moved, se3.exp((gone / max(float(gone[-1]), 1e-12))[:, None] * se3.log(miss)))
