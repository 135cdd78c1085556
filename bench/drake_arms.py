"""Arms for `discrepancy_drake.py`, written here as URDF: six axes with geared rotors, and one that inserts a tool."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from gpcorrect.types import FloatArray

Vector = tuple[float, float, float]
FLANGE, FLEX_MASS = (0.0, 0.0, 0.07), 0.01


@dataclass(frozen=True)
class Link:
    """A link and the joint that carries it, with the rotor that drives the joint through its gear."""

    kind: str  # "revolute" or "prismatic"
    axis: Vector
    xyz: Vector
    rpy: Vector
    mass: float
    com: Vector
    box: Vector  # m, of the box whose inertia it has, turned by `turned` (rpy): its tensor is full
    turned: Vector
    rotor: float  # kg m^2 before the gear
    gear: float  # turns of the rotor a turn of the joint, or rad a metre
    damping: float = 0.0
    heavier: float = 0.0  # kg in its centre of mass

    @property
    def reflected(self) -> float:
        """Inertia of the rotor as the joint feels it."""
        return self.rotor * self.gear**2


@dataclass(frozen=True)
class Arm:
    """A serial arm, its servo loop, and where it moves."""

    name: str
    links: tuple[Link, ...]
    home: FloatArray
    reach: FloatArray  # of the desired waves, joint by joint
    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    rate_hz: int = 1000
    feedforward: str = "gravity-measured"
    flexible: int = 0  # joint behind whose motor a spring is, or a gap; 0: none
    payload: float = 0.0  # kg in the flange
    flange: Vector = FLANGE
    gravity: Vector = (0.0, 0.0, -9.81)
    spring: float = 0.0  # N m/rad of the flexible joint
    spring_damping: float = 2.0

    def but(self, joint: int, **numbers: object) -> Self:
        """Return the arm with other numbers of one link."""
        links = list(self.links)
        links[joint - 1] = replace(links[joint - 1], **numbers)  # type: ignore[arg-type]
        return replace(self, links=tuple(links))

    def urdf(self) -> str:
        """Return the arm as a URDF, with Drake's words for rotors, which other readers pass over."""
        parts = ['<robot name="arm" xmlns:drake="http://drake.mit.edu">', '<link name="base"/>']
        before = "base"
        for i, link in enumerate(self.links, 1):
            parts += [_driven(i, link, before, flexible=i == self.flexible)]
            before = f"link{i}"
        weight = _inertial(self.payload, (0.0, 0.0, 0.0), np.full(3, 1e-9)) if self.payload else ""
        parts += [
            f'<link name="flange">{weight}</link>',
            f'<joint name="mount" type="fixed"><parent link="{before}"/><child link="flange"/>'
            f'<origin xyz="{_text(self.flange)}"/></joint>',
            "</robot>",
        ]
        return "\n".join(parts)


def _driven(i: int, link: Link, before: str, *, flexible: bool) -> str:
    """Return a link and its joint; a flexible one has its motor on a small body before the link."""
    inertial = _inertial(link.mass + link.heavier, link.com, _box(link), Rotation.from_euler("xyz", link.turned))
    text = f'<link name="link{i}">{inertial}</link>'
    child, behind = f"link{i}", ""
    if flexible:
        child = f"motor{i}"
        behind = f'<link name="{child}">{_inertial(FLEX_MASS, (0, 0, 0), np.full(3, 1e-6))}</link>' + _joint(
            f"flex{i}", link.kind, link.axis, child, f"link{i}"
        )
    joint = _joint(f"joint{i}", link.kind, link.axis, before, child, link.xyz, link.rpy, link.damping)
    drive = (
        f'<transmission type="SimpleTransmission"><joint name="joint{i}"/><actuator name="drive{i}">'
        f'<drake:rotor_inertia value="{link.rotor!r}"/><drake:gear_ratio value="{link.gear!r}"/></actuator>'
        "</transmission>"
    )
    return "\n".join([text, joint, behind, drive])


def _joint(
    name: str,
    kind: str,
    axis: Vector,
    parent: str,
    child: str,
    xyz: Vector = (0, 0, 0),
    rpy: Vector = (0, 0, 0),
    damping: float = 0.0,
) -> str:
    ends = "3.1" if kind == "revolute" else "0.5"
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{_text(xyz)}" rpy="{_text(rpy)}"/><axis xyz="{_text(axis)}"/>'
        f'<limit lower="-{ends}" upper="{ends}" effort="1e5" velocity="100"/>'
        f'<dynamics damping="{damping!r}"/></joint>'
    )


def _box(link: Link) -> FloatArray:
    squares = np.square(link.box)
    inertia: FloatArray = link.mass / 12.0 * (squares.sum() - squares)
    return inertia


def _inertial(mass: float, com: Vector, inertia: FloatArray, turned: Rotation | None = None) -> str:
    matrix = np.diag(inertia)
    if turned is not None:
        matrix = turned.as_matrix() @ matrix @ turned.as_matrix().T
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    numbers = " ".join(f'{name}="{float(matrix[at])!r}"' for name, at in names.items())
    return f'<inertial><origin xyz="{_text(com)}"/><mass value="{mass!r}"/><inertia {numbers}/></inertial>'


def _text(vector: Vector) -> str:
    return " ".join(repr(float(value)) for value in vector)


SIX = Arm(
    name="six",
    links=(
        Link(
            "revolute",
            (0, 0, 1),
            (0, 0, 0.16),
            (0, 0, 0),
            3.9,
            (0.01, 0.03, -0.02),
            (0.14, 0.12, 0.2),
            (0.3, 0.2, 0),
            9e-5,
            101.0,
        ),
        Link(
            "revolute",
            (0, 1, 0),
            (0, 0.135, 0),
            (0, 0, 0),
            8.6,
            (0.02, 0.01, 0.24),
            (0.12, 0.14, 0.5),
            (0.1, 0.06, 0.4),
            9e-5,
            101.0,
        ),
        Link(
            "revolute",
            (0, 1, 0),
            (0, -0.12, 0.425),
            (0, 0.1, 0),
            2.5,
            (-0.02, 0.03, 0.21),
            (0.08, 0.1, 0.4),
            (0.05, -0.1, 0.3),
            6e-5,
            101.0,
        ),
        Link(
            "revolute",
            (0, 1, 0),
            (0, 0.01, 0.392),
            (0.05, 0, 0),
            1.3,
            (0.01, 0.05, 0.02),
            (0.1, 0.12, 0.1),
            (0.4, 0.1, 0.2),
            3e-5,
            101.0,
        ),
        Link(
            "revolute",
            (0, 0, 1),
            (0, 0.1, 0),
            (0, 0, 0.1),
            1.2,
            (0.03, 0.0, 0.06),
            (0.1, 0.08, 0.12),
            (0.2, 0.5, 0),
            3e-5,
            101.0,
        ),
        Link(
            "revolute",
            (0, 1, 0),
            (0, 0, 0.095),
            (0, 0, 0),
            0.6,
            (0.04, 0.02, 0.05),
            (0.12, 0.05, 0.06),
            (0, 0.3, 0.4),
            3e-5,
            101.0,
        ),
    ),
    home=np.array([0.2, 0.5, 1.1, -0.4, 0.7, 0.3]),
    reach=np.array([1.2, 0.7, 0.9, 1.1, 1.2, 1.6]),
    kp=np.array([4500.0, 5000.0, 2500.0, 600.0, 450.0, 350.0]),
    kd=np.array([260.0, 300.0, 120.0, 26.0, 19.0, 14.0]),
    ki=np.zeros(6),
)

INSERTION = Arm(
    name="insertion",
    links=(
        Link(
            "revolute",
            (0, 0, 1),
            (0.1, 0, 0.8),
            (0.5, 1.1, 0),
            1.8,
            (0.05, 0.02, -0.08),
            (0.2, 0.1, 0.3),
            (0.3, 0.2, 0),
            4e-5,
            60.0,
        ),
        Link(
            "revolute",
            (1, 0, 0),
            (0, 0, 0),
            (0.2, 0.9, 0.1),
            1.4,
            (0.03, -0.12, -0.16),
            (0.1, 0.3, 0.25),
            (0.1, 0.4, 0.4),
            4e-5,
            60.0,
        ),
        Link(
            "prismatic",
            (0, 0, 1),
            (0.02, 0, -0.2),
            (0, 0, 0.3),
            0.9,
            (0.02, 0.03, 0.05),
            (0.05, 0.07, 0.2),
            (0.1, 0.2, 0.3),
            2e-5,
            400.0,
        ),
        Link(
            "revolute",
            (0, 0, 1),
            (0, 0, 0.3),
            (0, 0, 0),
            0.3,
            (0.012, 0.006, -0.03),
            (0.05, 0.04, 0.06),
            (0.4, 0.1, 0),
            1e-5,
            40.0,
        ),
        Link(
            "revolute",
            (0, 1, 0),
            (0, 0, 0.05),
            (0.1, 0, 0),
            0.2,
            (0.01, 0.0, 0.03),
            (0.03, 0.03, 0.07),
            (0.2, 0.1, 0),
            1e-5,
            40.0,
        ),
    ),
    home=np.array([0.3, -0.2, 0.12, 0.5, 0.4]),
    reach=np.array([0.9, 0.8, 0.16, 1.6, 1.3]),
    kp=np.array([500.0, 450.0, 14000.0, 45.0, 40.0]),
    kd=np.array([28.0, 24.0, 520.0, 1.4, 1.2]),
    ki=np.zeros(5),
)
