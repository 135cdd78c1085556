"""Where a report comes from: data hashes, seed, versions, thresholds, and what had to be assumed."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
import scipy

from gpcorrect.discrepancy.evidence.bursts import bursts_of
from gpcorrect.discrepancy.evidence.localise import Localisation
from gpcorrect.discrepancy.evidence.tolerated import tolerated
from gpcorrect.discrepancy.naming.named import EXACT, STABLE
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.recording.stated import GIVEN, LOUDER_WORDS
from gpcorrect.discrepancy.search.laid import Laid
from gpcorrect.discrepancy.search.needs import Lack, left_silent, limits_of
from gpcorrect.discrepancy.search.state import Search, penalty
from gpcorrect.types import CalibrationLog

__all__ = ["provenance_of"]


def provenance_of(
    log: CalibrationLog,
    seed: int,
    data: Laid,
    state: Search,
    before: Localisation,
    lacks: Sequence[Lack],
    seconds: float,
) -> dict[str, Any]:
    """Return the provenance table of a report."""
    bench = data.bench
    return {
        "data": [{"name": log.name, "sha256": log.digest, "rows": len(log)}],
        "seed": seed,
        "versions": {
            "gpcorrect": version("gpcorrect"),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "thresholds": {
            "localisation_nats": before.threshold,
            "effect_nats": penalty(max(state.n_kinds, 1)),
            "exact_probability": EXACT,
            "rival_probability": STABLE,
        },
        "seconds": seconds,
        "noise": {
            c.name: {
                "white": n.white,
                "slow": n.slow,
                "time_constant": n.time_constant,
                "tail": n.tail,
                "basis": n.basis,
            }
            for c, n in zip(bench.scene.channels, state.lens.noises, strict=True)
        },
        "tolerated": tolerated(bench, state.lens.noises),
        "bursts": [] if state.members else [b.to_dict() for b in bursts_of(bench, state.lens.noises)],
        "remarks": [*data.remarks, *_model_remarks(bench.scene), *limits_of(bench.scene), _noise_remark(state)],
        "no_trace": list(state.silent),
        "not_nameable": [{"effect": k.effect, "why": k.why} for k in (*lacks, *_silent(state))],
    }


def _silent(state: Search) -> tuple[Lack, ...]:
    return left_silent(state.silent, [t.candidate.name for t in state.traces], state.bench.scene)


def _noise_remark(state: Search) -> str:
    """Return whether the noise was given or estimated."""
    given = [n.basis.startswith(GIVEN) for n in state.lens.noises]
    louder = [
        c.name for c, n in zip(state.bench.scene.channels, state.lens.noises, strict=True) if LOUDER_WORDS in n.basis
    ]
    if all(given):
        return "noise: as [noise] of the model file gives it, tails from the recording"
    if louder:
        return f"noise: the recording is clearly louder than [noise] says in {', '.join(louder)}; there it is estimated"
    said = "as [noise] gives it where it does, else " if any(given) else ""
    return f"noise: {said}estimated from the recording"


def _model_remarks(scene: Scene) -> list[str]:
    model = scene.model
    absent = [
        name for name in ("controller", "transmission", "links", "T_tracker_base") if getattr(model, name) is None
    ]
    if not absent:
        return []
    return [f"absent from the model file, taken from the arm's description or from the data: {', '.join(absent)}"]
