"""Does the correction still hold? A sequential test on where the tracker sees the tool.

While the model holds, the squared miss in units of its standard deviations, summed over the axes that it knows, lies
below the 95 % point of chi-square at least 95 times in a hundred. Neighbouring samples err together, so each second
casts one vote: was the tool outside for most of it? Each vote is turned into an e-value, the likelihood of "outside
60 % of the time" over "outside 10 % of the time", and these are accumulated as in CUSUM, `C = max(C, 1) e`; as long as
at most every tenth vote says "outside", an alarm at `C >= A` comes once in A votes or more seldom (e-detectors: Shin,
Ramdas and Rinaldo 2024, Sec. 2).

An alarm says that the tool is not where the model says it is: the arm has changed, or it is moved as it never was when
the model was learned. Which of the two, `gpcorrect drift` can tell from a recording.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

CHI_SQUARE_95 = {1: 3.841, 2: 5.991, 3: 7.815, 4: 9.488, 5: 11.070, 6: 12.592}  # 95 % points by degrees of freedom
NORMAL_95 = 1.96  # half width of a 95 % interval in standard deviations


@dataclass(frozen=True)
class DriftSettings:
    """What decides an alarm; chosen by hand, each for the reason given."""

    # fraction of votes for "outside" while the model holds (twice the 5 % of honest intervals), and when it does not
    usual: float = 0.1
    changed: float = 0.6
    vote_seconds: float = 1.0  # s of one vote: longer than neighbouring samples err together
    fewest: int = 5  # samples that a vote needs
    threshold: float = 1e5  # evidence of an alarm, and votes between false ones at least: more than a day of work


SETTINGS = DriftSettings()


def outside(miss: Sequence[float], interval95: Sequence[float | None]) -> bool:
    """Tell whether a miss is larger than 95 % of those that its intervals cover.

    Parameters
    ----------
    miss : (6,) sequence, m and rad
    interval95 : (6,) sequence, half widths; None is not known
    """
    known = [(m, w) for m, w in zip(miss, interval95, strict=True) if w is not None and w > 0]
    if not known:
        return False
    return sum((NORMAL_95 * m / w) ** 2 for m, w in known) > CHI_SQUARE_95[len(known)]


@dataclass
class DriftWatch:
    """Evidence so far that the arm no longer is the one that was learned; another model begins a new one."""

    evidence: float = 1.0  # C above; 1 and less is none
    alarm: bool = False  # whether it ever reached the threshold since the model was loaded
    votes: int = 0  # how many there were, each of `vote_seconds` at least
    _begin: float | None = None
    _samples: list[bool] = field(default_factory=list)

    @property
    def state(self) -> dict[str, float | bool | int]:
        """What a page shows."""
        return {"evidence": self.evidence, "threshold": SETTINGS.threshold, "alarm": self.alarm, "votes": self.votes}

    def see(self, stamp: float, outside: bool) -> None:
        """Take note of one sample.

        Parameters
        ----------
        stamp : float, s
        outside : bool
        """
        if self._begin is None or stamp < self._begin:
            self._begin, self._samples = stamp, []
        if stamp - self._begin >= SETTINGS.vote_seconds:
            if len(self._samples) >= SETTINGS.fewest:
                self._vote(sum(self._samples) > len(self._samples) / 2)
            self._begin, self._samples = stamp, []
        self._samples.append(outside)

    def _vote(self, outside: bool) -> None:
        usual, changed = SETTINGS.usual, SETTINGS.changed
        e = changed / usual if outside else (1.0 - changed) / (1.0 - usual)
        self.evidence = max(self.evidence, 1.0) * e
        self.votes += 1
        self.alarm = self.alarm or self.evidence >= SETTINGS.threshold
