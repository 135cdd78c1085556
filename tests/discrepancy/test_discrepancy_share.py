"""What an effect must close of the gap."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from discrepancy_core import NOISE, RUNS, SAMPLES, joint_log, motors
from discrepancy_support import nominal

from gpcorrect.discrepancy.naming.share import LEAST_SHARE, share_closed
from gpcorrect.discrepancy.search.candidates import Member, all_candidates
from gpcorrect.discrepancy.search.laid import lay_out
from gpcorrect.discrepancy.search.state import Search, start_search
from gpcorrect.sim.effects import HomingOffset
from gpcorrect.types import CalibrationLog


def _with_offset(log: CalibrationLog, offset: float) -> tuple[Search, Member]:
    bench = lay_out(log, nominal(), 9000, np.random.default_rng(0)).bench
    candidate = next(c for c in all_candidates(bench.scene) if c.name == "homing_offset" and c.joint == 1)
    member = Member(candidate, np.array([candidate.coordinates[0].coordinate(offset)]))
    state = start_search(bench, [candidate])
    loud = tuple(replace(n, white=NOISE, slow=0.0) for n in state.lens.noises)
    return replace(state, members=(member,), lens=replace(state.lens, noises=loud)), member


def test_the_right_effect_closes_the_gap_and_a_small_part_of_something_else_does_not() -> None:
    """An offset that is there closes all; a twentieth of a large step in its place leaves nearly all."""
    assert share_closed(*_with_offset(joint_log(2, HomingOffset(joint=1, offset=20 * NOISE)), 20 * NOISE)) == 1.0
    step = np.zeros((SAMPLES, RUNS, 2))
    step[..., 0] = 20 * NOISE * np.sign(motors(np.random.default_rng(2))[1][..., 0])
    assert share_closed(*_with_offset(joint_log(2, more=step), NOISE)) < LEAST_SHARE
