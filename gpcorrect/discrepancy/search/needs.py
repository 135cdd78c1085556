"""Which effects a recording cannot show for want of a signal: told before the search, not found out by it."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.candidates import Candidate
from gpcorrect.types import CalibrationLog

__all__ = ["split_by_needs"]

SAMPLES = re.compile(r"samples at (\d+) Hz")


def split_by_needs(
    candidates: Iterable[Candidate], scene: Scene, log: CalibrationLog
) -> tuple[list[Candidate], list[str]]:
    """Candidates whose needs are met, and a sentence for each effect whose are not.

    Parameters
    ----------
    candidates : iterable of Candidate
        To be searched.
    scene : Scene
        Recording and model.
    log : CalibrationLog
        The recording.
    """
    met: dict[str, str] = {}
    able = []
    for candidate in candidates:
        if candidate.name not in met:
            lacking = [need for need in candidate.kind.about.needs if not _is_met(need, scene, log)]
            met[candidate.name] = "; ".join(lacking)
        if not met[candidate.name]:
            able.append(candidate)
    unable = [f"{name.replace('_', ' ')} needs {what.replace('|', ' or ')}" for name, what in met.items() if what]
    return able, unable


def _is_met(need: str, scene: Scene, log: CalibrationLog) -> bool:
    if found := SAMPLES.search(need):
        steps = np.diff(log.time)[np.diff(scene.trajectory) == 0]
        return bool(len(steps)) and float(np.median(steps)) <= 1.0 / float(found.group(1))
    if need.startswith("T_tracker_base"):
        return True  # its shift and turn leave no trace then, its scale still does
    if " " in need:
        return True
    return any(name in log.signals for name in need.split("|"))
