"""What moves: the state that effects may look at, and the readings that come out."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Motion:
    """N parallel runs as the motors made them, n samples each.

    Parameters
    ----------
    joints : tuple of int, joint numbers of the columns
    time : (n, N) array, seconds since the session began; steps may be uneven
    session : (N,) int array, index of the session of each run, from 0
    position, velocity : (n, N, dof) arrays, reported motor position (joint units) and its rate
    load : (n, N, dof) array
        Torque or force that the transmission passes to each joint: holds the links up, accelerates them, and overcomes
        the friction behind the cable.
    gravity_load : (n, N, dof) array, the part of it that holds the links up
    tip_force : (N, 3) array or None
        Force on the tip in each run, base frame, N: the payload's weight. None is none.
    """

    joints: tuple[int, ...]
    time: FloatArray
    session: IntArray
    position: FloatArray
    velocity: FloatArray
    load: FloatArray
    gravity_load: FloatArray
    tip_force: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Readings:
    """What the sensors say, n samples of N runs.

    Parameters
    ----------
    measured_jp, measured_jv, measured_jf : (n, N, dof) arrays, reported joint positions, velocities and efforts
    external_jp : (n, N, dof) array, joint positions seen from outside
    T_tracker_marker : (n, N, 4, 4) array or None
        Marker poses in the tracker's frame; None for an arm without kinematics.
    """

    measured_jp: FloatArray
    measured_jv: FloatArray
    measured_jf: FloatArray
    external_jp: FloatArray
    T_tracker_marker: FloatArray | None
