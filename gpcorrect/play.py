"""Where in its slack a path is: the states of play operators, from the path's steps alone."""

from __future__ import annotations

import numpy as np

from gpcorrect.types import FloatArray, IntArray

__all__ = ["advance", "path_labels", "play_states"]

PAUSE_STEPS, PAUSE = 20.0, 1.0  # a wait longer than so many usual steps and so many seconds: anything may have happened


def path_labels(time: FloatArray, session: IntArray) -> IntArray:
    """Label `(n,)` the paths that samples at times `(n,)`, s, form: 0, 1... in row order.

    A slack knows nothing of where one motion ends and the next begins, so motions that follow each other are one path.
    It ends with the session, where time runs back, and with a pause.
    """
    steps = np.diff(time)
    longest = max(PAUSE_STEPS * float(np.median(steps)), PAUSE) if steps.size else PAUSE
    breaks = (session[1:] != session[:-1]) | (steps < 0) | (steps > longest)
    labels: IntArray = np.concatenate([np.zeros(min(1, len(time)), dtype=np.int64), np.cumsum(breaks)])
    return labels


def advance(state: FloatArray, step: FloatArray, radii: FloatArray) -> FloatArray:
    """Return the states `(h, k)` after one step `(k,)` of the path, for radii `(h, k)`.

    The state of a play (Krasnosel'skii and Pokrovskii 1989, Sec. 2) is how far its output lags behind its input, `d = u
    - w` in [-r, r]: the input moves freely inside the slack and drags the output at its edges, `d' = clip(d + du, -r,
    r)`. Exact for an input that is monotone during the step; where the path was before never matters.
    """
    moved: FloatArray = np.clip(state + step, -radii, radii)
    return moved


def play_states(steps: FloatArray, radii: FloatArray, labels: IntArray) -> FloatArray:
    """Return the states `(n, h, k)` along paths with steps `(n, k)` from the row before, for radii `(h, k)`.

    Every label `(n,)` is a path of its own: it starts in the middle of the slack, where nothing is known, and its first
    step is not looked at.
    """
    states = np.zeros((len(steps), *radii.shape))
    for i in range(1, len(steps)):
        if labels[i] == labels[i - 1]:
            states[i] = advance(states[i - 1], steps[i], radii)
    return states
