"""From a wish and a seed to a recording, what is known of the machine, and what is hidden in it."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from truth.alike import side_of
from truth.facts import labels_of, nominal_tables
from truth.hidden import Array, Hidden
from truth.history import Readings
from truth.kinds import kind_named
from truth.kinds.kind import Scene
from truth.machine import readings_of, simulate
from truth.record import recorded
from truth.reference import Reference
from truth.setting import Setting, prepare
from truth.sizing import GROWTH
from truth.spec import Case, Spec

DRAFT_STRIDE = 5  # every so many trajectories are simulated while a cause in the loop is sized


@dataclass(frozen=True, eq=False)
class Truth:
    """A case, its machine and motion without the causes (`setting`), and what was true with them at every tick."""

    case: Case
    setting: Setting
    readings: Readings
    hidden: tuple[Hidden, ...] = ()


def make_case(spec: Spec, seed: int) -> Case:
    """Make one recording with hidden causes; the same wish and seed give the same bytes."""
    return make_truth(spec, seed).case


def make_truth(spec: Spec, seed: int) -> Truth:
    """Make the same recording, and say what no one is told: what was true with and without the causes."""
    rng = np.random.default_rng([seed, zlib.crc32(repr(spec).encode())])
    setting = prepare(spec, rng)
    hidden = [_sized(setting, _drawn(setting, name, rng)) for name in spec.hidden]
    setting, readings, ratios = _hide(setting, hidden)
    log = recorded(setting, readings, rng)
    case = Case(log, nominal_tables(setting, rng), labels_of(setting, hidden, ratios, seed))
    return Truth(case, setting, readings, tuple(hidden))


def _hide(setting: Setting, hidden: list[Hidden]) -> tuple[Setting, Readings, list[float]]:
    """Run the machine with its causes and set the noise so that the ratios hold (on geometric average, of several)."""
    if not hidden:
        return setting, setting.readings, []
    _, readings = simulate(setting.machine, setting.reference, hidden, setting.history.motion)
    ratios = [_own_ratio(setting, h, readings, alone=len(hidden) == 1) for h in hidden]
    factor = float(np.exp(np.mean(np.log(np.maximum(ratios, 1e-6) / setting.spec.ratio))))
    return setting.louder(factor), readings, [r / factor for r in ratios]


def _drawn(setting: Setting, name: str, rng: np.random.Generator) -> Hidden:
    j = int(rng.integers(3))
    if name == "dh_error":
        j = int(rng.integers(1, 3))  # rows whose angle and length no registration takes up
    if name in ("length_dependent_stiffness", "capstan_friction"):
        j = int(rng.integers(2))  # joints that carry a load worth the name
    scene = Scene(setting.history, setting.scene_noise, setting.spec.sessions)
    return Hidden(name, j, kind_named(name).draw(rng, j, scene))


def _sized(setting: Setting, hidden: Hidden) -> Hidden:
    """Return the cause at the asked ratio: on the whole run where that is cheap, else on a few trajectories."""
    kind = kind_named(hidden.name)
    in_loop = kind.loop is not None or kind.force is not None
    reference, history, without = setting.reference, setting.history, setting.readings
    if in_loop:
        reference = _draft(setting, hidden)
        history, without = simulate(setting.machine, reference)
    rows = reference.logged
    share = len(rows) / len(setting.reference.logged) if kind.peaks else 1.0

    def measure(trial: Hidden) -> float:
        if in_loop:
            _, with_it = simulate(setting.machine, reference, [trial])
        else:
            with_it = readings_of(setting.machine, history, [trial])
        return setting.ratio(trial, with_it, without, rows) * float(np.sqrt(share))

    return GROWTH.grown(kind, hidden, setting.spec.ratio, measure)[0]


def _draft(setting: Setting, hidden: Hidden) -> Reference:
    """Return a few trajectories: the most extreme ones for a cause that acts at peaks, else spread evenly.

    Zig-zags only follow on from each other, so of them it is the first ones.
    """
    number, reference = setting.spec.trajectories, setting.reference
    if setting.spec.motion == "zigzag":
        return reference.only(np.arange(max(2, number // DRAFT_STRIDE)))
    peak = None
    if kind_named(hidden.name).peaks:
        motion = setting.history.motion
        peak = side_of(hidden.params) * motion.motor if "end" in hidden.params else np.abs(motion.command)
        peak = peak[:, hidden.column]
    return few_of(reference, number, peak)


def few_of(reference: Reference, number: int, peak: Array | None) -> Reference:
    """Return a few trajectories of so many: those with the greatest `peak` (ticks,), else spread evenly."""
    if peak is None:
        return reference.only(np.arange(0, number, DRAFT_STRIDE if number > 2 * DRAFT_STRIDE else 2))
    greatest = [peak[reference.trajectory == k].max() for k in range(number)]
    return reference.only(np.sort(np.argsort(greatest)[-max(2, number // DRAFT_STRIDE) :]))


def _own_ratio(setting: Setting, hidden: Hidden, readings: Readings, *, alone: bool) -> float:
    """Ratio of one cause on the whole run; among others, it is simulated once more by itself."""
    if not alone:
        _, readings = simulate(setting.machine, setting.reference, [hidden], setting.history.motion)
    return setting.ratio(hidden, readings, setting.readings, setting.reference.logged)
