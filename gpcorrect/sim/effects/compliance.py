"""Effects of compliance: what gives way under a load, and a load that nobody knows of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body
from gpcorrect.sim.effects.base import JointEffect, LoadEffect, Stage, TipEffect, TorqueEffect
from gpcorrect.sim.effects.description import Description, Family, Ladder, Parameter, Per, Range, Run, Site, axes
from gpcorrect.sim.effects.laws import TorqueLaw
from gpcorrect.sim.effects.operators import Memory
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

# Units, physical ranges and typical sizes on either type; up to gears of heavy arms (RV reducers) and ball screws.
STIFFNESS = Range("N m/rad", 2.0, 1e7, 200.0), Range("N/m", 100.0, 2e9, 2e4)
CUBIC = Range("N m/rad^3", 0.0, 1e14, 2e8), Range("N/m^3", 0.0, 1e18, 2e12)
RIGIDITY = Range("N m^2/rad", 1.0, 5e4, 80.0), Range("N", 50.0, 5e6, 8e3)
STRUCTURE = Range("N m/rad", 2.0, 1e7, 300.0), Range("N/m", 100.0, 2e9, 3e4)
SPRING = Range("N m/rad", -1e4, 1e4, 3.0), Range("N/m", -1e5, 1e5, 300.0)
PUSH = Range("N m", -1e3, 1e3, 1.0), Range("N", -1e4, 1e4, 10.0)


@dataclass(frozen=True)
class CableStretch(JointEffect):
    """The joint lags behind the motor by the torque it takes, over the cable's stiffness."""

    stiffness: float

    about = Description(
        name="cable_stretch",
        number=7,
        family=Family.COMPLIANCE,
        equation="q = m - tau / stiffness",
        source="Hooke's law; Miyasaka et al. 2020, IEEE RA-L 5(2), cable-pulley network",
        parameters=(Parameter("stiffness", "stiffness of the cable pair at the joint", *STIFFNESS, identity=inf),),
        neighbours=("transmission_ratio", "gravity_sag"),
        separating_runs=(Run.LOAD_SWAP, Run.POSE_SPREAD, Run.SPEED_LADDER),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - motion.load[..., j] / self.stiffness


@dataclass(frozen=True)
class NonlinearStretch(JointEffect):
    """The joint lags behind the motor by the stretch d of a cable that stiffens as it is pulled."""

    stiffness: float
    cubic: float

    about = Description(
        name="nonlinear_stretch",
        number=8,
        family=Family.COMPLIANCE,
        equation="q = m - d, tau = stiffness d + cubic d^3",
        source="Spong 1987, J. Dyn. Syst. Meas. Control 109(4), elastic joints; Duffing's cubic spring",
        parameters=(
            Parameter("stiffness", "stiffness at small loads", *STIFFNESS, identity=inf),
            Parameter(
                "cubic",
                "hardening",
                *CUBIC,
                # as stiff as the linear part at a milliradian, 0.1 mm
                ladder=Ladder(Per.PRIOR, (0.001, 0.03, 1.0, 30.0)),
            ),
        ),
        neighbours=("cable_stretch", "backlash"),
        separating_runs=(Run.LOAD_SWAP, Run.SPEED_LADDER),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - self._stretch(motion.load[..., j])

    def _stretch(self, torque: FloatArray) -> FloatArray:
        """Stretch at torques of any shape: the real root of the cubic, by hyperbolic functions."""
        if np.isinf(self.stiffness) or self.cubic == 0:
            return torque / self.stiffness
        if self.stiffness == 0:
            return np.cbrt(torque / self.cubic)
        knee = np.sqrt(self.stiffness / (3.0 * self.cubic))
        root: FloatArray = 2.0 * knee * np.sinh(np.arcsinh(1.5 * torque / (self.stiffness * knee)) / 3.0)
        return root


@dataclass(frozen=True)
class LengthDependentStiffness(JointEffect):
    """The joint lags behind the motor by its torque over a stiffness that falls with the cable's length."""

    source: int  # the prismatic joint that pays the cable out; it may be the joint itself
    rigidity: float
    length: float  # negative where the source's zero, a convention of the arm's table, lies behind the drum

    about = Description(
        name="length_dependent_stiffness",
        number=9,
        family=Family.COMPLIANCE,
        equation="q = m - tau / k, k = rigidity / (length + q_source)",
        source="Hooke's law of a rod; Miyasaka et al. 2020, IEEE RA-L 5(2), cable-pulley network",
        parameters=(
            Parameter("rigidity", "stiffness times cable length", *RIGIDITY, identity=inf),
            Parameter(
                "length",
                "cable length at the source's zero",
                Range("m", -1.0, 5.0, 0.3),
                positive=False,
                ladder=Ladder(Per.VALUE, (0.0, 0.3)),
            ),
        ),
        neighbours=("cable_stretch", "payload"),
        separating_runs=(Run.TWO_INSERTIONS, Run.LOAD_SWAP),
        sites=(Site.INSERTION,),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.source, int) and self.source >= 1):
            raise DataError(f"effect {self.about.name}: source must be a joint's number, got {self.source!r}.")

    @property
    def joints(self) -> tuple[int, ...]:
        """The joint and the one that pays its cable out."""
        return (*super().joints, self.source)

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        k = self.column(motion.joints, self.source)
        length = np.maximum(self.length + motion.position[..., k], 0.0)
        return q[..., j] - motion.load[..., j] * length / self.rigidity


@dataclass(frozen=True)
class GravitySag(JointEffect):
    """Links and bearings bend: the effective joint value falls behind by the gravity torque over their stiffness."""

    stiffness: float

    stage = Stage.LINK
    about = Description(
        name="gravity_sag",
        number=10,
        family=Family.COMPLIANCE,
        equation="q_link = q - g(q) / stiffness",
        source="Roth, Mooring, Ravani 1987, IEEE J. Robotics and Automation 3(5): non-geometric errors",
        parameters=(Parameter("stiffness", "stiffness of the structure", *STRUCTURE, identity=inf),),
        needs=("external_jp|tracker_cp",),
        neighbours=("transmission_ratio", "registration_error", "cable_stretch"),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP, Run.SPEED_LADDER),
    )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - motion.gravity_load[..., j] / self.stiffness


@dataclass(frozen=True)
class Payload(LoadEffect):
    """A point mass at the tip or beside it, beyond the payload that is known; it weighs and it resists acceleration.

    Below zero where the model's tool weighs more than the machine's, by as much as the last link at most.
    """

    mass: float
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    place: str = "tip"

    about = Description(
        name="payload",
        number=11,
        family=Family.COMPLIANCE,
        equation="tau = tau_0 + J^T mass (a - g)",
        source="Featherstone 2008, Rigid Body Dynamics Algorithms, Ch. 5",
        parameters=(
            Parameter("mass", "mass at the tip beyond the known", Range("kg", -3.0, 3.0, 0.1), positive=False),
            *axes("from the tip, along its frame's", Range("m", -0.5, 0.5, 0.05), ("place", "beside"), "mass"),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("gravity_sag", "length_dependent_stiffness", "believed_payload"),
        separating_runs=(Run.LOAD_SWAP, Run.TWO_INSERTIONS, Run.POSE_SPREAD),
        sites=(Site.ALL,),
        choices=(("place", ("tip", "beside")),),
    )

    def act(self, body: Body) -> Body:
        """Put more at the tip, or hang it on the last link."""
        links = body.links
        if self.place == "tip":
            most = float(links.mass[-1]) if len(links.mass) else 0.0
            return replace(body, links=replace(links, payload=np.maximum(links.payload + self.mass, -most)))
        if body.chain is None:
            raise DataError("effect payload: a mass beside the tip needs an arm, the model has bare joints.")
        tip = body.chain.tool
        at = tip[:3, :3] @ np.array([self.x, self.y, self.z]) + tip[:3, 3]
        return replace(body, links=links.with_point(body.chain.dof, self.mass, at))


@dataclass(frozen=True)
class LinkMassError(LoadEffect):
    """A link weighs more than the model says, or less, at its centre of mass; the controller does not know."""

    mass: float

    about = Description(
        name="link_mass_error",
        number=38,  # behind the centre of mass: a link that then weighs nothing has none
        family=Family.COMPLIANCE,
        equation="tau = tau_0 + J_c^T mass (a_c - g), c the link's nominal centre of mass",
        source="Featherstone 2008, Rigid Body Dynamics Algorithms, Ch. 5",
        parameters=(
            Parameter("mass", "mass of the link beyond the model's", Range("kg", -10.0, 10.0, 0.2), positive=False),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("payload", "feedforward_error", "gravity_sag"),
        separating_runs=(Run.POSE_SPREAD, Run.SPEED_LADDER),
        sites=(Site.JOINT,),
    )

    def act(self, body: Body) -> Body:
        """Put more in one link."""
        i, mass = self.link_of(body), np.array(body.links.mass)
        mass[i] = max(0.0, mass[i] + self.mass)
        return replace(body, links=replace(body.links, mass=mass))


@dataclass(frozen=True)
class CentreOfMassError(LoadEffect):
    """A link has its centre of mass elsewhere than the model says; the controller does not know."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    about = Description(
        name="centre_of_mass_error",
        number=35,
        family=Family.COMPLIANCE,
        equation="c = c_nominal + (x, y, z), in the link's frame",
        source="Atkeson, An, Hollerbach 1986, Int. J. Robotics Research 5(3): mass moments of links from motion",
        parameters=axes("along the link frame's", Range("m", -0.5, 0.5, 0.02)),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("link_mass_error", "joint_spring", "gravity_error"),
        separating_runs=(Run.POSE_SPREAD, Run.SPEED_LADDER),
    )

    def act(self, body: Body) -> Body:
        """Move one link's centre of mass."""
        i, com = self.link_of(body), np.array(body.links.com)
        com[i] += self.x, self.y, self.z
        return replace(body, links=replace(body.links, com=com))


@dataclass(frozen=True)
class GravityError(LoadEffect):
    """Gravity in the base's frame is not what the model says, as where the arm does not stand upright."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    about = Description(
        name="gravity_error",
        number=39,
        family=Family.COMPLIANCE,
        equation="g = g_nominal + (x, y, z), in the base frame",
        source="Siciliano et al. 2009, Robotics, Sec. 7.2: gravity in the base frame",
        parameters=axes("along the base's", Range("m/s^2", -20.0, 20.0, 0.3)),  # from an arm that hangs to one upright
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("centre_of_mass_error", "joint_spring", "payload"),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP),
        sites=(Site.BASE,),
    )

    def act(self, body: Body) -> Body:
        """Change gravity."""
        return replace(body, gravity=body.gravity + np.array([self.x, self.y, self.z]))


@dataclass(frozen=True)
class JointSpring(TorqueEffect):
    """A spring at the joint beyond the model's, such as a hose, a counterbalance or a cable's own stiffness.

    It acts behind the transmission, which carries its torque.
    """

    stiffness: float
    push: float = 0.0

    about = Description(
        name="joint_spring",
        number=36,
        family=Family.COMPLIANCE,
        equation="tau_spring = stiffness q + push",
        source="static balancing with springs; Herder 2001, Energy-free Systems, Ch. 2",
        parameters=(
            Parameter("stiffness", "stiffness of the spring", *SPRING, positive=False),
            Parameter("push", "with which it pushes back at zero", *PUSH, positive=False),
        ),
        needs=("setpoint_jp|measured_jf", "measured_jp|external_jp|tracker_cp"),
        neighbours=("link_mass_error", "payload", "feedforward_error"),
        separating_runs=(Run.POSE_SPREAD, Run.ONE_JOINT),
    )

    def law(self) -> TorqueLaw:
        """Return the spring, which pushes to either side."""
        return TorqueLaw(stiffness=self.stiffness, upper=0.0, lower=0.0, push=self.push)


@dataclass(frozen=True)
class ShaftBending(TipEffect):
    """A cantilever from the remote centre of motion to the tip, loaded at its end."""

    rigidity: float

    stage = Stage.TIP
    about = Description(
        name="shaft_bending",
        number=12,
        family=Family.COMPLIANCE,
        equation="d = F L^3 / (3 rigidity) across the shaft, turned by F L^2 / (2 rigidity)",
        source="Euler-Bernoulli cantilever; Roark's Formulas for Stress and Strain, Table 8.1",
        parameters=(
            Parameter("rigidity", "bending stiffness EI of the shaft", Range("N m^2", 0.05, 1e4, 10.0), identity=inf),
        ),
        needs=("tracker_cp", "payload"),
        remote_centre=True,
        neighbours=("cable_stretch", "rcm_shift"),
        separating_runs=(Run.LOAD_SWAP, Run.TWO_INSERTIONS),
        sites=(Site.TOOL,),
    )

    def act(self, T_base_tip: FloatArray, motion: Motion) -> FloatArray:
        """Move and turn the tip across the shaft, towards the force."""
        if np.isinf(self.rigidity):
            return T_base_tip
        tip = T_base_tip[..., :3, 3]
        force, length = lateral_force(tip, motion.tip_force)
        axis = np.cross(tip / np.maximum(length, 1e-12), force)
        R = se3.matrix_from_rotvec(axis * length**2 / (2.0 * self.rigidity))
        return se3.pose(R @ T_base_tip[..., :3, :3], tip + force * length**3 / (3.0 * self.rigidity))


@dataclass(frozen=True)
class RcmShift(TipEffect):
    """The whole instrument moves across its shaft by the lateral force over a stiffness."""

    stiffness: float

    stage = Stage.BASE
    about = Description(
        name="rcm_shift",
        number=13,
        family=Family.COMPLIANCE,
        equation="d = F_lateral / stiffness, the same along the whole shaft",
        source="Hooke's law at the remote centre of motion",
        parameters=(
            Parameter(
                "stiffness", "lateral stiffness at the remote centre", Range("N/m", 20.0, 1e7, 3e3), identity=inf
            ),
        ),
        needs=("tracker_cp", "payload"),
        remote_centre=True,
        neighbours=("shaft_bending", "registration_error"),
        separating_runs=(Run.LOAD_SWAP, Run.TWO_INSERTIONS),
        sites=(Site.BASE,),
    )

    def act(self, T_base_tip: FloatArray, motion: Motion) -> FloatArray:
        """Move the tip across the shaft, towards the force."""
        if np.isinf(self.stiffness):
            return T_base_tip
        force, _ = lateral_force(T_base_tip[..., :3, 3], motion.tip_force)
        return se3.pose(T_base_tip[..., :3, :3], T_base_tip[..., :3, 3] + force / self.stiffness)


def lateral_force(tip: FloatArray, tip_force: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Part of the force at the tip that acts across the shaft, and the shaft's free length.

    The shaft runs from the remote centre of motion, which is the base origin of every arm here, to the tip.

    Parameters
    ----------
    tip : (n, N, 3) array, tip positions, base frame, m
    tip_force : (N, 3) array or None, force on the tip in each run, base frame, N; None is none

    Returns
    -------
    force : (n, N, 3) array, N, base frame
    length : (n, N, 1) array, m
    """
    length = np.linalg.norm(tip, axis=-1, keepdims=True)
    if tip_force is None:
        return np.zeros(tip.shape), length
    along = tip / np.maximum(length, 1e-12)
    force: FloatArray = tip_force - (along * tip_force).sum(axis=-1, keepdims=True) * along
    return force, length
