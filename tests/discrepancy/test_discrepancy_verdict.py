"""When a difference is called unknown although no smooth model sees it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from discrepancy_support import outside

from gpcorrect.discrepancy.evidence.localise import Equivalence, Finding, Localisation
from gpcorrect.discrepancy.naming.posterior import Level, Named
from gpcorrect.discrepancy.outcome.result import ChannelGap, NamedEffect, PlaceVerdict
from gpcorrect.discrepancy.outcome.verdict import headline, is_plain, place_verdicts
from gpcorrect.discrepancy.recording.scene import Channel
from gpcorrect.discrepancy.search.candidates import Estimate
from gpcorrect.discrepancy.settings import SETTINGS

THRESHOLD = 10.0
A, B = outside(1), outside(2)


def localisation(nats: float, upper: float = 1.0, size: float = 0.5) -> Localisation:
    """One finding in channel A; B is quiet."""
    finding = Finding(A, (), nats, size)
    return Localisation((finding,), THRESHOLD, (Equivalence(A, upper), Equivalence(B, 0.1)))


def dropped(level: Level, nats: float) -> Named:
    fit: Any = None
    return Named(fit, level, 0.5, nats, (), ())


def test_a_finding_far_above_the_luckiest_test_is_plain() -> None:
    assert is_plain(localisation(SETTINGS.verdict.plain * THRESHOLD + 1), {A, B}, ())
    assert not is_plain(localisation(SETTINGS.verdict.plain * THRESHOLD - 1), {A, B}, ())


def test_it_must_be_in_one_of_the_channels_and_large_enough_to_matter() -> None:
    assert not is_plain(localisation(500.0), {B}, ())
    assert not is_plain(localisation(500.0, upper=0.2), {A, B}, ())


@pytest.mark.parametrize(("level", "plain"), [(Level.INCONCLUSIVE, False), (Level.UNKNOWN, True)])
def test_what_the_catalogue_says_half_of_is_not_plain(level: Level, plain: bool) -> None:
    """Unless what says it is but a part of something else."""
    half = SETTINGS.verdict.explained * 500.0
    assert is_plain(localisation(500.0), {A}, [dropped(level, half + 1.0)]) == plain
    assert is_plain(localisation(500.0), {A}, [dropped(level, half - 1.0)])


@pytest.mark.parametrize("level", [Level.NONE, Level.INCONCLUSIVE])
def test_a_headline_is_no_weaker_than_its_places(level: Level) -> None:
    """Where a joint is UNKNOWN so is the whole; a place that is not decided takes nothing from it."""
    gap = ChannelGap(2.0, 2.0, 1.0, (4.0, 4.0), (6.0, 6.0), 0.0, (0.0, 0.1), A, 1.0, 0.0)
    unknown, open_ = (PlaceVerdict(1, v, gap, 0.5, ()) for v in (Level.UNKNOWN, Level.INCONCLUSIVE))
    assert headline(level, (), (), [unknown, open_]) == Level.UNKNOWN
    assert headline(level, (), (), [open_]) == level


@pytest.mark.parametrize(("size", "level"), [(0.9, Level.EXACT), (1.1, Level.UNKNOWN)])
def test_what_is_plainly_left_at_a_joint_is_as_large_as_its_largest_finding(size: float, level: Level) -> None:
    """A name stands beside a rest that is smaller than the noise; the mean over a recording may hide a larger one."""
    effect = NamedEffect("coulomb_friction", 1, "reversal", Level.EXACT, 1.0, 9e3, {}, (), (), size=3.0)
    gap = ChannelGap(3.0, 1.2, 1.0, (6.0, 2.4), (9.0, 5.0), 0.95, (0.9, 1.0), A, 1.0, 0.0)
    (place,) = place_verdicts([effect], [gap], localisation(1600.0, size=size))
    assert (place.level, place.remaining) == (level, pytest.approx(size))
    assert headline(Level.EXACT, [effect], (), [place]) == level


@pytest.mark.parametrize(("step", "level"), [(1.8, Level.UNKNOWN), (2.4, Level.EXACT)])
def test_what_half_a_count_may_do_is_nothing_unknown(step: float, level: Level) -> None:
    """A controller that works with counts holds its motor half a count off; more than that is no rounding."""
    counts = {"step": Estimate(step, (step, step), "rad")}
    effect = NamedEffect("encoder_quantisation", 1, "noise", Level.EXACT, 1.0, 9e3, counts, (), ())
    gap = ChannelGap(1.0, 1.0, 1.0, (2.0, 2.0), (3.0, 3.0), 0.0, (0.0, 0.0), A, 1.0, 0.0)
    (place,) = place_verdicts([effect], [gap], localisation(1600.0, size=1.1))
    assert place.level == level
    slip = replace(effect, name="cable_slip", family="time")  # whose step is no count
    assert place_verdicts([slip], [gap], localisation(1600.0, size=1.1))[0].level == Level.UNKNOWN


def test_a_place_with_a_name_shows_the_channel_that_the_name_closes() -> None:
    """A table error of joint 2 was shown beside joint 2's own sensor, before as after."""
    effect = NamedEffect("dh_error", 2, "geometry", Level.EXACT, 1.0, 9e3, {}, (), (), size=3.0)
    same, closed = ((3.0, 3.0), (3.0, 1.0))
    quiet, tracker = (
        ChannelGap(before, after, noise, (6.0, 2.4), (9.0, 5.0), 0.95, (0.9, 1.0), channel, 1.0, 0.0)
        for (before, after), noise, channel in (
            (same, 2.9, B),
            (closed, 1.0, Channel("tracker_cp_x", "tracker_cp", 0, 0, "m")),
        )
    )
    shown = {place.place: place.gap for place in place_verdicts([effect], [quiet, tracker], localisation(0.0))}
    assert shown == {2: tracker, "tool": tracker}
    own = replace(quiet, after=1.0)
    shown = {place.place: place.gap for place in place_verdicts([effect], [own, tracker], localisation(0.0))}
    assert shown[2] == own
