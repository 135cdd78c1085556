"""Path effects one sample at a time: what each must remember between samples of a motion that never ends.

The catalogue's effects act on whole recordings. Most look at one sample only and act on a recording of one sample as
they are; those with memory are given the sample before and their own state in front of the new one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

import numpy as np

from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Effect, PathEffect, of_kind
from gpcorrect.sim.effects.backlash import Backlash
from gpcorrect.sim.effects.cable_coupling import CableCoupling
from gpcorrect.sim.effects.creep import Creep
from gpcorrect.sim.effects.delay import Delay
from gpcorrect.sim.effects.hysteresis import Hysteresis
from gpcorrect.sim.effects.loading_curve import loading_curve
from gpcorrect.sim.effects.operators import lag, play, travelled
from gpcorrect.sim.effects.oscillator import swung
from gpcorrect.sim.effects.resonance import Resonance
from gpcorrect.sim.effects.stages import with_column
from gpcorrect.sim.motion import Motion
from gpcorrect.types import FloatArray

__all__ = ["LiveEffect", "live_effects"]


class LiveEffect(Protocol):
    """Takes `(1, 1, dof)` paths one after the other."""

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        """Return the path behind the effect; see :class:`~gpcorrect.sim.effects.stages.PathEffect`."""


def live_effects(effects: tuple[Effect, ...]) -> tuple[LiveEffect, ...]:
    """Return a machine's path effects, in order, with a memory each where they need one.

    Raises
    ------
    DataError
        An effect would need to know the future.
    """
    return tuple(_remembering(effect) for effect in of_kind(effects, PathEffect))


def _remembering(effect: PathEffect) -> LiveEffect:
    factory = MEMORIES.get(type(effect))
    return effect if factory is None else factory(effect)


class _Play:
    """A play that goes on from where it stands: its output and input before the new sample restore it exactly."""

    def __init__(self, radius: float) -> None:
        self._radius = radius
        self._before: tuple[float, float] | None = None

    def step(self, u: float) -> float:
        begin = (u, u) if self._before is None else self._before
        output = float(play(np.array([*begin, u]), self._radius)[-1])
        self._before = output, u
        return output


class _LiveBacklash:
    def __init__(self, effect: Backlash) -> None:
        self._effect, self._play = effect, _Play(effect.radius)

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        j = self._effect.column(motion.joints)
        return with_column(q, j, np.full(q.shape[:-1], self._play.step(float(q[0, 0, j]))))


class _LiveCoupling:
    def __init__(self, effect: CableCoupling) -> None:
        self._effect, self._play = effect, _Play(effect.drag_radius)

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        effect = self._effect
        j, k = effect.column(motion.joints), effect.column(motion.joints, effect.source)
        source = float(q[0, 0, k])
        wound = effect.coefficient * source + effect.drag * (source - self._play.step(source))
        return with_column(q, j, q[..., j] - wound)


class _LiveCreep:
    def __init__(self, effect: Creep) -> None:
        self._effect = effect
        self._before: tuple[float, float, float] | None = None  # state, load, time

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        effect, j = self._effect, self._effect.column(motion.joints)
        load, now = float(motion.load[0, 0, j]), float(motion.time[0, 0])
        state, before, then = (load, load, now) if self._before is None else self._before
        settled = float(lag(np.array([state, before, load]), np.array([then, then, now]), effect.time_constant)[-1])
        self._before = settled, load, now
        return with_column(q, j, q[..., j] - effect.compliance * settled)


class _LiveHysteresis:
    def __init__(self, effect: Hysteresis) -> None:
        self._effect, self._curve = effect, loading_curve(effect.sharpness)
        self._state = 0.0
        self._last: float | None = None

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        effect, j = self._effect, self._effect.column(motion.joints)
        u = float(q[0, 0, j])
        if effect.radius > 0 and self._last is not None:
            self._state = float(travelled(self._curve, self._state, (u - self._last) / effect.radius))
        self._last = u
        return with_column(q, j, q[..., j] - effect.radius * self._state)


class _LiveResonance:
    """Exact for an input that is linear between samples, as :func:`~gpcorrect.sim.effects.operators.ring`."""

    def __init__(self, effect: Resonance) -> None:
        self._effect = effect
        self._before: tuple[float, float, float, float] | None = None  # place, rate, input, time

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        j = self._effect.column(motion.joints)
        u, now = float(q[0, 0, j]), float(motion.time[0, 0])
        place, rate = self._swing(u, now)
        self._before = place, rate, u, now
        return with_column(q, j, np.full(q.shape[:-1], place))

    def _swing(self, u: float, now: float) -> tuple[float, float]:
        if self._before is None or np.isinf(self._effect.frequency):
            return u, 0.0
        place, rate, last, then = self._before
        if now <= then:
            return place, rate
        omega, damping = 2 * np.pi * self._effect.frequency, self._effect.damping_ratio
        slope = (u - last) / (now - then)
        behind = 2.0 * damping * slope / omega
        away, speed = swung(place - last + behind, rate - slope, now - then, omega, damping)
        return u - behind + away, slope + speed


class _LiveDelay:
    """Keeps as much of the past as the delay asks for; between samples the path is a straight line."""

    def __init__(self, effect: Delay) -> None:
        if effect.delay < 0:
            raise DataError(
                f"an arm that runs live cannot be seen {-effect.delay} s before it moves.",
                hint="Leave the effect `delay` out, or give it a delay of at least 0.",
            )
        self._delay = effect.delay
        self._past: deque[tuple[float, FloatArray]] = deque()

    def act(self, q: FloatArray, motion: Motion) -> FloatArray:
        now = float(motion.time[0, 0])
        self._past.append((now, q))
        while len(self._past) > 1 and self._past[1][0] <= now - self._delay:
            self._past.popleft()
        (t0, q0), (t1, q1) = self._past[0], self._past[min(1, len(self._past) - 1)]
        share = min(max((now - self._delay - t0) / (t1 - t0), 0.0), 1.0) if t1 > t0 else 0.0
        return q0 + share * (q1 - q0)


MEMORIES: dict[type[PathEffect], Callable[..., LiveEffect]] = {
    Backlash: _LiveBacklash,
    CableCoupling: _LiveCoupling,
    Creep: _LiveCreep,
    Hysteresis: _LiveHysteresis,
    Resonance: _LiveResonance,
    Delay: _LiveDelay,
}
