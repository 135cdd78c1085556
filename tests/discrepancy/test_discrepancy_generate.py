"""Blind cases: the logs hold what the labels say, and say nothing of it themselves."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from discrepancy_support import OFFSET_SPEC, nominal, written_spec

from gpcorrect.discrepancy.protocol.generate import (
    LABELS,
    drawn_effect,
    effect_to_noise,
    generate,
    label_of,
    noise_of,
    read_spec,
    seal,
)
from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.errors import DataError
from gpcorrect.sim.joint_motion import joint_motion_log


def test_the_hidden_effect_is_in_the_log(tmp_path: Path) -> None:
    """A planted offset shows in the outside sensor, and its label names it with its number."""
    (case,) = generate(read_spec(written_spec(tmp_path)))
    shift = np.median(case.log.external_jp - case.log.measured_jp, axis=0)
    np.testing.assert_allclose(shift, [0.0, -0.02], atol=1e-3)
    (effect,) = label_of(case, "hash")["effects"]
    assert (effect["name"], effect["joint"], effect["offset"]) == ("homing_offset", 2, 0.02)


def test_the_same_spec_gives_the_same_cases(tmp_path: Path) -> None:
    """Logs and labels depend on the spec alone; another seed gives other logs."""
    spec = written_spec(tmp_path)
    first, again = (next(iter(generate(read_spec(spec)))) for _ in range(2))
    assert first.log.external_jp is not None
    assert again.log.external_jp is not None
    np.testing.assert_array_equal(first.log.external_jp, again.log.external_jp)
    other = next(iter(generate(read_spec(written_spec(tmp_path, OFFSET_SPEC.replace("seed = 5", "seed = 6"))))))
    assert other.log.external_jp is not None
    assert not np.array_equal(first.log.external_jp, other.log.external_jp)


def test_drawn_effects_have_the_size_that_was_asked_for() -> None:
    """An effect drawn at a ratio changes the outside sensor by that many times its noise."""
    model = nominal()
    scout = joint_motion_log(model, 6, 6.0, seed=1)
    scene = build_scene(scout, model, np.ones(len(scout), dtype=np.bool_))
    for seed, name in enumerate(("backlash", "transmission_ratio", "homing_offset")):
        _, effect = drawn_effect(model, scout, 2.0, np.random.default_rng(seed), names=[name])
        assert effect.about.name == name
        assert effect_to_noise(scene, noise_of(model, scene), [effect]) == pytest.approx(2.0, rel=0.1)


def test_no_effect_can_be_sized_without_noise() -> None:
    """Sizes relative to the noise are refused when the model gives none."""
    bare = nominal().model_copy(update={"noise": None})
    with pytest.raises(DataError, match="need to know it"):
        drawn_effect(bare, joint_motion_log(bare, 4, 6.0), 1.0, np.random.default_rng(0))


def test_labels_are_sealed_apart(tmp_path: Path) -> None:
    """The labels lie in a folder of their own; beside the logs there is only their hash."""
    digest = seal({"cases": {}}, tmp_path)
    content = (tmp_path / LABELS / "labels.json").read_bytes()
    assert json.loads(content) == {"cases": {}}
    assert hashlib.sha256(content).hexdigest() == digest
    assert (tmp_path / "labels.sha256").read_text().split()[0] == digest


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("seed = 5", "sead = 5"), "sead"),
        (("trajectories = 15", "trajectories = 0"), "trajectories"),
        (("[[cases]]", "[[cases]]\nrepeat = 'x'"), "repeat"),
        (('"homing_offset"', '"humming_offset"'), "humming_offset"),
    ],
)
def test_a_wrong_spec_is_refused_by_name(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    """The message names the key or the effect that is wrong."""
    text = OFFSET_SPEC.replace(*change, 1)
    with pytest.raises(DataError, match=words):
        list(generate(read_spec(written_spec(tmp_path, text))))
