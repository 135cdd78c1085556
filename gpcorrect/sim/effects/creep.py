"""Creep: a loaded cable goes on stretching slowly, and recovers slowly."""

from __future__ import annotations

from dataclasses import dataclass

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory, lag
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class Creep(JointEffect):
    """The joint lags behind the motor by a stretch that follows the load with a delay of seconds to minutes.

    It starts in balance with the first load of a session and goes on from run to run; between two runs the load is
    taken as linear.
    """

    compliance: float
    time_constant: float

    stage = Stage.TRANSMISSION
    about = Description(
        name="creep",
        number=21,
        family=Family.TIME,
        equation="q = m - x, time_constant x' + x = compliance tau",
        source="Kelvin-Voigt element; Findley, Lai, Onaran 1976, Creep and Relaxation of Nonlinear Materials, Ch. 5",
        parameters=(
            Parameter(
                "compliance",
                "settled stretch for each unit of load",
                revolute=Range("rad/(N m)", 0.0, 0.1, 2e-3),
                prismatic=Range("m/N", 0.0, 1e-3, 2e-5),
                positive=True,
            ),
            Parameter(
                "time_constant",
                "time in which it settles",
                revolute=Range("s", 0.1, 1e4, 10.0),
                positive=True,
                ladder=Ladder(Per.PRIOR, (0.1, 1.0, 10.0)),
            ),
        ),
        needs=("measured_jp|setpoint_jp", "external_jp|tracker_cp"),
        neighbours=("drift", "cable_stretch"),
        separating_runs=(Run.HOLD_UNLOAD, Run.LOAD_SWAP),
        sites=(Site.JOINT,),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        slow = lag(motion.load[..., j], motion.time, self.time_constant, motion.session, memory)
        return q[..., j] - self.compliance * slow
