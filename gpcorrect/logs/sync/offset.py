"""What is known of a time offset: a value with its interval, or why there is none."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from gpcorrect.types import FloatArray, IntArray

Verdict = Literal["found", "too_few", "still", "steady", "unrelated", "edge", "ambiguous", "imprecise"]


@dataclass(frozen=True)
class ClockDrift:
    """How the offset changes: one clock runs fast.

    Parameters
    ----------
    ppm : float, parts in a million that the observer's clock runs fast against the reference's
    ci95 : (float, float), 95 % confidence interval, ppm
    epoch : float, observer's time at which the offset is quoted, s
    """

    ppm: float
    ci95: tuple[float, float]
    epoch: float


@dataclass(frozen=True, eq=False)
class TimeOffset:
    """Seconds d by which the observer's stamps run ahead: observed(t + d) shows what reference(t) shows.

    Parameters
    ----------
    offset : float, s; the best guess when ambiguous, NaN when there is none
    ci95 : (float, float), 95 % confidence interval, s; NaN when there is none
    verdict : str
        "found", or what stands in the way: "too_few" samples in common, a "still" or "steady" reference,
        "unrelated" motions, an offset at the "edge" of the search or beyond it, an "ambiguous" (repeating)
        motion, an "imprecise" answer.
    reason : str, the same in words; empty when found
    lags, correlation : (m,) arrays, pooled correlation of the speeds, for a plot; empty when nothing could be compared
    rivals : tuple of float, other offsets that explain the recording as well, s
    drift : ClockDrift or None, only where it is significant
    trajectories : (k,) int array, numbers of the trajectories compared
    per_trajectory : (k,) array, offset of each of them by itself, s; NaN where it says nothing
    explained : float, share of the observed spread that the shifted reference explains; NaN when there is no offset
    samples : int, observed samples compared
    observed, reference : str, names of the signals
    """

    offset: float
    ci95: tuple[float, float]
    verdict: Verdict
    reason: str
    lags: FloatArray
    correlation: FloatArray
    rivals: tuple[float, ...] = ()
    drift: ClockDrift | None = None
    trajectories: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    per_trajectory: FloatArray = field(default_factory=lambda: np.empty(0))
    explained: float = float("nan")
    samples: int = 0
    observed: str = ""
    reference: str = ""

    @property
    def observable(self) -> bool:
        """Whether the motion determines the offset."""
        return self.verdict == "found"

    def at(self, time: FloatArray) -> FloatArray:
        """Offset `(n,)`, s: constant unless there is a drift.

        Parameters
        ----------
        time : (n,) array, by the observer's clock, s
        """
        rate, epoch = (0.0, 0.0) if self.drift is None else (1e-6 * self.drift.ppm, self.drift.epoch)
        return self.offset + rate * (np.asarray(time, dtype=np.float64) - epoch)

    def to_dict(self) -> dict[str, Any]:
        """JSON-able summary without the curve; what is not known is None."""
        known = bool(np.isfinite(self.offset))
        drift = self.drift and {"ppm": self.drift.ppm, "ci95": list(self.drift.ci95), "epoch": self.drift.epoch}
        return {
            "observed": self.observed,
            "reference": self.reference,
            "offset_s": self.offset if known else None,
            "ci95_s": list(self.ci95) if np.isfinite(self.ci95).all() else None,
            "observable": self.observable,
            "verdict": self.verdict,
            "reason": self.reason,
            "rivals_s": list(self.rivals),
            "drift": drift,
            "explained": self.explained if np.isfinite(self.explained) else None,
            "samples": self.samples,
        }
