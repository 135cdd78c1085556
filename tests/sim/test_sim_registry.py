"""The registry of effects fills itself, and the documents say what it holds."""

import re
import sys
from dataclasses import fields
from pathlib import Path

import pytest

from gpcorrect.errors import DataError
from gpcorrect.sim import EFFECTS, effects
from gpcorrect.sim.effects.catalogue import find_effects

ROOT = Path(__file__).parents[2]
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
