"""What nobody asks for: errors of the arm's table and of the registration within the tolerance of any good calibration.

A tracker with thousands of samples sees table errors of a hundredth of its noise, and some effect of the catalogue can
always be bent to fit them. They are therefore part of what the nominal arm may be: the residual is multiplied by the
square root of the covariance that noise and tolerance have together, which leaves nothing of errors within the
tolerance but noise, and of larger ones what is beyond it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.arms import Chain
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.settings import NOISE
from gpcorrect.types import BoolArray, FloatArray

__all__ = ["Slack", "rotation_onto", "slack_of", "table_slopes", "without_registration"]

STEP = 1e-5  # rad or m, for slopes
ROW_TERMS = {
    "alpha": NOISE.table_angle,
    "a": NOISE.table_length,
    "d": NOISE.table_length,
    "theta": NOISE.table_angle,
}


@dataclass(frozen=True, eq=False)
class Slack:
    """A linear part of the residual that is left out of account.

    Parameters
    ----------
    slopes : (n, c, r) array
        What a standard deviation of each error changes in the channels.
    pick : (r, m) array
        Sizes of the errors, as far as they are left out of account, from the residual of `rows`.
    rows : (n, c) bool array
        Residuals that the sizes are taken from, m of them.
    """

    slopes: FloatArray
    pick: FloatArray
    rows: BoolArray

    def part(self, residual: FloatArray) -> FloatArray:
        """Return the part `(n, c)` of a residual that is left out of account.

        Parameters
        ----------
        residual : (n, c) array
            Measured minus simulated.
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
        Of each channel.
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


def rotation_onto(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the rotation `(3, 3)` that best turns points onto others, both about their means (Arun 1987).

    Parameters
    ----------
    a : (n, 3) array
        Points to turn.
    b : (n, 3) array
        Where they should be.
    """
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    a, b = a[good], b[good]
    u, _, vt = np.linalg.svd((b - b.mean(axis=0)).T @ (a - a.mean(axis=0)))
    turn: FloatArray = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn


def table_slopes(chain: Chain, q: FloatArray, axes: FloatArray) -> FloatArray:
    """Change of tracked tips `(n, 3, r)` for a standard deviation of every table entry and of the registration.

    Parameters
    ----------
    chain : Chain
        Nominal arm.
    q : (n, dof) array
        All its joints.
    axes : (3, 3) array
        Turns vectors of the base into the tracker's frame.
    """
    tip = chain.forward(q)[:, :3, 3]
    columns = [
        (changed.forward(q)[:, :3, 3] - tip) @ axes.T * (size / STEP)
        for i in range(chain.dof)
        for name, size in ROW_TERMS.items()
        for joint in [chain.joints[i]]
        for moved in [replace(joint, **{name: getattr(joint, name) + STEP})]
        for changed in [replace(chain, joints=(*chain.joints[:i], moved, *chain.joints[i + 1 :]))]
    ]
    columns += [np.broadcast_to(NOISE.table_length * axes[:, k], tip.shape) for k in range(3)]
    columns += [NOISE.table_angle * np.cross(np.eye(3)[k], tip) @ axes.T for k in range(3)]
    return np.stack(columns, axis=2)


def without_registration(slopes: FloatArray, tip: FloatArray, rows: BoolArray) -> FloatArray:
    """Return slopes less the rigid motion of the tips that a registration on these rows takes up.

    Parameters
    ----------
    slopes : (n, 3, r) array
        Change of the tips.
    tip : (n, 3) array
        Tips, m.
    rows : (n,) bool array
        Those registered on.
    """
    centred = tip - tip[rows].mean(axis=0)
    rigid = [np.broadcast_to(axis, tip.shape) for axis in np.eye(3)] + [np.cross(a, centred) for a in np.eye(3)]
    basis = np.stack(rigid, axis=2)
    k = basis.shape[2]
    fit, *_ = np.linalg.lstsq(basis[rows].reshape(-1, k), slopes[rows].reshape(-1, slopes.shape[2]), rcond=None)
    left: FloatArray = slopes - basis @ fit
    return left
