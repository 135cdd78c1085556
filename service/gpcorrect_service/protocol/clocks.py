"""How old a message is by this machine's monotonic clock, though its stamp is of another one."""

from __future__ import annotations

OLDEST = 0.25
"""s: nothing older moves a robot. Chosen by hand: a person reacts in 0.2 s, and a tool at 5 cm/s goes 12 mm."""
DRIFT = 1e-3  # of a clock against ours: ten times what cheap quartz does, so that a backlog is not believed soon
STEP = 1.0  # chosen by hand: s by which stamps lie behind, for as long, before they are taken for those of a set clock


class StreamClock:
    """Another machine's clock, as the stamps and arrivals of its messages show it.

    The message that was quickest on its way says how far the two clocks are apart; what took longer was held up: in a
    process that was stopped, a router, a network. Where the two clocks were set to plays no part.

    Parameters
    ----------
    rate : float, seconds of that clock in one of ours: above 1 for a simulated arm that lives faster
    """

    def __init__(self, rate: float = 1.0) -> None:
        self._rate = rate
        self.reset()

    def reset(self) -> None:
        """Forget the clock: the next message is taken to be quick."""
        self._apart: float | None = None
        self._newest, self._at = 0.0, 0.0
        self._behind_since: float | None = None

    def delay(self, stamp: float, now: float) -> float:
        """Take note of a message; return how much longer it was on its way than the quickest one, s.

        Parameters
        ----------
        stamp, now : float, s of its clock; s of ours, when it came
        """
        apart = now - stamp / self._rate
        if self._apart is None or self._was_set(stamp, now):
            self._apart, self._newest, self._behind_since = apart, stamp, None
        else:
            self._apart = min(self._apart + DRIFT * (now - self._at), apart)
            self._newest = max(stamp, self._newest)
        self._at = now
        return apart - self._apart

    def age(self, stamp: float, now: float) -> float:
        """Return how long ago that clock showed a stamp, s of ours; below 0 where it does not yet show it.

        Parameters
        ----------
        stamp, now : float, as for :meth:`delay`
        """
        return 0.0 if self._apart is None else now - stamp / self._rate - self._apart

    def _was_set(self, stamp: float, now: float) -> bool:
        """Whether stamps have been far behind for so long that the clock was set back, and not its messages held up."""
        if stamp >= self._newest - STEP * self._rate:
            self._behind_since = None
            return False
        if self._behind_since is None:
            self._behind_since = now
        return now - self._behind_since > STEP
