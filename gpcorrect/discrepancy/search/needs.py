"""Which effects a recording cannot show for want of a signal: told before the search, not found out by it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.recording.scene import LOOP_STAGES, Scene
from gpcorrect.discrepancy.search.candidates import Candidate
from gpcorrect.discrepancy.search.watch import WATCHED
from gpcorrect.sim.effects import EFFECTS, ChainEffect, Effect, Family, LoadEffect, Site, TipEffect
from gpcorrect.types import CalibrationLog

__all__ = ["Lack", "left_silent", "limits_of", "split_by_needs"]

SAMPLES = re.compile(r"samples at (\d+) Hz")
DENSE_HZ = 17.0  # below, neighbouring samples differ by motion: noise cannot be told from it sample by sample


@dataclass(frozen=True)
class Lack:
    """An effect that these data cannot name, and what is lacking."""

    effect: str
    why: str


def split_by_needs(
    candidates: Iterable[Candidate], scene: Scene, log: CalibrationLog
) -> tuple[list[Candidate], tuple[Lack, ...]]:
    """Candidates whose needs are met, and what is lacking for every effect of the catalogue whose are not.

    Parameters
    ----------
    candidates : iterable of Candidate
        To be searched.
    scene : Scene
        Recording and model.
    log : CalibrationLog
        The recording.
    """
    every = list(candidates)
    placed = {c.name for c in every}
    lacks = {}
    for name, kind in EFFECTS.items():
        why = _lacking(kind, scene, log, placed=name in placed)
        if why:
            lacks[name] = Lack(name, why)
    return [c for c in every if c.name not in lacks], tuple(lacks.values())


def left_silent(silent: Sequence[str], heard: Iterable[str], scene: Scene) -> tuple[Lack, ...]:
    """Effects no candidate of which left a trace, given the labels of the silent and the names of the others."""
    known = set(heard)
    names = dict.fromkeys(label.split(" (")[0].replace(" ", "_") for label in silent)
    weightless = not scene.load().any()
    why = "no load is known that it could answer to" if weightless else "it leaves no trace in these signals"
    return tuple(Lack(name, why) for name in names if name in EFFECTS and name not in known)


def limits_of(scene: Scene) -> tuple[str, ...]:
    """Sentences on what these signals can show only in part."""
    said = []
    if scene.tracked and scene.model.T_tracker_base is None:
        said.append("of a registration error only the scale can show: the tracker is registered from this recording")
    if scene.tracked:
        said.append(
            "of the tracker, positions are compared, not orientations: a joint that does not move the tip is unseen"
        )
    if scene.n_sessions == 1:
        said.append("one session: a homing offset looks like any other constant offset of its joint")
    return tuple(said)


def _lacking(kind: type[Effect], scene: Scene, log: CalibrationLog, *, placed: bool) -> str:
    """Return what is lacking for an effect, in words; empty for nothing."""
    missing = [need.replace("|", " or ") for need in kind.about.needs if not _is_met(need, scene, log)]
    if missing:
        return f"the log lacks {' and '.join(missing)}"
    if scene.machine.body.chain is None and issubclass(kind, ChainEffect | LoadEffect | TipEffect):
        return "the model has bare joints: name the arm, for its kinematics and masses"
    if kind.about.family == Family.NOISE:
        return "" if _rate(scene) > DENSE_HZ else f"samples come slower than {DENSE_HZ:.0f} Hz"
    if kind.stage in LOOP_STAGES and not issubclass(kind, ChainEffect | LoadEffect) and scene.plan is None:
        return "the servo loop is not simulated: it takes [controller] in the model, setpoints, and an even clock"
    return "" if placed else _no_place(kind)


def _no_place(kind: type[Effect]) -> str:
    if any(p.change_point for p in kind.about.parameters):
        return f"no session has {2 * WATCHED} motions: an instant takes {WATCHED} before it and {WATCHED} after"
    sites = set(kind.about.sites)
    if sites == {Site.INSERTION}:
        return "none of the model's joints slides"
    return "the model has one joint only" if sites == {Site.PAIR} else "no joint of the model can have it"


def _rate(scene: Scene) -> float:
    steps = np.diff(scene.time)[np.diff(scene.trajectory) == 0]
    steps = steps[steps > 0]
    return float(1.0 / np.median(steps)) if len(steps) else 0.0


def _is_met(need: str, scene: Scene, log: CalibrationLog) -> bool:
    if found := SAMPLES.search(need):
        return _rate(scene) >= float(found.group(1))
    if need == "payload":
        return bool(scene.payload.any())
    if " " in need or need.startswith("T_tracker_base"):
        return True  # said in words: a registration from the same data leaves at least the scale
    return any(name in log.signals for name in need.split("|"))
