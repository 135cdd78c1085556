"""Effects of dynamics: swinging on the cable, and a motor or controller that is another than the one modelled."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from gpcorrect.sim.body import Body, Drive
from gpcorrect.sim.effects.base import DriveEffect, Effect, JointEffect, LoadEffect
from gpcorrect.sim.effects.compliance import Payload
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory, ring
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class Resonance(JointEffect):
    """The joint follows the motor as a second-order system: overshoot and ringing after fast changes.

    Samples slower than twice its frequency do not show it.
    """

    frequency: float
    damping_ratio: float

    about = Description(
        name="resonance",
        number=27,
        family=Family.DYNAMICS,
        equation="q'' + 2 damping_ratio w q' + w^2 q = w^2 m, w = 2 pi frequency",
        source="Spong 1987, J. Dyn. Syst. Meas. Control 109(4), elastic joints, one mode",
        parameters=(
            Parameter(
                "frequency",
                "natural frequency",
                Range("Hz", 3.0, 60.0, 14.0),
                above=0.0,
                identity=inf,
                ladder=Ladder(Per.VALUE, (5.0, 10.0, 20.0, 40.0)),
                valleys=True,
            ),
            Parameter(
                "damping_ratio",
                "fraction of critical damping",
                Range("1", 0.0, 0.7, 0.1),
                ladder=Ladder(Per.VALUE, (0.03, 0.3)),
            ),
        ),
        neighbours=("delay", "cable_stretch"),
        separating_runs=(Run.SPEED_LADDER, Run.ONE_JOINT),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return ring(q[..., j], motion.time, self.frequency, self.damping_ratio, memory)


TERMS = ("gravity", "inertia", "velocity")  # in the order of `Drive.beyond`


@dataclass(frozen=True)
class FeedforwardError(DriveEffect):
    """A joint's controller, or all, feeds a further fraction of one term forward; -1 is a term that the machine lacks.

    Terms are "gravity", what holds the nominal arm, "inertia", what accelerates it and its motors, and "velocity", kd
    times the commanded velocity.
    """

    fraction: float
    term: str = "gravity"

    about = Description(
        name="feedforward_error",
        number=30,
        family=Family.DYNAMICS,
        equation="tau = tau_nominal + fraction tau_term(q_commanded)",
        source="computed-torque control with wrong terms; Siciliano et al. 2009, Robotics, Sec. 8.5",
        parameters=(
            # From a term that is missing (-1) to one that is fed twice, and a quarter beyond: more is another thing.
            Parameter(
                "fraction", "fraction fed forward beyond the model", Range("1", -1.25, 1.25, 0.3), positive=False
            ),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=(
            "gain_error",
            "payload",
            "viscous_friction",
            "inertia_error",
            "gravity_error",
            "motor_constant_error",
        ),
        separating_runs=(Run.SPEED_LADDER, Run.POSE_SPREAD, Run.GAIN_CHANGE),
        sites=(Site.JOINT, Site.ALL),
        choices=(("term", TERMS),),
    )

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Add the fraction to what is fed forward."""
        beyond = np.array(np.broadcast_to(drive.beyond, (3, len(joints))))
        beyond[TERMS.index(self.term)] += self._of_each(self.fraction, joints)
        return replace(drive, beyond=beyond)


GAINS = ("both", "derivative")


@dataclass(frozen=True)
class GainError(DriveEffect):
    """A joint's controller, or all, has other gains than the model's: each is off by a fraction of its own.

    Where a controller brakes by the motor's own speed, as a robot file's servo does, `derivative` alone is what viscous
    friction on the motor would be.
    """

    proportional: float = 0.0
    derivative: float = 0.0
    gains: str = "both"

    about = Description(
        name="gain_error",
        number=31,
        family=Family.DYNAMICS,
        equation="tau = kp (1 + proportional) (q_d - q) + kd (1 + derivative) (v_d - v)",
        source="PD control on the motor side, RAVEN-II control software",
        parameters=(
            Parameter(
                "proportional",
                "relative error of kp",
                Range("1", -0.9, 9.0, 0.2),
                positive=False,
                only=("gains", "both"),
            ),
            Parameter("derivative", "relative error of kd", Range("1", -0.9, 9.0, 0.2), positive=False),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("feedforward_error", "viscous_friction", "command_delay", "motor_constant_error"),
        separating_runs=(Run.SPEED_LADDER, Run.LOAD_SWAP),
        sites=(Site.JOINT, Site.ALL),
        choices=(("gains", GAINS),),
    )

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Scale the gains."""
        proportional = 1.0 + self._of_each(self.proportional if self.gains == "both" else 0.0, joints)
        derivative = 1.0 + self._of_each(self.derivative, joints)
        kv = None if drive.kv is None else drive.kv * derivative
        return replace(drive, kp=drive.kp * proportional, kd=drive.kd * derivative, kv=kv)


KNOWN_TO = 1.2  # times an inertia of a servo's steps, to which a fit knows it; chosen by hand, on one case


@dataclass(frozen=True)
class InertiaError(DriveEffect):
    """A motor and its gears are harder to accelerate than the model says, which the controller does not know."""

    inertia: float

    about = Description(
        name="inertia_error",
        number=34,
        family=Family.DYNAMICS,
        equation="(I + inertia) m'' = tau - load, I the nominal motor inertia, at least 0 together",
        source="reflected rotor inertia; Spong, Hutchinson and Vidyasagar 2006, Robot Modeling and Control, Sec. 6.1",
        parameters=(
            Parameter(
                "inertia",
                "inertia beyond the model's",
                Range("kg m^2", -1.0, 10.0, 0.05),
                Range("kg", -100.0, 1000.0, 5.0),  # RAVEN-II's insertion has 66
                positive=False,
            ),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("feedforward_error", "velocity_filter"),
        separating_runs=(Run.POSE_SPREAD, Run.SPEED_LADDER),
    )

    def is_a_matter_of_steps(self, drive: Drive, joints: tuple[int, ...]) -> bool:
        """Up to a step times half of what the drive resists speed with.

        A loop of step h with implicit damping kd comes to (I + h kd / 2) m'', with explicit damping to (I - h kd / 2)
        m'', and one without steps, or that holds its torque for them, to I m''. Ours holds it, or does as MuJoCo does:
        that may be either of the other two, and is off from them by twice as much. A controller that differentiates its
        encoder lags by half a step more, which is just as much; a fifth is for how well the number is known.
        """
        before, behind = drive.speed_gains
        resisted = before + behind + (0.0 if drive.damping is None else drive.damping)
        most = KNOWN_TO * resisted / drive.rate_hz * (0.5 if drive.kv is None else 1.0)
        return bool(abs(self.inertia) <= most[self.column(joints)])

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Add to the motor's inertia."""
        j, inertia = self.column(joints), np.array(drive.motor_inertia)
        inertia[j] = max(0.0, inertia[j] + self.inertia)
        known = drive.motor_inertia if drive.known_inertia is None else drive.known_inertia
        return replace(drive, motor_inertia=inertia, known_inertia=known)


@dataclass(frozen=True)
class VelocityFilter(DriveEffect):
    """Controllers see their motors' speed through a low-pass filter, as where encoders are differentiated.

    On slow motion kd brakes what was, which is as if the motors had `kd time_constant` less inertia.
    """

    time_constant: float

    about = Description(
        name="velocity_filter",
        number=40,
        family=Family.DYNAMICS,
        equation="tau = kp (q_d - q) + kd (v_d - s), time_constant s' + s = v",
        source="filtered derivative; Astrom and Hagglund 1995, PID Controllers, Sec. 3.3",
        parameters=(Parameter("time_constant", "of the filter", Range("s", 0.0, 0.1, 0.002)),),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("inertia_error", "feedforward_error"),
        separating_runs=(Run.SPEED_LADDER, Run.GAIN_CHANGE),
        sites=(Site.ALL, Site.JOINT),
    )

    def is_a_matter_of_steps(self, drive: Drive, joints: tuple[int, ...]) -> bool:
        """Up to a step: half by a difference of positions, half by when in a step they are read.

        And up to a step of the joint's own viscous damping, which acts by a speed before that step as if the motor had
        so much less inertia: a link without a rotor has no other words for it. PyBullet's arm in steps of 1 ms lags by
        0.97 steps, and its last joint, with a damping of 1.7 kd, by 2.7.
        """
        damping = 0.0 if drive.damping is None else drive.damping
        most = KNOWN_TO * (1.0 + damping / np.maximum(drive.kd, np.finfo(float).tiny)) / drive.rate_hz
        most = np.broadcast_to(most, drive.kd.shape)
        return bool(self.time_constant <= (most.min() if self.joint == "all" else most[self.column(joints)]))

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Filter the speeds; a filter that was there already has its time constant added."""
        return replace(drive, filtered=self._of_each(self.time_constant, joints, drive.filtered))


@dataclass(frozen=True)
class IntegralAction(DriveEffect):
    """Controllers add up their errors beyond what the model says: what holds a joint off fades.

    A motion begins in balance.
    """

    rate: float

    about = Description(
        name="integral_action",
        number=41,
        family=Family.DYNAMICS,
        equation="tau = tau_nominal + kp rate integral of (q_d - q)",
        source="PID control; Astrom and Hagglund 1995, PID Controllers, Sec. 3.2",
        parameters=(Parameter("rate", "ki over kp, beyond the model's", Range("1/s", 0.0, 100.0, 2.0)),),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("gain_error", "feedforward_error"),
        separating_runs=(Run.SPEED_LADDER, Run.POSE_SPREAD),
        sites=(Site.ALL, Site.JOINT),
    )

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Add to the gains."""
        more = self._of_each(self.rate, joints) * drive.kp
        return replace(drive, ki=more if drive.ki is None else drive.ki + more)


@dataclass(frozen=True)
class MotorConstantError(DriveEffect):
    """A motor, or all, delivers a further fraction of what its controller commands, as with a wrong torque constant.

    `measured_jf` still says what was commanded. Where nothing is fed forward it is what both gains off by the same
    fraction would be.
    """

    fraction: float

    about = Description(
        name="motor_constant_error",
        number=42,
        family=Family.DYNAMICS,
        equation="tau = (1 + fraction) tau_commanded",
        source="torque constant; Spong, Hutchinson and Vidyasagar 2006, Robot Modeling and Control, Sec. 6.1",
        parameters=(
            Parameter(
                "fraction", "relative error of the torque", Range("1", -0.9, 9.0, 0.2), positive=False, above=-1.0
            ),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("feedforward_error", "gain_error"),
        separating_runs=(Run.SPEED_LADDER,),
        sites=(Site.JOINT, Site.ALL),
    )

    def like(self) -> Effect:
        """Return both gains off by the same fraction."""
        return GainError(self.joint, self.fraction, self.fraction)

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Scale all that is commanded: gains, what is fed forward, and the limit of what the drive asks for."""
        part = 1.0 + self._of_each(self.fraction, joints)
        numbers = {name: getattr(drive, name) for name in ("kp", "kd", "kv", "ki", "limit")}
        scaled = {name: number * part for name, number in numbers.items() if number is not None}
        return replace(drive, delivered=drive.delivered * part, **scaled)


@dataclass(frozen=True)
class BelievedPayload(LoadEffect):
    """A payload that the controller was told of beyond the model's, and that the arm does not carry."""

    mass: float
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    place: str = "tip"

    believed = True
    about = replace(
        Payload.about,
        name="believed_payload",
        number=44,
        family=Family.DYNAMICS,
        equation="tau_fed = tau_fed_0 + J^T mass (a - g), of the terms that are fed forward",
        source="a wrong payload in a controller's settings; Siciliano et al. 2009, Robotics, Sec. 8.5",
        neighbours=("payload", "feedforward_error"),
        separating_runs=(Run.SPEED_LADDER, Run.POSE_SPREAD),
    )

    def act(self, body: Body) -> Body:
        """Put it on the arm that the controller computes with."""
        return Payload("all", self.mass, self.x, self.y, self.z, self.place).act(body)


FRICTIONS = ("dry", "viscous")


@dataclass(frozen=True)
class MissingFriction(DriveEffect):
    """A joint has less friction than the model says; where the model states none, nothing is missing."""

    part: float
    term: str = "dry"

    about = Description(
        name="missing_friction",
        number=37,
        family=Family.DYNAMICS,
        equation="F = (1 - part) F_nominal",
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)",
        parameters=(
            Parameter("part", "of the model's friction, that is not there", Range("1", 0.0, 1.0, 0.3), at_most=1.0),
        ),
        needs=("setpoint_jp", "measured_jp|external_jp|tracker_cp"),
        neighbours=("gain_error", "feedforward_error"),
        separating_runs=(Run.SPEED_LADDER, Run.GAIN_CHANGE),
        choices=(("term", FRICTIONS),),
    )

    def act(self, drive: Drive, joints: tuple[int, ...]) -> Drive:
        """Take the part away; soft friction grows as fast as before, up to less."""
        left = np.ones(len(joints))
        left[self.column(joints)] = 1.0 - self.part
        if self.term == "viscous":
            return drive if drive.damping is None else replace(drive, damping=drive.damping * left)
        if drive.friction is None:
            return drive
        onset = None if drive.onset is None else drive.onset * np.stack([left, np.ones(len(joints))])
        return replace(drive, friction=drive.friction * left, onset=onset)
