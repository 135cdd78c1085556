"""The arm's body, some joints moving and the others held, and the drives that move it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from gpcorrect.arms import Chain
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray


@dataclass(frozen=True, eq=False)
class Links:
    """Masses of the links, each in its own link frame, and of what hangs at the tip.

    Parameters
    ----------
    mass : (k,) array, kg, of links 1 to k; further links weigh nothing
    com : (k, 3) array, centres of mass, m
    inertia_diagonal : (k, 3) array, moments about the centre of mass, along the link frame's axes, kg m^2
    payload : (N,) array, point mass at the tip in each run, kg; below 0 where the last link has too much
    inertia_products : (k, 3) array or None
        Entries xy, xz and yz of the same inertia matrix; None where the link frame's axes are principal.
    """

    mass: FloatArray
    com: FloatArray
    inertia_diagonal: FloatArray
    payload: FloatArray
    inertia_products: FloatArray | None = None

    def __post_init__(self) -> None:
        k = len(self.mass)
        if self.com.shape != (k, 3) or self.inertia_diagonal.shape != (k, 3):
            raise DataError(
                f"{k} link masses need centres and inertias of shape ({k}, 3), got {self.com.shape} and "
                f"{self.inertia_diagonal.shape}."
            )
        if (self.mass < 0).any() or (self.inertia_diagonal < 0).any() or (self.payload < -self.mass.sum()).any():
            raise DataError("masses and moments of inertia must be >= 0, a payload no less than what it hangs at.")

    def with_point(self, link: int, mass: float, place: FloatArray) -> Links:
        """Return the same with a point mass on a link.

        Parameters
        ----------
        link : int, number of the link, from 1
        mass : float, kg; below 0 it is taken away, as far as there is any
        place : (3,) array, m, in the link's frame
        """
        i, more = link - 1, max(link - len(self.mass), 0)
        masses, com = np.pad(self.mass, (0, more)), np.pad(self.com, ((0, more), (0, 0)))
        diagonal = np.pad(self.inertia_diagonal, ((0, more), (0, 0)))
        products = np.zeros_like(diagonal)
        if self.inertia_products is not None:
            products = np.pad(self.inertia_products, ((0, more), (0, 0)))
        mass = max(mass, -float(masses[i]))
        together = masses[i] + mass
        # Two points about the centre of mass of both weigh as one of the reduced mass, the distance between them away.
        x, y, z = apart = place - com[i]
        reduced = masses[i] * mass / together if together > 0.0 else 0.0
        diagonal[i] = np.maximum(diagonal[i] + reduced * (apart @ apart - apart**2), 0.0)
        products[i] -= reduced * np.array([x * y, x * z, y * z])
        com[i] += mass / together * apart if together > 0.0 else 0.0
        masses[i] = together
        return Links(masses, com, diagonal, self.payload, products)

    @classmethod
    def none(cls) -> Links:
        """Return the masses of an arm that weighs nothing."""
        return cls(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(1))


@dataclass(frozen=True, eq=False)
class Body:
    """An arm of which the joints `joints` move and the others are held.

    Parameters
    ----------
    joints : tuple of int, numbers of the moving joints, from 1
    types : str, "R" or "P" for each moving joint
    chain : Chain or None, the whole arm's kinematics; None for bare joints, which weigh nothing
    held : (dof - k,) array, values of the other joints in the order of their numbers, rad or m
    links : Links
    gravity : (3,) array, m/s^2, base frame
    springs : (2, k) array or None
        Stiffness of a spring at each moving joint, N m/rad or N/m, and the joint value at which it is at rest.
    """

    joints: tuple[int, ...]
    types: str
    chain: Chain | None
    held: FloatArray
    links: Links
    gravity: FloatArray
    springs: FloatArray | None = None

    @property
    def columns(self) -> list[int]:
        """Columns of the moving joints among all joints of the chain."""
        return [number - 1 for number in self.joints]

    def all_joints(self, q: FloatArray) -> FloatArray:
        """Return the values of every joint `(..., dof)`.

        Parameters
        ----------
        q : (..., k) array, values of the moving joints, rad or m
        """
        assert self.chain is not None
        values = np.empty((*q.shape[:-1], self.chain.dof))
        values[..., self.columns] = q
        values[..., [i for i in range(self.chain.dof) if i not in self.columns]] = self.held
        return values

    def forward(self, q: FloatArray) -> FloatArray | None:
        """Return the tip poses `(..., 4, 4)` in the base frame; None for bare joints.

        Parameters
        ----------
        q : (..., k) array, values of the moving joints, rad or m
        """
        return None if self.chain is None else self.chain.forward(self.all_joints(q))

    @property
    def tip_force(self) -> FloatArray:
        """Weight `(N, 3)` of what hangs at the tip in each run, base frame, N."""
        return self.links.payload[:, None] * self.gravity

    def compact(self) -> Body:
        """Return the same body with a held, massless tail of joints made part of the tool: fewer frames to compute."""
        k = len(self.joints)
        if self.chain is None or self.joints != tuple(range(1, k + 1)) or len(self.links.mass) > k:
            return self
        tail = Chain(self.chain.joints[k:], self.chain.convention, tool=self.chain.tool) if self.held.size else None
        tool = self.chain.tool if tail is None else tail.forward(self.held)
        chain = replace(self.chain, joints=self.chain.joints[:k], tool=tool)
        return replace(self, chain=chain, held=np.zeros(0))


Feedforward = Literal["none", "gravity", "gravity-measured", "rigid-body"]


@dataclass(frozen=True, eq=False)
class Drive:
    """Motor-side control of every joint, in joint units.

    Parameters
    ----------
    kp, kd : (dof,) arrays
        Proportional and derivative gains on the reported motor position, N m/rad and N m s/rad, or N/m and N s/m.
    motor_inertia : (dof,) array, rotor and gears reflected to the joint, kg m^2 or kg
    rate_hz : float, of the servo loop
    feedforward : "none", "gravity", "gravity-measured" or "rigid-body"
        Torque added from the nominal masses: nothing; at the commanded motion what holds the arm, or also what
        accelerates it and its motors; or what holds it where the motors are.
    kv : (dof,) array or None
        Gains on the motor's own velocity, which a controller without a velocity command brakes by; none when None.
    brakes_late : bool, whether kv acts on the speed before a step, not behind it
    friction, damping, limit : (dof,) arrays or None
        Friction, viscous damping and largest torque that the drives are known to have, as a robot file gives them;
        none where it is silent.
    onset : (2, dof) array or None
        Of soft friction, the speed over which it grows, rad/s or m/s, and its time constant, s; 0 where it is dry.
    beyond : (3, dof) array
        Fractions of gravity's torque, of the inertia's, and of kd times the commanded velocity that are fed forward
        beyond that.
    known_inertia : (dof,) array or None, motor inertia that the controller feeds forward; the motors' own when None
    latency : (dof,) array or None
        Seconds by which commands reach each controller late; below 0 where the log's are stamped late.
    ki : (dof,) array or None, gains on the sum of errors, N m/(rad s) or N/(m s); none when None
    filtered : (dof,) array or None
        Time constants of the low-pass filters through which the controllers see their motors' speed, s; none when None.
    delivered : (dof,) array
        What the motors deliver of each torque that is commanded. Gains and limits here are of the torque delivered.
    """

    kp: FloatArray
    kd: FloatArray
    motor_inertia: FloatArray
    rate_hz: float = 1000.0
    feedforward: Feedforward = "none"
    kv: FloatArray | None = None
    brakes_late: bool = False
    friction: FloatArray | None = None
    damping: FloatArray | None = None
    limit: FloatArray | None = None
    onset: FloatArray | None = None
    beyond: FloatArray = field(default_factory=lambda: np.zeros((3, 1)))
    known_inertia: FloatArray | None = None
    latency: FloatArray | None = None
    ki: FloatArray | None = None
    filtered: FloatArray | None = None
    delivered: FloatArray = field(default_factory=lambda: np.ones(1))

    @property
    def feeds(self) -> bool:
        """Whether anything is fed forward."""
        return self.feedforward != "none" or bool(self.beyond.any())

    @property
    def is_compensated(self) -> bool:
        """Whether gravity is compensated where the motors are, not where they were commanded to be."""
        return self.feedforward == "gravity-measured"

    @property
    def speed_gains(self) -> tuple[FloatArray, FloatArray]:
        """Gains `(dof,)` on the speed before a step, and on that behind it."""
        nothing = np.zeros(len(self.kp))
        brakes = nothing if self.kv is None else self.kv
        return (self.kd + brakes, nothing) if self.brakes_late else (self.kd, brakes)

    def __post_init__(self) -> None:
        if not ((self.kp > 0).all() and (self.kd >= 0).all() and (self.motor_inertia >= 0).all()):
            raise DataError("kp must be above 0, kd and motor_inertia at least 0.")
