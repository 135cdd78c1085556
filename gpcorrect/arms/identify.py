"""A chain learned from poses and joints that one kinematics made: where each axis lies, from a recording alone.

A controller computes its poses from its joints, so a log that holds both holds the kinematics too. Each joint is a
screw about (or along) an axis of the base frame, `T(q) = exp(S_1 q_1) ... exp(S_n q_n) M` (Lynch and Park 2017, Sec.
4.1), and the axes follow from nonlinear least squares (Levenberg-Marquardt on the screws). Near one posture the screws
are the columns of a linear regression: that is the start, and the neighbourhood grows from there to all of the
recording.
"""

from __future__ import annotations

import numpy as np

from gpcorrect import se3
from gpcorrect.arms.chain import Chain, Joint
from gpcorrect.arms.robot_path import joint_frame
from gpcorrect.errors import DataError, DegenerateError
from gpcorrect.types import FloatArray, IntArray

NEIGHBOURHOODS = (60, 240, 400)
"""Samples of the growing fits, the nearest to the home posture first; the last are spread over all. A chain of six
joints has 42 numbers, and each sample gives six; chosen by hand."""
CONSIDERED = 4000  # samples that are looked at, evenly spread: neighbours in time repeat each other; chosen by hand
HOMES = 3  # postures to start from before a chain is given up; chosen by hand
MISFIT = 1e-3
"""rad (and m over the workspace's size) of root mean square that the chain may miss its own poses by: files that keep
hundredths of a millimetre stay below (tested), and a recording of no such chain missed by 0.2."""
LEAST_MOTION = 1e-3  # rad or m: a joint that moves less shows no axis; chosen by hand
STEPS = 60  # of a fit; chosen by hand
DAMPING = (1e-9, 1e3)
"""Of the least and the most careful step, over the mean curvature: a step that makes things worse is damped tenfold."""
BEYOND = 1e3  # rad or m: the recording shows where joints went, not where they stop


def identify_chain(q: FloatArray, T: FloatArray, types: str) -> Chain:
    """Return the chain that takes joints to poses.

    Parameters
    ----------
    q : (n, dof) array, joints, rad and m
    T : (n, 4, 4) array, poses that were computed from them
    types : str, "R" or "P" for each joint

    Raises
    ------
    DegenerateError
        A joint hardly moves, or the samples are too few.
    DataError
        No rigid chain makes these poses of these joints.
    """
    if len(q) < NEIGHBOURHOODS[0] or (np.ptp(q, axis=0) < LEAST_MOTION).any():
        raise DegenerateError(
            f"{len(q)} samples, in which a joint moves by {np.ptp(q, axis=0).min() if len(q) else 0:.2g} rad or m, do "
            f"not show a chain of {q.shape[1]} joints; {NEIGHBOURHOODS[0]} in which all move are needed."
        )
    rows = np.unique(np.linspace(0, len(q) - 1, min(len(q), CONSIDERED)).astype(np.int64))
    q, T = q[rows], T[rows]
    length, spread, best = workspace(T), q.std(axis=0), np.inf
    for home in (np.median(q, axis=0), *q[np.linspace(0, len(q) - 1, HOMES + 1).astype(np.int64)[1:-1]]):
        near = np.argsort((((q - home) / spread) ** 2).sum(axis=1))
        screws = _Screws.start(q, T, types, near[: NEIGHBOURHOODS[0]])
        everywhere = near[np.linspace(0, len(near) - 1, min(NEIGHBOURHOODS[-1], len(near))).astype(np.int64)]
        for around in (near[: NEIGHBOURHOODS[0]], near[: NEIGHBOURHOODS[1]], everywhere):
            screws, misfit = screws.fitted(q[around], T[around], length)
            if misfit > MISFIT:
                break
        else:
            return screws.chain()
        best = min(best, misfit)
    raise DataError(
        f"the poses are not those that a chain of {len(types)} rigid joints ({types}) makes of the joints: the best "
        f"one misses them by {best * length * 1e3:.3g} mm and {np.rad2deg(best):.3g} deg.",
        hint="Do setpoint_cp and setpoint_jp belong to the same tool, and is joint_types right?",
    )


def workspace(T: FloatArray) -> float:
    """Return the size of the space that positions of poses `(n, 4, 4)` fill, m: what weighs as much as one radian.

    Parameters
    ----------
    T : (n, 4, 4) array
    """
    return max(float(np.linalg.norm(T[:, :3, 3].std(axis=0))), 1e-3)


class _Screws:
    """Joint frames (dof, 4, 4), whose z axes are the joints', and the tip (4, 4), at a home posture (dof,)."""

    def __init__(self, types: str, home: FloatArray, frames: FloatArray, tip: FloatArray) -> None:
        self.types, self.home, self.frames, self.tip = types, home, frames, tip

    @classmethod
    def start(cls, q: FloatArray, T: FloatArray, types: str, near: IntArray) -> _Screws:
        """Return screws that move the tip as the samples `near` a posture do, to first order."""
        home, moved = T[near[0]], q[near] - q[near[0]]
        turned = se3.rotvec_from_matrix(T[near, :3, :3] @ home[:3, :3].T)
        angular = np.linalg.lstsq(moved, turned, rcond=None)[0]
        linear = np.linalg.lstsq(moved, T[near, :3, 3] - home[:3, 3], rcond=None)[0]
        frames = []
        for kind, w, v in zip(types, angular, linear, strict=True):
            axis = w if kind == "R" else v
            axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 0 else np.array([0.0, 0.0, 1.0])
            point = home[:3, 3] + (np.cross(axis, v) if kind == "R" else 0.0)  # v = axis x (p - point)
            frames.append(joint_frame(point, axis))
        return cls(types, q[near[0]], np.array(frames), home)

    def fitted(self, q: FloatArray, T: FloatArray, length: float) -> tuple[_Screws, float]:
        """Return the screws that reach poses (n, 4, 4) from joints (n, dof) best, and the root mean square misfit."""
        screws, damping = self, DAMPING[0]
        errors, slopes = screws._linearised(q, T, length)
        for _ in range(STEPS):
            normal, pull = slopes.T @ slopes, slopes.T @ errors
            curvature = np.trace(normal) / len(normal)
            step = np.linalg.solve(normal + damping * curvature * np.eye(len(normal)), pull)
            motions = se3.exp(step.reshape(-1, 6))
            changed = _Screws(self.types, self.home, motions[:-1] @ screws.frames, motions[-1] @ screws.tip)
            found, steeper = changed._linearised(q, T, length)
            if found @ found < errors @ errors:
                settled = found @ found > (1 - 1e-6) * (errors @ errors) or found @ found < 1e-24 * len(found)
                screws, errors, slopes, damping = changed, found, steeper, max(damping / 10, DAMPING[0])
                if settled:
                    break
            else:
                damping *= 10
                if damping > DAMPING[1]:
                    break
        return screws, float(np.sqrt(np.mean(errors**2)))

    def _linearised(self, q: FloatArray, T: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
        """Return what is missed (6 n,), and its slope (6 n, 6 dof + 6) in twists of the frames and the tip.

        A frame that moves by the twist x turns its joint's motion E into exp(x) E exp(-x), which moves the tip by the
        twist `Ad_A (1 - Ad_E) x`, A the motion of the joints before.
        """
        n, before = len(q), np.broadcast_to(np.eye(4), (len(q), 4, 4))
        twists = []
        for j, kind in enumerate(self.types):
            local = np.broadcast_to(np.eye(4), (n, 4, 4)).copy()
            by = q[:, j] - self.home[j]
            if kind == "R":
                local[:, :3, :3] = se3.matrix_from_rotvec(by[:, None] * np.array([0.0, 0.0, 1.0]))
            else:
                local[:, 2, 3] = by
            motion = self.frames[j] @ local @ se3.invert(self.frames[j])
            twists.append(_adjoint(before) @ (np.eye(6) - _adjoint(motion)))
            before = before @ motion
        twists.append(_adjoint(before))
        reached = before @ self.tip
        to_point = np.broadcast_to(np.eye(6), (n, 6, 6)).copy()
        to_point[:, :3, 3:] = -se3.hat(reached[:, :3, 3])
        to_point[:, :3] /= length
        turned = se3.rotvec_from_matrix(T[:, :3, :3] @ np.swapaxes(reached[:, :3, :3], -1, -2))
        missed = np.hstack([(T[:, :3, 3] - reached[:, :3, 3]) / length, turned])
        return missed.ravel(), (to_point @ np.concatenate(twists, axis=-1)).reshape(6 * n, -1)

    def chain(self) -> Chain:
        """Return the chain: a placed joint each."""
        placements = [self.frames[0], *(se3.invert(self.frames[:-1]) @ self.frames[1:])]
        joints = tuple(
            Joint(
                kind="R" if kind == "R" else "P",
                alpha=0.0,
                a=0.0,
                d=0.0 if kind == "R" else -float(at),
                theta=-float(at) if kind == "R" else 0.0,
                lower=-BEYOND,
                upper=BEYOND,
                placement=placement,
            )
            for kind, at, placement in zip(self.types, self.home, placements, strict=True)
        )
        return Chain(joints, "modified", tool=se3.invert(self.frames[-1]) @ self.tip)


def _adjoint(T: FloatArray) -> FloatArray:
    """Return the adjoint maps `(n, 6, 6)` of twists (v, w) by motions `(n, 4, 4)`."""
    adjoint = np.zeros((len(T), 6, 6))
    adjoint[:, :3, :3] = adjoint[:, 3:, 3:] = T[:, :3, :3]
    adjoint[:, :3, 3:] = se3.hat(T[:, :3, 3]) @ T[:, :3, :3]
    return adjoint
