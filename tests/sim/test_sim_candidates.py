"""The registry fills itself and is documented; what a search finds in it can be written, read back and simulated."""

import re
import sys
from collections import Counter
from dataclasses import fields

import numpy as np
import pytest
from support import ROOT

from gpcorrect.errors import DataError
from gpcorrect.sim import (
    effects,
    joint_motion_log,
    machine_of,
    model_from_dict,
    random_reaches_log,
    read_model,
    write_model,
)
from gpcorrect.sim.effects import EFFECTS, Per, Scope, Site, candidates
from gpcorrect.sim.effects.catalogue import find_effects
from gpcorrect.types import CalibrationLog

ARM = Scope((1, 2, 3), "RRP", np.array([[0.3, 1.2], [0.9, 2.0], [0.25, 0.45]]), 300.0)
BARE = Scope((4, 5, 6), "RRR", np.array([[-1.0, 1.0]] * 3), 300.0, kinematics=False)
FOUND = tuple(candidates(ARM))
SIGNALS = {*CalibrationLog.POSES, *CalibrationLog.JOINTS, *CalibrationLog.SCALARS}


def model(*effects):
    """Return three joints of an arm with these effects."""
    return model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "payload": 0.2, "effects": effects})


def test_every_effect_is_among_the_candidates():
    """The registry alone says what may be missing: all effects, each wherever it may sit."""
    assert {c.kind.about.name for c in FOUND} == set(EFFECTS)
    count = Counter(c.kind.about.name for c in FOUND if all(v in (0.0, np.inf) for v in c.shape.values()))
    assert count["homing_offset"] == 3
    assert count["cable_coupling"] == 6
    assert count["dh_error"] == 12  # of four places, in three forms
    assert count["coulomb_friction"] == 6
    assert {c.place["joint"] for c in FOUND if Site.TOOL in c.kind.about.sites and len(c.kind.about.sites) == 1} == {
        "tool"
    }


def test_no_two_candidates_are_the_same():
    keys = [(c.kind, *sorted(c.place.items()), *sorted(c.shape.items())) for c in FOUND]
    assert len(set(keys)) == len(keys)


def test_an_arm_without_kinematics_has_no_tool():
    """Bare joints offer nothing that only a pose or a mass could show, nor an insertion that they lack."""
    names = {c.kind.about.name for c in candidates(BARE)}
    absent = {"registration_error", "dh_error", "payload", "link_mass_error", "centre_of_mass_error", "gravity_error"}
    absent |= {"shaft_bending", "rcm_shift", "length_dependent_stiffness", "believed_payload"}
    assert names == set(EFFECTS) - absent


@pytest.mark.parametrize("kind", EFFECTS.values(), ids=EFFECTS)
def test_descriptions_tell_a_search_what_it_needs(kind):
    """Sites, needs and look-alikes are known; usual sizes and ladders lie in the range; what is named are fields."""
    about = kind.about
    names = {f.name for f in fields(kind)}
    assert about.sites
    assert about.needs
    assert {word for need in about.needs for word in need.split("|")} <= SIGNALS
    assert about.neighbours
    assert set(about.neighbours) <= set(EFFECTS) - {about.name}
    assert about.separating_runs
    assert {field for field, _ in about.choices} | {parameter.name for parameter in about.parameters} <= names
    assert about.parameters
    for parameter in about.parameters:
        assert parameter.shaped_by in {"", *names}
        for joint_type in "RP":
            scale = parameter.range(joint_type)
            assert scale.unit
            assert scale.low <= scale.typical <= scale.high
            if parameter.ladder is not None and parameter.ladder.per in (Per.VALUE, Per.PRIOR):
                unit = scale.typical if parameter.ladder.per is Per.PRIOR else 1.0
                for rung in parameter.ladder.rungs:
                    assert scale.low <= rung * unit <= scale.high or rung * unit == parameter.identity


def test_amplitudes_at_their_identity_leave_a_neutral_effect():
    """A candidate without amplitudes given is the effect that does nothing, if it has amplitudes at all."""
    for candidate in FOUND:
        if candidate.amplitudes:
            effect = candidate.effect()
            assert all(getattr(effect, p.name) == p.identity for p in candidate.amplitudes)


def test_a_drag_without_radius_is_no_candidate_of_its_own():
    """The linear coupling is searched with its coefficient alone; the drag comes in with a radius."""
    for candidate in FOUND:
        if candidate.kind.about.name == "cable_coupling":
            amplitudes = {p.name for p in candidate.amplitudes}
            assert amplitudes == ({"coefficient", "drag"} if candidate.shape["drag_radius"] else {"coefficient"})


@pytest.mark.parametrize("name", ["transmission_ratio", "cable_coupling"])
def test_a_joint_that_moves_evenly_about_zero_may_have_been_homed_elsewhere(name):
    """The middle of its range is where a home is by default; the shape with a home is a candidate all the same."""
    homes = {c.shape["home"] == 0.0 for c in candidates(BARE) if c.kind.about.name == name}
    assert homes == {True, False}


def test_every_candidate_survives_the_model_file(tmp_path):
    """Written to a model file and read back, each effect in each place and shape is the same, and fits the machine."""
    effects = [candidate.typical() for candidate in FOUND]
    whole = model().with_effects(*effects)
    write_model(whole, tmp_path / "model.toml")
    again = read_model(tmp_path / "model.toml")
    assert again.effects == whole.effects
    assert again == whole
    assert len(machine_of(again).effects) == len(effects)


@pytest.mark.parametrize(
    "candidate", list({c.kind.about.name: c for c in reversed(FOUND)}.values()), ids=lambda c: c.kind.about.name
)
def test_every_effect_can_be_simulated(candidate):
    """Each effect gives a recording without missing numbers, on three joints, and on all six with a tracker."""
    log = joint_motion_log(model(candidate.typical()), trajectories=2, seconds=1.0)
    for name in log.signals:
        signal = getattr(log, name)
        assert np.isfinite(signal.position if name.endswith("_cp") else signal).all()
    if candidate.kind.about.name in ("link_mass_error", "centre_of_mass_error"):
        return  # the dVRK's links weigh nothing in the model
    six = model_from_dict({"arm": "dvrk_psm", "joints": [1, 2, 3, 4, 5, 6], "effects": [candidate.typical()]})
    assert np.isfinite(random_reaches_log(n_trajectories=1, model=six, faults=False).tracker_cp.position).all()


@pytest.mark.parametrize("name", ["dh_error", "payload", "shaft_bending", "rcm_shift", "registration_error"])
def test_what_needs_an_arm_is_refused_on_bare_joints(name):
    """A model file that puts a tool's effect on joints without a tool is told so."""
    effect = next(c for c in FOUND if c.kind.about.name == name).typical()
    bare = model_from_dict({"arm": "joints", "joints": [1, 2, 3], "effects": [effect]})
    with pytest.raises(DataError, match=f"{name} needs an arm"):
        machine_of(bare)


def test_limits_of_torque_are_tried_just_below_what_the_controller_asks_for():
    """A limit far above the largest torque changes nothing, one far below it everything: rungs are shares of it."""
    asked = Scope((1, 2), "RR", np.array([[0.3, 1.2], [0.9, 2.0]]), 300.0, torques=np.array([1.7, 40.0]))
    limits = {1: [], 2: []}
    for candidate in candidates(asked):
        if candidate.kind.about.name == "torque_saturation":
            limits[candidate.place["joint"]].append(candidate.shape["limit"])
    for joint, largest in ((1, 1.7), (2, 40.0)):
        assert 0.9 * largest < max(limits[joint]) < largest
        assert min(limits[joint]) > 0.2 * largest


NEW = """
from dataclasses import dataclass, replace

from gpcorrect.sim.effects.base import JointEffect, Stage
from gpcorrect.sim.effects.reversal import Backlash


@dataclass(frozen=True)
class LooseScrew(JointEffect):
    radius: float
    stage = Stage.JOINT
    about = replace(Backlash.about, name="loose_screw", number=99)

    def _behind(self, q, j, motion, memory):
        return q[..., j] + self.radius
"""


def test_a_file_dropped_in_is_an_effect(monkeypatch, tmp_path):
    """A new file among the effects appears in the registry, in its place, and nothing else need be touched."""
    (tmp_path / "loose_screw.py").write_text(NEW)
    monkeypatch.setattr(effects, "__path__", [*effects.__path__, str(tmp_path)])
    try:
        found = find_effects()
    finally:
        sys.modules.pop("gpcorrect.sim.effects.loose_screw", None)
    assert list(found) == [*EFFECTS, "loose_screw"]
    assert found["loose_screw"](2, 0.1).to_dict() == {"name": "loose_screw", "joint": 2, "radius": 0.1}


def test_the_effects_of_a_family_share_a_file():
    """Each family of effects has one file, and no file two; name and class say the same, and the package has all."""
    families = {(kind.about.family, kind.__module__) for kind in EFFECTS.values()}
    assert len(families) == len(dict(families)) == len({module for _, module in families})
    for name, kind in EFFECTS.items():
        assert kind.__name__ == name.title().replace("_", "")
        assert getattr(effects, kind.__name__) is kind


def test_numbers_of_the_catalogue_are_its_order():
    """Each effect has a number of its own, and so the order in which effects act does not depend on file names."""
    numbers = [kind.about.number for kind in EFFECTS.values()]
    assert numbers == sorted(set(numbers))


def test_the_table_of_the_documentation_is_the_registry():
    """The manual's table lists every effect in order, with every parameter by name, and counts them rightly."""
    text = (ROOT / "docs/simulator.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \| [\w, ]+ \| (.*?) \| .*\|$", text, flags=re.MULTILINE))
    assert list(rows) == list(EFFECTS)
    for name, kind in EFFECTS.items():
        assert set(re.findall(r"`(\w+)`", rows[name])) == {f.name for f in fields(kind)} - {"joint"}
    assert f"All {len(EFFECTS)} effects" in text
    assert f"{len(EFFECTS)} effects" in (ROOT / "README.md").read_text()


def test_an_unknown_name_is_answered_with_the_known_ones():
    """The message of a misspelt name lists the registry."""
    with pytest.raises(DataError) as refused:
        effects.effect_from_dict({"name": "cable_strech", "joint": 1})
    assert all(name in str(refused.value) + str(refused.value.hint) for name in EFFECTS)
