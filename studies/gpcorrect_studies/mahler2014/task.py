"""The debridement task of Sec. V-D: how much faster arms remove fragments with a correction, in open loop."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gpcorrect.calibration import load
from gpcorrect.types import Progress
from gpcorrect_studies.debridement import Condition, Mission, compare, stations
from gpcorrect_studies.debridement.rehearsal import AFTER_REHEARSAL, learn

REHEARSALS, SPEED = 20, 0.06  # fragments and m/s, as `gpcorrect debride` has them
FRAGMENTS = 4  # of a set


def debridement_task(sets: int, seed: int, progress: Progress) -> dict[str, float]:
    """Remove sets of fragments with two simulated arms, as `gpcorrect debride` does, but asking the models themselves.

    Parameters
    ----------
    sets : int, none gives no figures
    seed : int, of rehearsals, fragments and noise
    progress : Progress

    Returns
    -------
    dict
        `seconds_a_fragment` corrected in open loop; `speedup`, those of looking and moving over them; and
        `success_rate_difference` between the two. Means over the sets.
    """
    if sets == 0:
        return {}
    scene, places = stations(2)
    with TemporaryDirectory() as name:
        folder = Path(name)
        start = max(learn(scene, place, folder, REHEARSALS, SPEED, seed) for place in places) + AFTER_REHEARSAL
        correctors = [load(folder / f"{place.name}.gpc") for place in places]
    done = []
    for number in range(sets):
        progress.step("debridement", number / sets)
        fragments = scene.fragments(FRAGMENTS, np.random.default_rng([seed, 3, number]))
        mission = Mission(scene, places, fragments, start=start)
        done.append(compare(mission, correctors, seed + number, fast=SPEED))
    progress.step("debridement", 1.0)
    looking, knowing, *_ = (way.to_dict() for way in Condition.joined(done))
    return {
        "speedup": looking["seconds_per_fragment"] / knowing["seconds_per_fragment"],
        "seconds_a_fragment": knowing["seconds_per_fragment"],
        "success_rate_difference": knowing["success_rate"] - looking["success_rate"],
    }
