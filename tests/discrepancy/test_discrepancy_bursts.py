"""Rare loud moments: neither nothing nor a name."""

from __future__ import annotations

import numpy as np
from discrepancy_core import NOISE, RUNS, SAMPLES, joint_log
from discrepancy_support import nominal

from gpcorrect.discrepancy.outcome.words import next_step, verdict_sentence
from gpcorrect.discrepancy.run import find_discrepancy


def test_a_rare_loud_moment_is_told_with_its_place() -> None:
    """One motion far above the noise is neither nothing nor a name: the report says where, how large, and when."""
    odd = np.zeros((SAMPLES, RUNS, 2))
    odd[40:60, 9, 1] = 60 * NOISE
    found = find_discrepancy(joint_log(5, more=odd), nominal())
    report = found.to_dict()
    assert found.level == "INCONCLUSIVE"
    assert not found.effects
    (burst,) = report["provenance"]["bursts"]
    assert burst["channel"] == "external_jp_2"
    assert burst["trajectories"] == [9]
    sentence = verdict_sentence(report)
    assert "outside sensor of joint 2" in sentence
    assert "trajectory 9" in sentence
    assert "like those" in next_step(report)


def test_noise_alone_has_no_bursts() -> None:
    """Nothing hidden, heavy tails: nothing rare is told."""
    assert find_discrepancy(joint_log(7, tail=4.0), nominal()).to_dict()["provenance"]["bursts"] == []
