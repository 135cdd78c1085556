"""How a path is streamed to a robot on a machine that holds up both: clock, arm and tool are the test's own."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest

from gpcorrect.types import FloatArray
from gpcorrect_service.crtk.robot import ALIKE, LONGEST_LEAD, LONGEST_STEP, Pacing

PERIOD = 0.02  # s between two states
TIMES = np.arange(0.0, 6.0, 1 / 30)
ALLOWED = LONGEST_LEAD + 2 * ALIKE  # s at a path's top speed; the simulated arm refuses to jump by 0.3
PATHS = {
    "a straight line": TIMES,
    "zig-zags": np.abs(TIMES % 2.0 - 1.0),
    "short zig-zags": np.abs(TIMES % 0.6 - 0.3),
    "swings": np.sin(40.0 * TIMES) / 40.0,
    "rests": np.clip(np.abs(TIMES % 3.0 - 1.5) - 0.5, 0.0, None),
    "nothing": np.zeros(len(TIMES)),
}


class BusyMachine:
    """An arm of some joints that obeys where it is let to; its states wait for the tool."""

    def __init__(self, start: FloatArray, rng: np.random.Generator) -> None:
        self.rng, self.clock, self.setpoint = rng, 0.0, start
        self.commands: list[FloatArray] = []
        self.states: deque[tuple[float, FloatArray]] = deque()
        self.jumps: list[FloatArray] = []

    def next_state(self) -> tuple[float, FloatArray]:
        """Return the tool's next state: the arm goes on by one or many of them, or stands while old ones are read."""
        draw = self.rng.random()
        if not self.states:
            for _ in range(self.rng.integers(5, 80) if draw < 0.1 else 1):
                self._go_on()
        elif draw < 0.05:
            self._go_on()
        return self.states.popleft()

    def _go_on(self) -> None:
        self.jumps += [np.abs(command - self.setpoint) for command in self.commands]
        self.setpoint, self.commands = [self.setpoint, *self.commands][-1], []
        self.clock += PERIOD
        self.states.append((self.clock, self.setpoint))


@pytest.mark.parametrize("name", PATHS)
def test_whatever_is_held_up_no_command_is_far_from_the_arm(name: str) -> None:
    """Commands for old states that reach the arm all at once, at a corner too, are none that it refuses; it arrives."""
    q = np.stack([PATHS[name], np.zeros(len(TIMES))], axis=1)
    fastest = np.abs(np.diff(q, axis=0)).max(axis=0) * 30.0
    for seed in range(10):
        machine, pacing = BusyMachine(q[0], np.random.default_rng(seed)), Pacing(TIMES, 0.0, q)
        for _ in range(5000):
            machine.commands.append(pacing.joints)
            if pacing.is_over:
                break
            pacing.advance(*machine.next_state())
        assert pacing.is_over
        np.testing.assert_allclose(pacing.joints, q[-1])
        assert (np.array(machine.jumps) <= ALLOWED * fastest + 1e-9).all()


def test_an_arm_that_stands_is_not_left_behind() -> None:
    """States whose clock goes on while the setpoint stands move the command by the longest lead, and then no more."""
    pacing = Pacing(TIMES, 0.0, TIMES[:, None])
    for k in range(1, 500):
        pacing.advance(k * PERIOD, np.zeros(1))
    assert LONGEST_LEAD <= pacing.moment < ALLOWED


def test_a_tool_that_was_held_up_goes_on_where_it_was() -> None:
    """Whatever time has passed by the robot's clock, the next command is one step on: nothing is left out."""
    for q in (TIMES[:, None], None):
        pacing = Pacing(TIMES, 100.0, q)
        pacing.advance(102.0, np.zeros(1))
        assert pacing.moment == pytest.approx(LONGEST_STEP)


def test_a_long_rest_in_a_path_is_gone_through_as_the_clock_goes() -> None:
    """A path that stands still for minutes keeps the robot's time, and its end is found after it."""
    times = np.array([0.0, 1.0, 601.0, 602.0])
    pacing, setpoint = Pacing(times, 0.0, np.array([[0.0], [1.0], [1.0], [0.0]])), np.zeros(1)
    for k in range(1, 10_000):
        pacing.advance(k * 0.07, setpoint)
        setpoint = pacing.joints
        if pacing.is_over:
            break
    assert k * 0.07 == pytest.approx(602.0, abs=1.0)
    np.testing.assert_array_equal(pacing.joints, [0.0])
