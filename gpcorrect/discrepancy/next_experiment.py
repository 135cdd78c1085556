"""What to record next: the run that the two leaders' descriptions say separates them, with the evidence it should bring."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpcorrect.discrepancy.candidates import Candidate, Member
from gpcorrect.discrepancy.name import Named
from gpcorrect.discrepancy.noise import ChannelNoise
from gpcorrect.discrepancy.result import Experiment
from gpcorrect.discrepancy.scene import Scene
from gpcorrect.sim.effects import EFFECTS, Run

__all__ = ["advise"]


def advise(
    scene: Scene, members: Sequence[Member], named: Sequence[Named], noises: Sequence[ChannelNoise], seed: int
) -> Experiment | None:
    return None
