"""The steps of the servo loop, compiled: from what a joint is given to where it is a step later.

A step first moves freely, then friction takes away what speed it can; :mod:`gpcorrect.sim.servo` has the reasons.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from gpcorrect.sim.effects.laws import contact, resisting
from gpcorrect.types import FloatArray, IntArray

Sides = tuple[float, float]  # before the transmission and behind it
Frictions = tuple[Sides, Sides, Sides, Sides, float, float, float]  # of one joint in a step, as `_frictions` has them
MOTOR, JOINT = 0, 1  # the order of `SIDES`
TINY = 1e-300  # N m or N: keeps the ratio of two frictions defined where there is none


class Given(NamedTuple):
    """What the compiled steps are given: constants `(dof,)`, and references runs first, read along the memory.

    A controller's gains on the error, on that of the speed before a step (`kd`) and behind it (`kv`), and on the sum of
    errors (`ki`).

    `position` and `velocity` are given at the m steps `(N, m, dof)`, `feedforward`, `load` and `carried` at every
    `stride`-th of them `(N, n, dof)` and are linear between. `gain` is the speed won in a step for each unit of torque,
    `held` the share that the speed before a step has in where it leads, `kept` the share that what a controller saw of
    the speed a step ago has in what it sees; `load` goes against the motion, `carried` is what the frictions see.
    """

    kp: FloatArray
    kd: FloatArray
    kv: FloatArray
    ki: FloatArray
    gain: FloatArray
    held: FloatArray
    kept: FloatArray
    step: float
    stride: int
    position: FloatArray
    velocity: FloatArray
    feedforward: FloatArray
    load: FloatArray
    carried: FloatArray


class State(NamedTuple):
    """Where a loop is, `(N, dof)` each: its steps move it on in place.

    Parameters
    ----------
    position, velocity : arrays, of the motors
    seen : array, speed that the controllers see
    summed : array, torque of their integral actions
    bent : array, force of the frictions' bristles
    """

    position: FloatArray
    velocity: FloatArray
    seen: FloatArray
    summed: FloatArray
    bent: FloatArray


class Laws(NamedTuple):
    """Laws of the effects: rows of numbers in the order of their columns, and a friction's side.

    Those of column j are the rows `of[j]` to `of[j + 1]`. Nothing in the steps cuts rows out of an array: the counting
    of references to the cuts would take longer than the laws.
    """

    friction: FloatArray
    friction_of: IntArray
    friction_side: IntArray
    torque: FloatArray
    torque_of: IntArray


@njit(cache=True, nogil=True, error_model="numpy")
def advance(  # noqa: C901 -- in two functions the loop takes two to three times as long
    first: int,
    last: int,
    given: Given,
    laws: Laws,
    state: State,
    bent: FloatArray | None,
    samples: FloatArray,
) -> None:
    """Move the states of the runs `first` to `last` through the steps, in place.

    Every `stride`-th step leaves its position, velocity, commanded torque and torque behind the transmission in
    `samples` `(4, N, n, dof)`.

    Parameters
    ----------
    first, last : int, of the N runs
    given : Given
    laws : Laws
    state : State
    bent : (N, dof) array or None
        That of the state; None where no friction has bristles, for which a loop of its own is compiled.
    samples : (4, N, n, dof) array, result
    """
    position, velocity, seen, summed, _ = state
    end = given.load.shape[1] - 1
    for r in range(first, last):
        k, beyond = 0, 0
        wanted, pace, fed = given.position[r], given.velocity[r], given.feedforward[r]
        loads, loads_felt = given.load[r], given.carried[r]
        for i in range(wanted.shape[0]):
            part, after = beyond / given.stride, min(k + 1, end)
            for j in range(position.shape[1]):
                q, v = position[r, j], velocity[r, j]
                speed = v
                if given.kept[j] > 0.0:
                    speed = seen[r, j] = v + given.kept[j] * (seen[r, j] - v)
                torque = given.kp[j] * (wanted[i, j] - q) + given.kd[j] * (pace[i, j] - speed)
                torque += _between(fed, k, after, part, j)
                if given.ki[j] > 0.0:
                    summed[r, j] += given.step * given.ki[j] * (wanted[i, j] - q)
                    torque += summed[r, j]
                load, felt = _between(loads, k, after, part, j), _between(loads_felt, k, after, part, j)
                frictions = _frictions(laws, j, q, v, felt, given.gain[j], given.step, given.kv[j])
                limit, fraction, held, rate = 0.0, 0.0, 0.0, 0.0
                if bent is not None:
                    limit, fraction, held, rate = _bristles(laws, j, q, v, felt, bent[r, j], given.step)
                while True:
                    braking, against, asked = frictions, load, torque
                    if bent is not None:
                        braking, against = _damped(frictions, rate, fraction), load + held
                    if given.kv[j] > 0.0:
                        asked = _with_brake(torque, given.kv[j], v, given.gain[j], against, braking, laws, j, q)
                    delivered, pressed = _delivered(laws, j, asked, q)
                    speed, behind = _braked(v, given.gain[j], delivered - pressed - against, braking, given.held[j])
                    if bent is None:
                        break
                    bent[r, j] = held + rate * speed
                    if not abs(bent[r, j]) > limit:
                        break
                    held, rate = min(max(bent[r, j], -limit), limit), 0.0  # it slips
                position[r, j], velocity[r, j] = q + given.step * (speed + given.held[j] * (v - speed)), speed
                if beyond == 0:
                    samples[0, r, k, j], samples[1, r, k, j], samples[2, r, k, j] = q, v, asked
                    samples[3, r, k, j] = behind + fraction * held + pressed
            beyond += 1
            if beyond == given.stride:
                k, beyond = k + 1, 0


@njit(cache=True, error_model="numpy")
def _between(samples: FloatArray, k: int, after: int, part: float, j: int) -> float:
    """Value between a sample and the one after it."""
    value: float = samples[k, j] + part * (samples[after, j] - samples[k, j])
    return value


@njit(cache=True, error_model="numpy")
def _delivered(laws: Laws, j: int, torque: float, q: float) -> tuple[float, float]:
    """Torque that the drive delivers, and the one with which stops are pressed."""
    pressed = 0.0
    for a in range(laws.torque_of[j], laws.torque_of[j + 1]):
        torque = min(max(torque, -laws.torque[a, 0]), laws.torque[a, 0])
        pressed += contact(laws.torque, a, q)
    return torque, pressed


@njit(cache=True, error_model="numpy")
def _with_brake(
    torque: float, kv: float, v: float, gain: float, load: float, frictions: Frictions, laws: Laws, j: int, q: float
) -> float:
    """Torque less `kv` times the speed at the end of the step.

    Implicit, since a gain on the motor's own speed is often so high that the loop is unstable if it acts a step late.
    Only MuJoCo's steps have such a gain.
    """
    pressed = _delivered(laws, j, torque, q)[1]
    return torque - kv * _braked(v, gain, torque - pressed - load, _damped(frictions, kv, 0.0), 0.0)[0]


@njit(cache=True, error_model="numpy")
def _frictions(laws: Laws, j: int, q: float, v: float, load: float, gain: float, step: float, kv: float) -> Frictions:
    """Dry limits against forward and backward motion, damping, and of soft friction the limits, slope and `ahead`.

    And last what of the damping acts by the speed behind the step, which :func:`_damped` adds to. Without those that
    bend (`_bristles`). Soft frictions add up to one: below its limit it is `slope (v + ahead (u - v))`, u the speed
    after the step. `ahead` is inertia over slope in steps, and more by what damping and `kv` take of the acceleration
    within a step: the law counts by what it is at the beginning. It is at least 1, or the speed would overshoot zero.

    Apart from `_braked`, so that the compiler inlines both: as one function the loop takes twice as long.
    """
    forward, backward, damping, soft = (0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)
    slope, inertia = 0.0, 0.0
    for a in range(laws.friction_of[j], laws.friction_of[j + 1]):
        behind = laws.friction_side[a] == JOINT
        damping = _added(damping, laws.friction[a, 7], behind)
        if laws.friction[a, 10] > 0.0:
            continue
        up, down = resisting(laws.friction, a, q, v, load)
        if laws.friction[a, 8] > 0.0:
            soft = _added(soft, up, behind)
            slope += laws.friction[a, 8]
            inertia += laws.friction[a, 9]
        else:
            forward, backward = _added(forward, up, behind), _added(backward, down, behind)
    ahead = 1.0
    if slope > 0.0:
        ahead = max(inertia * (1.0 + gain * (damping[MOTOR] + damping[JOINT] + kv)) / (slope * step), 1.0)
    return forward, backward, damping, soft, slope, ahead, 0.0


@njit(cache=True, error_model="numpy")
def _bristles(
    laws: Laws, j: int, q: float, v: float, load: float, bent: float, step: float
) -> tuple[float, float, float, float]:
    """Limit of the frictions that bend, the fraction behind the transmission, and force and damping until they slip.

    The law F' = bristle (v - |v| F / limit), in which the speed that bends is the one after the step.
    """
    limits, bristle = (0.0, 0.0), 0.0
    for a in range(laws.friction_of[j], laws.friction_of[j + 1]):
        if laws.friction[a, 10] > 0.0:
            up, _ = resisting(laws.friction, a, q, v, load)
            limits = _added(limits, up, laws.friction_side[a] == JOINT)
            bristle += laws.friction[a, 10]
    limit = limits[MOTOR] + limits[JOINT]
    shed = 1.0 / (1.0 + bristle * step * abs(v) / max(limit, TINY))
    return limit, limits[JOINT] / max(limit, TINY), shed * bent, shed * bristle * step


@njit(cache=True, error_model="numpy")
def _damped(frictions: Frictions, more: float, behind: float) -> Frictions:
    """Return the same with more damping by the speed behind the step, a fraction of it behind the transmission."""
    forward, backward, damping, soft, slope, ahead, late = frictions
    damping = (damping[MOTOR] + (1.0 - behind) * more, damping[JOINT] + behind * more)
    return forward, backward, damping, soft, slope, ahead, late + more


@njit(cache=True, error_model="numpy")
def _braked(v: float, gain: float, driving: float, frictions: Frictions, held: float) -> tuple[float, float]:
    """Speed after a step, and the friction behind the transmission in it.

    Under a held torque (a `held` of a half) viscous friction acts within the step: to the fourth order what it leaves
    of a speed, exp(-drag). MuJoCo's steps (none `held`) take it at their ends, 1 / (1 + drag). Dry friction stops what
    it can beside the soft friction of a joint that stops; soft friction acts on what is left.
    """
    forward, backward, damping, soft, slope, ahead, late = frictions
    drag = gain * (damping[MOTOR] + damping[JOINT] - late)
    within = 1.0 + drag * (1.0 - held * (1.0 - drag / 6.0))
    gain = gain / within
    shed = 1.0 / (1.0 + gain * late)
    free = shed * ((within - drag) / within * v + gain * driving)
    gain = gain * shed
    ceiling = gain * (forward[MOTOR] + forward[JOINT])
    floor = -gain * (backward[MOTOR] + backward[JOINT])
    behind = 0.0
    if slope > 0.0:
        limit = soft[MOTOR] + soft[JOINT]
        stopped = min(max(slope * (1.0 - ahead) * v, -limit), limit)
        taken = min(max(free - gain * stopped, floor), ceiling)
        implicit = slope / (1.0 + slope * ahead * gain)
        creeping = min(max(implicit * (v + ahead * (free - taken - v)), -limit), limit)
        behind = soft[JOINT] / max(limit, TINY) * creeping
        speed = free - taken - gain * creeping
    else:
        taken = min(max(free, floor), ceiling)
        speed = free - taken
    limits = forward if taken > 0.0 else backward
    if limits[JOINT] > 0.0:
        behind += limits[JOINT] / (limits[MOTOR] + limits[JOINT]) * taken / gain
    return speed, behind + damping[JOINT] * speed


@njit(cache=True, error_model="numpy")
def _added(sides: Sides, value: float, behind: bool) -> Sides:
    """Return the same with a value more before the transmission, or behind it."""
    return (sides[MOTOR], sides[JOINT] + value) if behind else (sides[MOTOR] + value, sides[JOINT])
