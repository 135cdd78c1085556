"""Whether a periodic effect stands alone: another cause of the same period would show its overtones too."""

from __future__ import annotations

import numpy as np

from gpcorrect.discrepancy.naming.weigh import View, smooth_nats
from gpcorrect.discrepancy.search.candidates import Member

__all__ = ["MOST_OVERTONES", "overtone_nats"]

MOST_OVERTONES = 0.25  # of its own nats: then it is a part of something else


def overtone_nats(view: View, member: Member) -> float:
    """Nats that a member's overtones gain beside the set; 0 for effects that have none."""
    effects = member.effect.overtones()
    if not effects:
        return 0.0
    bench = view.search.bench
    columns = np.stack([bench.predict([e]) - bench.predict() for e in effects], axis=2)
    return smooth_nats(view, view.search.members, view.search.touched(member.candidate), columns)
