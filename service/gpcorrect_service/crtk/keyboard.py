"""Driving joints by hand: which key moves which joint, and how far."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray

UP, DOWN = "qwertyu", "asdfghj"
# What the command prints.
HELP = (
    "q w e r t y u move joints 1 to 7 up, a s d f g h j move them down; + and - change the step; space stops; x leaves"
)
FACTOR = 1.5  # chosen by hand
SMALLEST, LARGEST = 0.05, 20.0  # chosen by hand: times the first step


class KeyControl:
    """Turns key strokes into joint targets.

    Parameters
    ----------
    q : (dof,) array
        Where the arm is.
    step : (dof,) array
        First step of each joint, rad or m.
    """

    def __init__(self, q: FloatArray, step: FloatArray) -> None:
        self._target, self._step, self._scale = np.array(q, dtype=np.float64), np.array(step), 1.0
        self.done = False

    @property
    def target(self) -> FloatArray:
        """(dof,) joints to go to."""
        return self._target.copy()

    @property
    def step(self) -> FloatArray:
        """(dof,) step of each joint now."""
        return self._scale * self._step

    def press(self, key: str, setpoint: FloatArray) -> bool:
        """Take a key stroke; return whether the target changed.

        Parameters
        ----------
        key : str
        setpoint : (dof,) array
            Where the arm is commanded to.
        """
        match key:
            case "x":
                self.done = True
            case "+":
                self._scale = min(LARGEST, self._scale * FACTOR)
            case "-":
                self._scale = max(SMALLEST, self._scale / FACTOR)
            case " ":
                self._target = np.array(setpoint)
                return True
            case _:
                return self._move(key)
        return False

    def _move(self, key: str) -> bool:
        for keys, sign in ((UP, 1.0), (DOWN, -1.0)):
            joint = keys.find(key) if key else -1
            if 0 <= joint < len(self._target):
                self._target[joint] += sign * self.step[joint]
                return True
        return False
