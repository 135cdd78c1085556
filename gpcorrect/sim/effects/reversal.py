"""Effects of reversal: play, friction and hysteresis, by which it counts from where the joint came."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import SIDES, FrictionEffect, JointEffect
from gpcorrect.sim.effects.bouc_wen import bouc_wen
from gpcorrect.sim.effects.description import PHASE, Description, Family, Ladder, Parameter, Per, Range, Run
from gpcorrect.sim.effects.laws import FrictionLaw
from gpcorrect.sim.effects.operators import Memory, play, plays, upright
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

TORQUES = ("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp")  # what friction needs to be seen
LAWS = ("bouc_wen", "plays")
PLAYS = 8  # in the sum: with twice as many the path changes by less than a hundredth of the radius

# Units, physical ranges and typical sizes on revolute and prismatic joints.
RADIUS = Range("rad", 0.0, 0.6, 0.01), Range("m", 0.0, 0.02, 5e-4)
TORQUE = Range("N m", 0.0, 20.0, 0.3), Range("N", 0.0, 500.0, 3.0)
DAMPING = Range("N m s/rad", 0.0, 300.0, 0.5), Range("N s/m", 0.0, 2e4, 20.0)
STATIC = Range("N m", 0.0, 30.0, 0.5), Range("N", 0.0, 600.0, 5.0)
SPEED = Range("rad/s", 1e-4, 2.0, 0.05), Range("m/s", 1e-5, 0.2, 0.005)
RESTS = ("dry", "soft", "elastic")  # it sticks, creeps, or bends; Coulomb's alone bends, for the time of a search
ONSET = Range("rad/s", 0.0, 0.5, 0.05), Range("m/s", 0.0, 0.05, 0.005)
MUJOCO_TIME = 0.0095  # s: half of MuJoCo's default time constant times the largest impedance that is its default
CREEP = Parameter("onset", "speed over which it grows", *ONSET, ladder=Ladder(Per.PRIOR, (0.1,)), only=("rest", "soft"))
# By design: at 0.3 N m a milliradian before it slips.
BRISTLE = Range("N m/rad", 1.0, 1e6, 300.0), Range("N/m", 100.0, 1e8, 3e4)
BEND = Parameter(
    "bristle",
    "stiffness of what bends before it slips",
    *BRISTLE,
    ladder=Ladder(Per.PRIOR, (0.3,)),
    only=("rest", "elastic"),
    unbounded=True,
)
SWING = Range("N m", -20.0, 20.0, 0.2), Range("N", -100.0, 100.0, 2.0)
WAVES = Range("1", 0.1, 300.0, 6.0), Range("rad/m", 1.0, 5000.0, 60.0)


@dataclass(frozen=True)
class Backlash(JointEffect):
    """A gap in the transmission, through which the joint follows the motor as a play."""

    radius: float

    about = Description(
        name="backlash",
        number=14,
        family=Family.REVERSAL,
        equation="q = play(m, radius): w = min(max(w_before, m - radius), m + radius)",
        source="Krasnosel'skii and Pokrovskii 1989, Systems with Hysteresis, Sec. 2",
        parameters=(Parameter("radius", "half the gap", *RADIUS, ladder=Ladder(Per.RANGE, (0.003, 0.01, 0.03, 0.1))),),
        neighbours=("coulomb_friction", "hysteresis", "loaded_backlash"),
        separating_runs=(Run.AMPLITUDES, Run.LOAD_SWAP, Run.GAIN_CHANGE, Run.SPEED_LADDER),
    )

    def forgets_after(self) -> dict[int, float]:
        """Return the whole gap."""
        return dict.fromkeys(self.joints, 2.0 * self.radius)

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return play(q[..., j], self.radius, memory)


@dataclass(frozen=True)
class LoadedBacklash(JointEffect):
    """A gap in a gear of which the load chooses the flank: the joint falls across when its load changes sign.

    Where the load never does it is an offset. How long the joint falls is left out.
    """

    radius: float

    about = Description(
        name="loaded_backlash",
        number=43,
        family=Family.REVERSAL,
        equation="q = m - radius sign(tau)",
        source="Nordin and Gutman 2002, Automatica 38(10), dead-zone model of a gap behind an inertia",
        parameters=(Parameter("radius", "half the gap", *RADIUS),),
        neighbours=("backlash", "cable_stretch", "nonlinear_stretch", "homing_offset"),
        separating_runs=(Run.LOAD_SWAP, Run.POSE_SPREAD),
        turned_load=True,
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - self.radius * np.sign(motion.load[..., j])


@dataclass(frozen=True)
class _RestingFriction(FrictionEffect):
    """Friction that sticks at rest, or creeps.

    Of one that creeps before it slips, as in a greased bearing and in simulators that regularise friction, the rest is
    "soft", and `onset` the speed over which it grows. It is MuJoCo's: what it can hold it brings to rest, or to its
    creep, with a time constant of `onset_time`, which is no parameter to be found: by default that of MuJoCo.
    """

    onset: float = field(default=0.0, kw_only=True)
    onset_time: float = field(default=MUJOCO_TIME, kw_only=True)
    rest: str = field(default="dry", kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.onset_time >= 0:
            raise DataError(f"effect {self.about.name}: onset_time must be >= 0, got {self.onset_time!r}.")

    def _at_rest(self, law: FrictionLaw) -> FrictionLaw:
        return law.softened(self.onset, self.onset_time) if self.rest == "soft" else law


@dataclass(frozen=True)
class CoulombFriction(_RestingFriction):
    """Friction of fixed size: by a proportional gain an error of torque / kp that changes sign at reversals.

    Dry, or soft at rest: :class:`_RestingFriction`; or elastic, where it bends before it slips as cables and gears do
    (dry where `bristle` is 0 or infinite).
    """

    torque: float = field(kw_only=True)
    bristle: float = field(default=0.0, kw_only=True)

    about = Description(
        name="coulomb_friction",
        number=15,
        family=Family.REVERSAL,
        equation="F = torque sign(v), |F| <= torque at rest; "
        "soft: F = torque (v + onset_time v') / onset, |F| <= torque; elastic: F' = bristle (v - |v| F / torque)",
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7); "
        "MuJoCo's documentation, Computation, constraint model",
        parameters=(
            Parameter("torque", "size of the friction", *TORQUE),
            CREEP,
            BEND,
        ),
        needs=TORQUES,
        neighbours=("viscous_friction", "delay", "backlash"),
        separating_runs=(Run.SPEED_LADDER, Run.GAIN_CHANGE),
        choices=(("side", SIDES), ("rest", RESTS)),
    )

    def law(self) -> FrictionLaw:
        """Return the limit, and what it is approached by."""
        bristle = self.bristle if self.rest == "elastic" and np.isfinite(self.bristle) else 0.0
        return self._at_rest(FrictionLaw(torque=self.torque, bristle=bristle))

    def forgets_after(self) -> dict[int, float]:
        """Return the way on which it bends over; any move will do where it does not bend."""
        law = self.law()
        return dict.fromkeys(self.joints, 2.0 * law.torque / law.bristle if law.bristle else 0.0)


@dataclass(frozen=True)
class ViscousFriction(FrictionEffect):
    """Damping; through a proportional gain it becomes a lag of b / kp seconds in this joint."""

    damping: float = field(kw_only=True)

    about = Description(
        name="viscous_friction",
        number=16,
        family=Family.REVERSAL,
        equation="F = damping v",
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)",
        parameters=(Parameter("damping", "torque for each unit of speed", *DAMPING),),
        needs=TORQUES,
        neighbours=("delay", "coulomb_friction", "gain_error", "command_delay"),
        separating_runs=(Run.SPEED_LADDER, Run.GAIN_CHANGE),
        choices=(("side", SIDES),),
    )

    def law(self) -> FrictionLaw:
        """Return the constant damping."""
        return FrictionLaw(damping=self.damping)


@dataclass(frozen=True)
class StribeckFriction(_RestingFriction):
    """Friction that falls from a static to a kinetic value as the joint picks up speed.

    Dry or soft at rest: :class:`_RestingFriction`.
    """

    torque: float = field(kw_only=True)
    static_torque: float = field(kw_only=True)
    speed: float = field(kw_only=True)

    about = Description(
        name="stribeck_friction",
        number=17,
        family=Family.REVERSAL,
        equation="F = (torque + (static_torque - torque) exp(-(v / speed)^2)) sign v; soft: as of Coulomb's",
        source="Bo and Pavelescu 1982, Wear 82(3); Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30(7)",
        parameters=(
            Parameter("torque", "friction at speed", *TORQUE),
            Parameter("static_torque", "friction at rest", *STATIC),
            Parameter(
                "speed", "speed over which the one becomes the other", *SPEED, ladder=Ladder(Per.PRIOR, (0.2, 1.0, 5.0))
            ),
            CREEP,
        ),
        needs=TORQUES,
        neighbours=("coulomb_friction", "viscous_friction"),
        separating_runs=(Run.SPEED_LADDER, Run.GAIN_CHANGE),
        choices=(("side", SIDES), ("rest", RESTS[:2])),
    )

    def law(self) -> FrictionLaw:
        """Return both limits, the speed between them, and what they are approached by."""
        return self._at_rest(FrictionLaw(torque=self.torque, static=self.static_torque, speed=self.speed))


@dataclass(frozen=True)
class CapstanFriction(FrictionEffect):
    """Friction of a cable around pulleys and sheaths, which grows with the load, more against it than with it.

    The motor pays tau exp(mu theta) to lift a load tau and tau exp(-mu theta) to let it down; in between it sticks.
    """

    wrap: float = field(kw_only=True)

    about = Description(
        name="capstan_friction",
        number=18,
        family=Family.REVERSAL,
        equation="T2 = T1 exp(wrap sign v): F = tau (exp(wrap sign(v tau)) - 1)",
        source="Euler and Eytelwein's belt; Kaneko, Yamashita, Tanie 1991, tendon transmissions, ICAR",
        parameters=(
            Parameter("wrap", "friction coefficient times wrap angle", Range("1", 0.0, 3.0, 0.15), positive=True),
        ),
        needs=TORQUES,
        neighbours=("coulomb_friction",),
        separating_runs=(Run.LOAD_SWAP, Run.POSE_SPREAD),
        choices=(("side", SIDES),),
    )

    def law(self) -> FrictionLaw:
        """Return what the wrap takes of the load."""
        return FrictionLaw(wrap=self.wrap)


@dataclass(frozen=True)
class PositionDependentFriction(FrictionEffect):
    """Dry friction whose size swings with the joint's position, never below zero."""

    torque: float = field(kw_only=True)
    swing: float = field(kw_only=True)
    waves: float = field(kw_only=True)
    phase: float = field(kw_only=True)

    about = Description(
        name="position_dependent_friction",
        number=19,
        family=Family.REVERSAL,
        equation="F = max(0, torque + swing sin(waves q + phase)) sign v",
        source="Armstrong 1988, ICRA, Friction: experimental determination, modeling and compensation",
        parameters=(
            Parameter("torque", "mean friction", *TORQUE),
            Parameter("swing", "size of the part that varies", *SWING, positive=False),
            Parameter(
                "waves",
                "phase for each unit of the joint",
                *WAVES,
                ladder=Ladder(Per.SWEEP, (1.5 * np.pi, 2 * np.pi, 4 * np.pi), within=(np.pi, 1e9)),
            ),
            PHASE,
        ),
        needs=TORQUES,
        neighbours=("coulomb_friction", "pulley_eccentricity"),
        separating_runs=(Run.AMPLITUDES, Run.SPEED_LADDER),
        choices=(("side", SIDES),),
    )

    def canonical(self) -> PositionDependentFriction:
        """Return the same wave with a positive swing and a phase within half a turn."""
        swing, phase = upright(self.swing, self.phase)
        return replace(self, swing=swing, phase=phase)

    def law(self) -> FrictionLaw:
        """Return mean and wave."""
        return FrictionLaw(torque=self.torque, swing=self.swing, waves=self.waves, phase=self.phase)


@dataclass(frozen=True)
class Hysteresis(JointEffect):
    """The joint lags behind the motor by the state of an element with memory."""

    radius: float
    sharpness: float = 1.0  # a long soft curve; a large one is a play with a corner
    depth: float = 1.0
    law: str = "bouc_wen"  # that element with beta = gamma; "plays": a Prandtl-Ishlinskii sum of plays

    about = Description(
        name="hysteresis",
        number=20,
        family=Family.REVERSAL,
        equation="q = m - z, dz = depth (1 - |z / radius|^sharpness (1 + sign(z dm)) / 2) dm; "
        "or q = (1 - depth) m + depth mean of play(m, r_i / depth), r_i mean radius",
        source="Bouc 1967; Wen 1976; Ismail, Ikhouane, Rodellar 2009, Arch. Comput. Methods Eng. 16; "
        "Brokate and Sprekels 1996, Hysteresis and Phase Transitions, Sec. 2.4",
        parameters=(
            Parameter("radius", "largest lag", *RADIUS, ladder=Ladder(Per.RANGE, (0.01, 0.03, 0.1))),
            Parameter(
                "sharpness",
                "exponent of the curve",
                Range("1", 0.3, 20.0, 1.5),
                above=0.0,
                ladder=Ladder(Per.VALUE, (1.0, 3.0)),
            ),
            Parameter(
                "depth",
                "share of a motion that is lost right after a reversal",
                Range("1", 1e-4, 1.0, 0.25),  # from a tenth of a milliradian of a stroke of one radian on
                above=0.0,
                at_most=1.0,
                ladder=Ladder(Per.VALUE, (0.25,), absent=True),
            ),
        ),
        neighbours=("backlash", "coulomb_friction"),
        separating_runs=(Run.AMPLITUDES, Run.LOAD_SWAP, Run.GAIN_CHANGE),
        choices=(("law", LAWS),),
    )

    def forgets_after(self) -> dict[int, float]:
        """Return the way over which it turns from one side to the other."""
        return dict.fromkeys(self.joints, 2.0 * self.radius / self.depth)

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        m, width = q[..., j], self.radius / self.depth
        if self.law == "bouc_wen":
            return m - self.depth * bouc_wen(m, width, self.sharpness, memory)
        spread = ((np.arange(PLAYS) + 0.5) / PLAYS) ** (1.0 / self.sharpness)
        return m - self.depth * (m - plays(m, width * spread / spread.mean(), memory))
