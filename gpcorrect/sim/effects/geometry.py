"""Effects of geometry: joints, links and frames that are not where, nor as large as, the software has them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gpcorrect import se3
from gpcorrect.arms import Chain, Joint
from gpcorrect.arms.chain import Convention
from gpcorrect.arms.robot_path import PARALLEL
from gpcorrect.errors import DataError
from gpcorrect.sim.effects.base import ChainEffect, JointEffect, Stage, TipEffect, with_column
from gpcorrect.sim.effects.description import PHASE, Description, Family, Ladder, Parameter, Per, Range, Run, Site
from gpcorrect.sim.effects.operators import Memory, play, upright
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

# Units, physical ranges and typical sizes on revolute and prismatic joints.
# A zero may be anywhere: two conventions differ by a quarter turn, or by the length of a slide.
OFFSET = Range("rad", -3.2, 3.2, 0.05), Range("m", -0.5, 0.5, 0.005)
PLACE = Range("rad", -6.5, 6.5, 1.0), Range("m", -1.0, 1.0, 0.2)
COUPLING = Range("rad per unit of source", -1.0, 1.0, 0.05), Range("m per unit of source", -0.05, 0.05, 0.002)
DRAG = Range("rad per unit of source", -5.0, 5.0, 0.2), Range("m per unit of source", -0.25, 0.25, 0.01)
WAVE = Range("rad", -0.1, 0.1, 0.003), Range("m", -0.01, 0.01, 2e-4)
WAVES = Range("1", 1.0, 60.0, 10.0), Range("rad/m", 1.0, 500.0, 150.0)


@dataclass(frozen=True)
class HomingOffset(JointEffect):
    """The encoder's zero is not the joint's: the robot reports the true position plus an offset, set anew by homing."""

    offset: float | tuple[float, ...]

    stage = Stage.ENCODER
    about = Description(
        name="homing_offset",
        number=1,
        family=Family.GEOMETRY,
        equation="reported = q + offset, a new one each session",
        source="Hwang et al. 2020, IEEE RA-L 5(4), offset model",
        parameters=(Parameter("offset", "reported minus true position", *OFFSET, positive=False, per_session=True),),
        neighbours=("registration_error", "gravity_sag"),
        separating_runs=(Run.POSE_SPREAD, Run.REHOMING),
    )

    def __post_init__(self) -> None:
        if isinstance(self.offset, list):
            object.__setattr__(self, "offset", tuple(self.offset))
        super().__post_init__()

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        offsets = np.atleast_1d(np.asarray(self.offset, dtype=np.float64))
        if len(offsets) > 1 and motion.session.max(initial=0) >= len(offsets):
            raise DataError(
                f"homing_offset of joint {self.joint} has {len(offsets)} offsets, the data have "
                f"{motion.session.max() + 1} sessions.",
                hint="Give one offset for all sessions, or one for each.",
            )
        return q[..., j] - (offsets[motion.session] if len(offsets) > 1 else offsets[0])


OF = ("reading", "gear")


@dataclass(frozen=True)
class TransmissionRatio(JointEffect):
    """The motion since homing is reported `1 + error` times as large as it is.

    Of the reading alone, as where an encoder's counts are wrong; or of the gear, which then also makes `1 + error`
    times as much of the motor's torque, for what goes in as work comes out as work.
    """

    error: float
    home: float = 0.0
    of: str = "reading"

    about = Description(
        name="transmission_ratio",
        number=2,
        family=Family.GEOMETRY,
        equation="reported = q + error (q - home)",
        source="RAVEN-II control software, motor-to-joint map q = C^-1 m / N",
        parameters=(
            # A wrong pulley or gear is seldom off by more than a factor of two, which lies inside.
            Parameter("error", "relative error of the ratio", Range("1", -0.6, 1.5, 0.02), positive=False),
            Parameter(
                "home",
                "where the joint was homed",
                *PLACE,
                positive=False,
                ladder=Ladder(Per.PLACE, (0.5,), absent=True),
            ),
        ),
        neighbours=("gravity_sag",),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP),
        choices=(("of", OF),),
        loaded=("of", "gear"),
    )

    def on_motors(self, load: FloatArray, joints: tuple[int, ...]) -> FloatArray:
        """Return the joint's load, of which a gear hands its part to the motor."""
        if self.of != "gear":
            return load
        j = self.column(joints)
        return with_column(load, j, load[..., j] / (1.0 + self.error))

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return (q[..., j] + self.error * self.home) / (1.0 + self.error)


@dataclass(frozen=True)
class CableCoupling(JointEffect):
    """An off-diagonal term of the coupling matrix is wrong or missing; it may drag behind the source.

    A cable that is wound by friction first sticks to the source's motion and lets go of it at a reversal: this part is
    the source less its play, which follows the last bit of motion after a reversal and no more.

    Of the reading alone, or of the gear: then the source's motor carries `coefficient` times this joint's load less.
    """

    source: int  # number of the joint whose motion causes it
    coefficient: float
    drag: float = 0.0
    drag_radius: float = 0.0
    home: float = 0.0
    of: str = "reading"

    about = Description(
        name="cable_coupling",
        number=3,
        family=Family.GEOMETRY,
        equation="reported_j = q_j + coefficient (q_source - home) + drag (q_source - play(q_source, drag_radius))",
        source="RAVEN-II control software, motor-to-joint map q = C^-1 m / N; play as in backlash",
        parameters=(
            Parameter(
                "coefficient",
                "reported minus true position of this joint for each unit of the source",
                *COUPLING,
                positive=False,
            ),
            Parameter(
                "drag",
                "reported minus true position of this joint for each unit of the source's motion since its reversal",
                *DRAG,
                positive=False,
                shaped_by="drag_radius",
            ),
            Parameter(
                "drag_radius",
                "half the source's motion over which the drag turns round",
                Range("rad or m of source", 0.0, 1.0, 0.05),
                ladder=Ladder(Per.RANGE, (0.02, 0.06, 0.15), absent=True),
            ),
            Parameter(
                "home",
                "where the source stood when the joint was homed",
                Range("rad or m of source", -6.5, 6.5, 1.0),
                positive=False,
                ladder=Ladder(Per.PLACE, (0.5,), absent=True),
            ),
        ),
        neighbours=("gravity_sag", "backlash"),
        separating_runs=(Run.ONE_JOINT, Run.AMPLITUDES),
        sites=(Site.PAIR,),
        choices=(("of", OF),),
        loaded=("of", "gear"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (isinstance(self.source, int) and self.source >= 1) or self.source == self.joint:
            raise DataError(
                f"effect cable_coupling: source must be the number of a joint other than {self.joint}, "
                f"got {self.source!r}."
            )

    @property
    def joints(self) -> tuple[int, ...]:
        """Both joints."""
        return (*super().joints, self.source)

    def forgets_after(self) -> dict[int, float]:
        """Return the way over which the drag turns round."""
        return {self.source: 2.0 * self.drag_radius} if self.drag else {}

    def on_motors(self, load: FloatArray, joints: tuple[int, ...]) -> FloatArray:
        """Return the loads, with what the joint's cable asks of the source's motor."""
        if self.of != "gear":
            return load
        j, k = self.column(joints), self.column(joints, self.source)
        return with_column(load, k, load[..., k] - self.coefficient * load[..., j])

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        k = self.column(motion.joints, self.source)
        wound = self.coefficient * (q[..., k] - self.home)
        if self.drag:
            wound = wound + self.drag * (q[..., k] - play(q[..., k], self.drag_radius, memory))
        return q[..., j] - wound


@dataclass(frozen=True)
class PulleyEccentricity(JointEffect):
    """A pulley does not run true: the reported position swings around the true one as it turns."""

    amplitude: float
    waves: float
    phase: float

    about = Description(
        name="pulley_eccentricity",
        number=4,
        family=Family.GEOMETRY,
        equation="reported = q + amplitude sin(waves reported + phase)",
        source="first harmonic of a pulley whose axis is off its centre; the phase is counted on the motor's side",
        parameters=(
            Parameter("amplitude", "size of the wave, reported minus true position", *WAVE, positive=False),
            Parameter(
                "waves",
                "phase of the pulley for each unit of the joint",
                *WAVES,
                # Half a wave apart: none is missed. Three quarters of a wave at least, or any bend would be one.
                ladder=Ladder(Per.SWEEP, tuple(np.pi * k for k in range(2, 15)), within=(1.5 * np.pi, 1e9)),
            ),
            PHASE,
        ),
        neighbours=("position_dependent_friction", "transmission_ratio"),
        separating_runs=(Run.AMPLITUDES, Run.ONE_JOINT),
    )

    def canonical(self) -> PulleyEccentricity:
        """Return the same wave with a positive amplitude and a phase within half a turn."""
        amplitude, phase = upright(self.amplitude, self.phase)
        return replace(self, amplitude=amplitude, phase=phase)

    def overtones(self) -> tuple[PulleyEccentricity, ...]:
        """Return waves of two, three and four times its frequency.

        A wheel off its centre has none; encoders that interpolate badly, and gears, do.
        """
        return tuple(
            replace(self, waves=k * self.waves, phase=k * self.phase + shift)
            for k in (2, 3, 4)
            for shift in (0.0, np.pi / 2)
        )

    def _behind(self, q: FloatArray, j: int, motion: Motion, memory: Memory) -> FloatArray:
        return q[..., j] - self.amplitude * np.sin(self.waves * q[..., j] + self.phase)


_SHIFT, _TURN, _SCALE = Range("m", -0.1, 0.1, 5e-3), Range("rad", -0.35, 0.35, 0.02), Range("1", -0.1, 0.1, 5e-3)
_shift = partial(Parameter, revolute=_SHIFT, positive=False)
_turn = partial(Parameter, revolute=_TURN, positive=False)


@dataclass(frozen=True)
class RegistrationError(TipEffect):
    """Poses are seen through a similarity y = s R q + t, about the base origin and in base axes.

    Where the tracker is registered from the same data, that registration takes all of it but the scale.
    """

    x: float
    y: float
    z: float
    rx: float
    ry: float
    rz: float
    scale: float

    stage = Stage.BASE
    about = Description(
        name="registration_error",
        number=5,
        family=Family.GEOMETRY,
        equation="y = (1 + scale) R p + t, t = (x, y, z), R of the rotation vector (rx, ry, rz)",
        source="Umeyama 1991, IEEE Trans. PAMI 13(4): similarity between two sets of points",
        parameters=(
            _shift("x", "shift along the base's x axis"),
            _shift("y", "shift along the base's y axis"),
            _shift("z", "shift along the base's z axis"),
            _turn("rx", "rotation vector, x"),
            _turn("ry", "rotation vector, y"),
            _turn("rz", "rotation vector, z"),
            Parameter("scale", "relative error of lengths", _SCALE, positive=False),
        ),
        needs=("tracker_cp",),
        neighbours=("dh_error", "homing_offset"),
        separating_runs=(Run.POSE_SPREAD,),
        sites=(Site.BASE,),
    )

    def act(self, T_base_tip: FloatArray, motion: Motion) -> FloatArray:
        """Move the poses by the similarity."""
        R = se3.matrix_from_rotvec(np.array([self.rx, self.ry, self.rz]))
        position = (1.0 + self.scale) * T_base_tip[..., :3, 3] @ R.T + np.array([self.x, self.y, self.z])
        return se3.pose(R @ T_base_tip[..., :3, :3], position)


_LENGTH, _ANGLE = Range("m", -0.05, 0.05, 1e-3), Range("rad", -0.2, 0.2, 5e-3)
_length = partial(Parameter, revolute=_LENGTH, positive=False)
_angle = partial(Parameter, revolute=_ANGLE, positive=False)


FORMS = ("table", "parallel", "tool")


@dataclass(frozen=True)
class DhError(ChainEffect):
    """Small errors of one row of the Denavit-Hartenberg table, or of the tool: a further row behind the last link.

    A table has no small number for the turn by which two axes that ought to be parallel are not, about what is across
    them and their common normal: the form "parallel" has it. Four numbers say where an axis is, while a tip may be off
    along all three axes of the last link: the form "tool" has these, and no turn.
    """

    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    beta: float = 0.0
    b: float = 0.0
    form: str = "table"

    about = Description(
        name="dh_error",
        number=6,
        family=Family.GEOMETRY,
        equation="true row = Ty(b) Ry(beta) (nominal row + (a, alpha, d, theta))",
        source="Mooring, Roth, Driels 1991, Fundamentals of Manipulator Calibration, Ch. 2; beta: Hayati 1983",
        parameters=(
            _length("a", "true minus nominal link length"),
            _angle("alpha", "true minus nominal twist", only=("form", "table", "parallel")),
            _length("d", "true minus nominal offset along the joint's axis"),
            _angle("theta", "true minus nominal angle about the axis", only=("form", "table", "parallel")),
            _angle("beta", "turn about the y axis of the link before", only=("form", "parallel")),
            _length("b", "shift along the y axis of the link before", only=("form", "tool")),
        ),
        needs=("tracker_cp",),
        neighbours=("registration_error", "homing_offset", "gravity_sag"),
        separating_runs=(Run.POSE_SPREAD, Run.LOAD_SWAP),
        sites=(Site.JOINT, Site.TOOL),
        choices=(("form", FORMS),),
    )

    def check(self, chain: Chain) -> None:
        """See :class:`ChainEffect`: the joint is one of the arm's, and what is called parallel is."""
        if isinstance(self.joint, int) and self.joint > chain.dof:
            raise DataError(f"effect dh_error acts on joint {self.joint}, the arm has {chain.dof}.")
        if (self.form == "tool" and isinstance(self.joint, int)) or (self.b and self.form != "tool"):
            raise DataError(
                'effect dh_error: the form "tool" is of the tool alone, and `b` of that form.',
                hint="Leave `form` and `b` out: four numbers say all of an axis.",
            )
        if self.form == "parallel" and not self._is_parallel(chain):
            raise DataError(
                f'effect dh_error: the form "parallel" is of a joint whose axis is parallel to that before, in a table '
                f"of the modified convention, as robot files are; not of {self.joint!r} here.",
                hint='Leave `form` and `beta` out: in the form "table" four numbers say all.',
            )

    def act(self, chain: Chain) -> Chain:
        """Return the chain with the altered row or tool."""
        if not isinstance(self.joint, int):
            return replace(chain, tool=self.motion(chain.convention) @ chain.tool)
        rows = list(chain.joints)
        row = rows[self.joint - 1]
        changed = replace(
            row, a=row.a + self.a, alpha=row.alpha + self.alpha, d=row.d + self.d, theta=row.theta + self.theta
        )
        if self.beta:
            before = np.eye(4) if row.placement is None else row.placement
            changed = replace(changed, placement=before @ self._askew())
        rows[self.joint - 1] = changed
        return replace(chain, joints=tuple(rows))

    def motion(self, convention: Convention) -> FloatArray:
        """Return the errors as a motion `(4, 4)`, of a row that is else nothing.

        Parameters
        ----------
        convention : "standard" or "modified"
        """
        row = Joint("R", self.alpha, self.a, self.d, self.theta, -1.0, 1.0)
        return self._askew() @ Chain((row,), convention).forward([0.0])

    def _askew(self) -> FloatArray:
        return se3.pose(se3.matrix_from_rotvec(np.array([0.0, self.beta, 0.0])), np.array([0.0, self.b, 0.0]))

    def _is_parallel(self, chain: Chain) -> bool:
        if chain.convention != "modified" or not isinstance(self.joint, int) or self.joint < 2:
            return False
        one, other = chain.axes(np.zeros(chain.dof))[0][self.joint - 2 : self.joint]
        return bool(np.linalg.norm(np.cross(one, other)) < PARALLEL)
