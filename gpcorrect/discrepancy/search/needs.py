"""Which effects a recording cannot show for want of a signal: known before the search."""

from __future__ import annotations

from collections.abc import Iterable, Set
from dataclasses import dataclass

from gpcorrect.arms import RemoteCentreArm
from gpcorrect.discrepancy.recording.scene import LOOP_STAGES, Scene
from gpcorrect.discrepancy.search.candidates import Candidate
from gpcorrect.discrepancy.search.state import Search
from gpcorrect.discrepancy.settings import NOISE, SEARCH
from gpcorrect.sim.effects import EFFECTS, ChainEffect, Effect, Family, LoadEffect, Site, Stage, TipEffect
from gpcorrect.types import CalibrationLog


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
    scene : Scene
    log : CalibrationLog
    """
    loads, signals = scene.load(), {*log.signals} - {"payload"}
    turned = {j for j, load in zip(scene.joints, loads.T, strict=True) if load.min() < 0.0 < load.max()}
    every = [c for c in candidates if c.joint in turned or not c.kind.about.turned_load]
    signals |= {"payload"} if scene.payload.any() else set()
    placed = {c.name for c in every}
    whys = {name: _lacking(kind, scene, signals, placed=name in placed) for name, kind in EFFECTS.items()}
    able = [c for c in every if not whys[c.name]]
    # The tracker's own delay is told from one of all sensors by an encoder beside it.
    if scene.tracker is None or all(c.signal != "external_jp" for c in scene.channels):
        able = [c for c in able if c.kind.stage != Stage.CLOCK or c.joint != Site.TOOL]
    return able, tuple(Lack(name, why) for name, why in whys.items() if why)


def lacks_of_traces(search: Search) -> tuple[Lack, ...]:
    """Return the effects no candidate of which left a trace.

    Parameters
    ----------
    search : Search
    """
    known = {t.candidate.name for t in search.traces}
    weightless = not search.dataset.scene.load().any()
    why = "no load is known that it could answer to" if weightless else "it leaves no trace in these signals"
    return tuple(Lack(name, why) for name in dict.fromkeys(c.name for c in search.without_trace) if name not in known)


def limits_of(scene: Scene) -> tuple[str, ...]:
    """Return sentences on what these signals can show only in part.

    Parameters
    ----------
    scene : Scene
    """
    limits = []
    if scene.tracker is not None and scene.model.T_tracker_base is None:
        limits.append("of a registration error only the scale can show: the tracker is registered from this recording")
    if scene.tracker is not None and not any(c.signal == "tracker_rotation" for c in scene.channels):
        limits.append(
            "of the tracker, positions are compared, not orientations: a joint that does not move the tip is unseen"
        )
    if scene.n_sessions == 1:
        limits.append("one session: a homing offset looks like any other constant offset of its joint")
    return tuple(limits)


def _lacking(kind: type[Effect], scene: Scene, signals: Set[str], *, placed: bool) -> str:
    """Return what is lacking for an effect, in words; empty for nothing."""
    missing = [need.replace("|", " or ") for need in kind.about.needs if signals.isdisjoint(need.split("|"))]
    if missing:
        return f"the log lacks {' and '.join(missing)}"
    if scene.machine.body.chain is None and issubclass(kind, ChainEffect | LoadEffect | TipEffect):
        return "the model has bare joints: name the arm, for its kinematics and masses"
    if kind.about.remote_centre and not isinstance(scene.machine.description, RemoteCentreArm):
        return "the arm has no remote centre of motion"
    if kind.about.family == Family.NOISE:
        return "" if scene.step <= NOISE.dense else f"samples come slower than {1.0 / NOISE.dense:.0f} Hz"
    if kind.stage in LOOP_STAGES and not issubclass(kind, ChainEffect | LoadEffect) and scene.plan is None:
        return "the servo loop is not simulated: it takes [controller] in the model, setpoints, and an even clock"
    return "" if placed else _no_place(kind)


def _no_place(kind: type[Effect]) -> str:
    if kind.about.turned_load:
        return "the load of no joint changes sign: of a gap it holds, nothing shows but an offset"
    if any(p.change_point for p in kind.about.parameters):
        n = SEARCH.watched
        return f"no session has {n + 1} motions: an instant takes {n} after the one it is in"
    sites = set(kind.about.sites)
    if sites == {Site.INSERTION}:
        return "none of the model's joints slides"
    return "the model has one joint only" if sites == {Site.PAIR} else "no joint of the model can have it"
