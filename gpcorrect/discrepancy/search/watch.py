"""Between which instants a change can be told from one odd motion: whole motions must lie on either side."""

from __future__ import annotations

import numpy as np

from gpcorrect.discrepancy.recording.scene import Scene

__all__ = ["WATCHED", "watched"]

WATCHED = 2  # motions before and after: one alone may be odd for a reason of its own


def watched(scene: Scene, session: int) -> tuple[float, float]:
    """Session time from the end of the first motions to the start of the last ones, s; inf, -inf for too few.

    Parameters
    ----------
    scene : Scene
        The recording.
    session : int
        Index of the session, from 0.
    """
    here, time = scene.session == session, scene.layout.gather(scene.motion.time, len(scene))
    motions = [time[here & (scene.trajectory == t)] for t in np.unique(scene.trajectory[here])]
    if len(motions) < 2 * WATCHED:
        return np.inf, -np.inf
    return sorted(float(m.max()) for m in motions)[WATCHED - 1], sorted(float(m.min()) for m in motions)[-WATCHED]
