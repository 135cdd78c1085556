"""Whether the tool rotates enough to tell a marker's place on it from the place of the tracker."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DegenerateError
from gpcorrect.types import FloatArray, PoseSignal

MIN_GAIN = 0.05  # below it (turns of about 3 degrees) an error of a millimetre moves the lever arm by 20 mm
TRIM = 0.1  # share of the observed rotations left out where no commanded ones can vouch for them


@dataclass(frozen=True, eq=False)
class Observability:
    """How far a lever arm of one metre swings with the recorded rotations.

    With M the mean of the rotation matrices, the lever arm a moves the tip by `sqrt(a^T (I - M^T M) a)`
    about its mean place (root mean square): the gains are the square roots of the eigenvalues of `I - M^T
    M`. A gain of zero means that its direction cannot be distinguished from the registration of the frames.

    Parameters
    ----------
    gains : (3,) array, metres of swing a metre of lever arm, smallest first; 1 is the most there can be
    axes : (3, 3) array, directions of the gains in the tracked body's frame, one a row
    """

    gains: FloatArray
    axes: FloatArray

    @property
    def n_axes(self) -> int:
        """How many independent axes the tool turned about: 0, 1, or 2 for all that is needed."""
        return max(2 - int(np.count_nonzero(self.gains < MIN_GAIN)), 0)

    @property
    def observable(self) -> bool:
        """Whether lever arm and marker orientation follow from the data."""
        return self.n_axes == 2

    @property
    def text(self) -> str:
        """One sentence with the numbers: what can be known and what cannot."""
        swing = ", ".join(f"{100 * g:.2g}" for g in self.gains)
        measured = f"a lever arm swings by {swing} % of its length along its three principal directions"
        if self.n_axes == 2:
            return f"Lever arm and marker orientation are observable: {measured}."
        if self.n_axes == 1:
            axis = ", ".join(f"{v:.2f}" for v in self.axes[0])
            what = (
                f"The tool turned about one axis only, ({axis}) in the marker's frame: the lever arm along "
                "it and the marker's turn about it are not observable"
            )
        else:
            what = "The tool hardly rotated: lever arm and marker orientation are not observable"
        return f"{what} ({measured}; {100 * MIN_GAIN:.0f} % is needed)."

    def require(self) -> None:
        """Refuse a motion that does not determine lever arm and marker orientation.

        Raises
        ------
        DegenerateError
            Naming what is not observable, with the numbers.
        """
        if not self.observable:
            raise DegenerateError(
                self.text, hint='Rotate the tool about two different axes, or register with marker="none".'
            )

    def to_dict(self) -> dict[str, Any]:
        """Return the gains, the axes and the sentence as plain lists and text."""
        return {
            "observable": self.observable,
            "gains": self.gains.tolist(),
            "axes": self.axes.tolist(),
            "text": self.text,
        }


def rotation_observability(observed: PoseSignal, command: PoseSignal) -> Observability | None:
    """Observability of a marker offset; None where no orientations were observed.

    The smaller of what observed and commanded rotations show counts, so that neither a frozen tracker nor
    gross errors of the tracker pass for rotation. Where no orientation was commanded, the tenth of the
    observed ones that is furthest from their centre is left out instead.

    Parameters
    ----------
    observed : PoseSignal, poses of the marker in the tracker frame
    command : PoseSignal, poses of the tip in the base frame
    """
    if observed.quaternion is None:
        return None
    R_obs = se3.matrix_from_quaternion(observed.quaternion)
    if command.quaternion is None:
        away = se3.angle(R_obs @ se3.rotation_mean(R_obs).T)
        return _observability(R_obs[away <= np.quantile(away, 1.0 - TRIM)])
    seen = _observability(R_obs)
    asked = _observability(se3.matrix_from_quaternion(command.quaternion))
    return Observability(np.minimum(seen.gains, asked.gains), seen.axes)


def _observability(rotations: FloatArray) -> Observability:
    _, s, vt = np.linalg.svd(rotations.mean(axis=0))
    return Observability(np.sqrt(np.clip(1.0 - s**2, 0.0, 1.0)), vt)
