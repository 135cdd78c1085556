"""From a wish and a seed to a recording, what is known of the machine, and what is hidden in it."""

from __future__ import annotations

import zlib

import numpy as np

from truth.facts import labels_of, nominal_tables
from truth.hidden import Growth, Hidden
from truth.kinds import kind_named
from truth.kinds.kind import Scene
from truth.recipe import Truth, hide, sized
from truth.record import recorded
from truth.setting import Setting, prepare
from truth.spec import Case, Spec

PHYSICAL = {
    "resonance": {"frequency": (5.0, 40.0)},
    "capstan_friction": {"wrap": (1e-4, 0.5)},
    "payload": {"mass": (2e-3, 1.0)},
    "joint_stop": {"stiffness": (0.05, 2e5)},
    "delay": {"delay": (2e-4, 0.05)},
    "transmission_ratio": {"error": (-0.2, 0.2)},
    "shaft_bending": {"rigidity": (0.05, 200.0)},
    "rcm_shift": {"stiffness": (300.0, 1e7)},
}
GROWTH = Growth(close=0.03, tries=9, stride=2.5, physical=PHYSICAL)


def make_case(spec: Spec, seed: int) -> Case:
    """Make one recording with hidden causes; the same wish and seed give the same bytes."""
    return make_truth(spec, seed).case


def make_truth(spec: Spec, seed: int) -> Truth:
    """Make the same recording, and say what no one is told: what was true with and without the causes."""
    rng = np.random.default_rng([seed, zlib.crc32(repr(spec).encode())])
    setting = prepare(spec, rng)
    hidden = [_drawn(setting, name, rng) for name in spec.hidden]
    setting, readings, ratios = hide(setting, hidden)
    log = recorded(setting, readings, rng)
    case = Case(log, nominal_tables(setting, rng), labels_of(setting, hidden, ratios, seed))
    return Truth(case, setting, readings, tuple(hidden))


def _drawn(setting: Setting, name: str, rng: np.random.Generator) -> Hidden:
    """Return a cause at the asked ratio."""
    j = int(rng.integers(3))
    if name == "dh_error":
        j = int(rng.integers(1, 3))  # rows whose angle and length no registration takes up
    if name in ("length_dependent_stiffness", "capstan_friction"):
        j = int(rng.integers(2))  # joints that carry a load worth the name
    kind, scene = kind_named(name), Scene(setting.history, setting.scene_noise, setting.spec.sessions)
    in_loop = kind.loop is not None or kind.force is not None
    return sized(setting, Hidden(name, j, kind.draw(rng, j, scene)), kind, GROWTH, in_loop=in_loop)[0]
