"""When a difference is called unknown although no smooth model sees it."""

from __future__ import annotations

from typing import Any

import pytest

from gpcorrect.discrepancy.evidence.localise import Equivalence, Finding, Localisation
from gpcorrect.discrepancy.naming.named import EffectLevel, Named
from gpcorrect.discrepancy.outcome.verdict import PLAIN, SAID, is_plain

THRESHOLD = 10.0


def localisation(nats: float, upper: float = 1.0) -> Localisation:
    """One finding in channel "a"; "b" is quiet."""
    finding = Finding("a", ("position 1",), (), nats, 0.5)
    return Localisation((finding,), THRESHOLD, nats, (Equivalence("a", upper, 0.25), Equivalence("b", 0.1, 0.25)))


def dropped(level: EffectLevel, nats: float) -> Named:
    member: Any = None
    return Named(member, level, 0.5, nats, (), ())


def test_a_finding_far_above_the_luckiest_test_is_plain() -> None:
    assert is_plain(localisation(PLAIN * THRESHOLD + 1), {"a", "b"}, ())
    assert not is_plain(localisation(PLAIN * THRESHOLD - 1), {"a", "b"}, ())


def test_it_must_be_in_one_of_the_channels_and_large_enough_to_matter() -> None:
    assert not is_plain(localisation(500.0), {"b"}, ())
    assert not is_plain(localisation(500.0, upper=0.2), {"a", "b"}, ())


@pytest.mark.parametrize(("level", "plain"), [("INCONCLUSIVE", False), ("UNKNOWN", True)])
def test_what_the_catalogue_says_half_of_is_not_plain(level: EffectLevel, plain: bool) -> None:
    """Unless what says it is but a part of something else."""
    half = SAID * 500.0
    assert is_plain(localisation(500.0), {"a"}, [dropped(level, half + 1.0)]) == plain
    assert is_plain(localisation(500.0), {"a"}, [dropped(level, half - 1.0)])
