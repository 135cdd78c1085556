"""What nobody asks for: errors of the arm's table and of the registration within the tolerance of any good calibration.

A tracker with thousands of samples sees table errors of a hundredth of its noise, and some effect of the catalogue can
always be bent to fit them. They are therefore part of what the nominal arm may be: the residual is multiplied by the
square root of the covariance that noise and tolerance have together, which leaves nothing of errors within the
tolerance but noise, and of larger ones what is beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Chain
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.tracker import Tracker
from gpcorrect.discrepancy.settings import NOISE
from gpcorrect.types import BoolArray, FloatArray

STEP = 1e-5  # rad or m, for slopes
ROW_TERMS = {"alpha": NOISE.table_angle, "a": NOISE.table_length, "d": NOISE.table_length, "theta": NOISE.table_angle}


@dataclass(frozen=True, eq=False)
class Slack:
    """A linear part of the residual that is left out of account.

    `pick` `(r, m)` takes the sizes of the errors, as far as they are left out, from the m residuals of `rows` `(n, c)`;
    `slopes` `(n, c, r)` is what a standard deviation of each changes in the channels.
    """

    slopes: FloatArray
    pick: FloatArray
    rows: BoolArray

    def part(self, residual: FloatArray) -> FloatArray:
        """Return the part `(n, c)` of a residual that is left out of account.

        Parameters
        ----------
        residual : (n, c) array
        """
        taken: FloatArray = self.slopes @ (self.pick @ residual[self.rows])
        return taken


def slack_of(slopes: FloatArray, rows: BoolArray, noises: tuple[ChannelNoise, ...], step: float) -> Slack:
    """Return what is left of residuals once they are multiplied by (I + B B^T)^(-1/2), B the slopes over the noise.

    Parameters
    ----------
    slopes : (n, c, r) array
        Change of the channels for one standard deviation of each error.
    rows : (n, c) bool array
        Measured rows that may be looked at.
    noises : tuple of ChannelNoise
    step : float
        Seconds from sample to sample: slow noise counts for less, the denser the samples.
    """
    scale = np.array([np.sqrt(n.white**2 + n.slow**2 * max(1.0, 2.0 * n.time_constant / step)) for n in noises])
    scale = np.broadcast_to(scale, rows.shape)[rows][:, None]
    U, s, Vt = np.linalg.svd(slopes[rows] / scale, full_matrices=False)
    seen = s > 1e-9 * max(s.max(initial=0.0), 1e-300)
    U, s, Vt = U[:, seen], s[seen], Vt[seen]
    shrunk = (1.0 - 1.0 / np.sqrt(1.0 + s**2)) / s
    return Slack(slopes, (Vt.T * shrunk) @ (U / scale).T, rows)


def table_slopes(chain: Chain, q: FloatArray, T_tracker_base: FloatArray, tracker: Tracker) -> FloatArray:
    """Change of what a tracker says `(n, a, r)` for a standard deviation of every table entry and of the registration.

    Parameters
    ----------
    chain : Chain
        Nominal arm, up to the marker.
    q : (n, dof) array
        All its joints.
    T_tracker_base : (4, 4) array
        As the model states it, or the identity.
    tracker : Tracker
        That sees a of its axes: what its own registration takes up is no change.
    """
    arms = [
        (replace(chain, joints=(*chain.joints[:i], moved, *chain.joints[i + 1 :])), size)
        for i, joint in enumerate(chain.joints)
        for name, size in ROW_TERMS.items()
        for moved in [replace(joint, **{name: getattr(joint, name) + STEP})]
    ]
    tip = chain.forward(q)
    nominal = tracker.predicted(T_tracker_base @ tip)
    columns = [(tracker.predicted(T_tracker_base @ arm.forward(q)) - nominal) * (size / STEP) for arm, size in arms]
    if tracker.base_known:
        for k, size in enumerate([NOISE.table_length] * 3 + [NOISE.table_angle] * 3):
            moved_base = T_tracker_base @ se3.exp(STEP * np.eye(6)[k])
            columns.append((tracker.predicted(moved_base @ tip) - nominal) * (size / STEP))
    return np.stack(columns, axis=2)
