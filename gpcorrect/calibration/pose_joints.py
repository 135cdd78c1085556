"""Samples of a log of poses in the joints that take the arm there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from gpcorrect.calibration.arm_kinematics import ArmKinematics
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, LogMeta, PoseSignal

SAME_BRANCH = 1.0
"""rad or m that a command and its pose may be apart in joints: more is another branch of the inverse. By hand."""


@dataclass(frozen=True, eq=False)
class PoseJoints:
    """Samples of a log of poses, in the joints of its arm; NaN where there are none."""

    log: CalibrationLog  # n samples of joints: the next two, as set points and as what was seen from outside
    # (n, d) each: joints of commands and of references, rad or m
    asked: FloatArray
    wanted: FloatArray
    # the poses
    reference: PoseSignal
    command: PoseSignal
    known: BoolArray  # (n,) which have joints of a reference, in a posture where poses determine joints

    @classmethod
    def of(
        cls,
        log: CalibrationLog,
        pair: tuple[PoseSignal, PoseSignal],
        kinematics: ArmKinematics,
        wanted: FloatArray | None = None,
    ) -> Self:
        """Return the samples of a log.

        Parameters
        ----------
        log : CalibrationLog, n samples
        pair : two PoseSignal, their references and commands
        kinematics : ArmKinematics, of the arm
        wanted : (n, d) array, optional, joints of the references, where they are known already
        """
        wanted = kinematics.inverse(pair[0]) if wanted is None else np.array(wanted)
        asked = kinematics.inverse(pair[1])
        wanted[~(np.abs(wanted - asked) <= SAME_BRANCH).all(axis=1)] = np.nan
        joints = CalibrationLog(
            time=log.time,
            trajectory=log.trajectory,
            session=log.session,
            setpoint_jp=asked,
            external_jp=wanted,
            meta=LogMeta(joint_types=kinematics.chain.joint_types),
            name=log.name,
        )
        known = np.isfinite(wanted).all(axis=1) & kinematics.determined(asked)
        return cls(joints, asked, wanted, *pair, known)

    @property
    def back(self) -> PoseJoints:
        """The same with commands as the references, and what they reach as what is looked for."""
        return replace(self, asked=self.wanted, wanted=self.asked, reference=self.command, command=self.reference)
