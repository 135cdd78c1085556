"""Hidden causes have the size that is asked for, cases repeat, and labels stay sealed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from truth import CATALOGUE, OUTSIDE, SUITES, Spec, labels_bytes, make_case, open_labels, specs, write_case
from truth.case import make_truth
from truth.operators import Relays, dead_zone_drag, kelvin_voigt, preisach
from truth.suites import RATIOS

from gpcorrect.logs import read_log
from gpcorrect.sim import read_model

SMALL = {"trajectories": 3, "seconds": 4.0}
MISSED = 0.03  # of the noise as drawn about its own deviation


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.nanmean(values**2, axis=0))


@pytest.mark.parametrize(
    ("name", "ratio"),
    [
        ("backlash", 2.0),
        ("cable_stretch", 0.5),
        ("shaft_bending", 0.25),
        ("noise_change", 1.0),
        ("crossed_friction", 2.0),
    ],
)
def test_a_hidden_cause_has_the_asked_size(name: str, ratio: float) -> None:
    """The trace's RMS over the noise's RMS is the ratio, by the labels, which are measured on the whole run."""
    kind = (CATALOGUE | OUTSIDE)[name]
    case = make_case(Spec("one", (name,), ratio, "tracker" if kind.tracker_only else "joints", **SMALL), 5)
    (effect,) = case.labels["effects"]
    assert effect["name"] == name
    assert effect["ratio"] == pytest.approx(ratio, rel=MISSED)


def test_the_size_shows_in_the_recording() -> None:
    """An offset on a joint moves the outside sensor by ratio times noise against the motor side."""
    case = make_case(Spec("one", ("homing_offset",), 2.0, **SMALL), 8)
    (effect,) = case.labels["effects"]
    j = effect["joint"] - 1
    shift = np.nanmedian((case.log.measured_jp - case.log.external_jp)[:, j])
    assert shift == pytest.approx(effect["params"]["offset"], rel=0.1)
    assert abs(shift) == pytest.approx(2.0 * case.labels["nuisance"]["noise_rms"][j], rel=0.15)


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    """Wish and seed fix the recording, the model and the labels; another seed changes them."""
    spec = Spec("pairs", ("backlash", "drift"), 1.0, **SMALL)
    contents = []
    for number, seed in enumerate((21, 21, 22)):
        write_case(make_case(spec, seed), tmp_path / str(number), tmp_path / "sealed" / str(number))
        contents.append(
            [(tmp_path / str(number) / n).read_bytes() for n in ("log.csv", "nominal.toml", "labels.sha256")]
        )
    assert contents[0] == contents[1]
    assert all(a != b for a, b in zip(contents[0], contents[2], strict=True))


def test_sealed_labels_open_unchanged_only(tmp_path: Path) -> None:
    """Labels that were altered after sealing are refused."""
    case = make_case(Spec("one", ("drift",), 1.0, **SMALL), 3)
    sealed = tmp_path / "sealed.json"
    write_case(case, tmp_path / "case", sealed)
    assert labels_bytes(open_labels(tmp_path / "case", sealed)) == labels_bytes(case.labels)
    sealed.write_bytes(sealed.read_bytes().replace(b"drift", b"creep"))
    with pytest.raises(ValueError, match="not those sealed"):
        open_labels(tmp_path / "case", sealed)


@pytest.mark.parametrize("signals", ["joints", "tracker", "bare"])
def test_files_are_the_products_own(signals: str, tmp_path: Path) -> None:
    """The recording and the nominal model are read by the product without a complaint."""
    case = make_case(Spec("null", signals=signals, trajectories=2, seconds=5.0), 2)
    write_case(case, tmp_path, tmp_path / "sealed.json")
    assert read_model(tmp_path / "nominal.toml").joints == (1, 2, 3)
    assert read_log(tmp_path / "log.csv").signals == case.log.signals


def test_catalogue_and_outside_are_whole() -> None:
    """All 29 names of the catalogue, at least 12 outside it, none of them in both, every one with a law."""
    assert len(CATALOGUE) == 29
    assert len(OUTSIDE) >= 12
    assert not set(CATALOGUE) & set(OUTSIDE)
    for kind in (CATALOGUE | OUTSIDE).values():
        assert any((kind.loop, kind.path, kind.tip, kind.read, kind.force))


def test_suites_say_the_same_of_a_seed_and_reach_every_cause() -> None:
    """A seed means one wish, whoever asks; consecutive seeds visit every name and size."""
    for suite in SUITES:
        assert list(specs(suite, 5, 100)) == list(specs(suite, 7, 98))[2:]
    ones = {(s.hidden[0], s.ratio) for s, _ in specs("one", 29 * 4, 0)}
    assert ones == {(n, r) for n in CATALOGUE for r in RATIOS}
    assert {s.hidden[0] for s, _ in specs("outside", len(OUTSIDE), 0)} == set(OUTSIDE)
    assert all(not s.hidden for suite in ("null", "null_awkward") for s, _ in specs(suite, 20, 0))


def test_backlash_keeps_between_the_edges_of_its_gap() -> None:
    """The driven element is never farther from the driver than the gap and the contact's compression."""
    path = np.cumsum(np.random.default_rng(0).standard_normal(2000)) * 1e-4
    place = dead_zone_drag(path, 1e-3, 2e-3)
    assert np.abs(path - place).max() < 1.1e-3
    assert np.ptp(dead_zone_drag(1e-4 * np.sin(np.arange(500)), 1e-3, 2e-3)) == 0.0


def test_hysteresis_is_bounded_and_does_not_know_the_speed() -> None:
    """Lag within depth times width; the same path at half speed gives the same lag."""
    path, relays = 0.3 * np.sin(np.linspace(0, 12, 4000)), Relays(0.4, 0.05, 2.0, 1.5, 0.7, 0.1, 0.2)
    lag = preisach(path, relays)
    assert np.abs(lag).max() <= 0.4 * 0.05 * 1.02
    np.testing.assert_allclose(preisach(np.repeat(path, 2), relays)[::2], lag)


def test_loops_of_hysteresis_are_wider_where_relays_crowd() -> None:
    """Minor loops of one size differ with their place: the operator is no sum of plays."""
    relays = Relays(0.5, 0.02, 2.0, 1.5, 0.9, 0.3, 0.1)
    small = 0.02 * np.sin(np.linspace(0, 20, 4000))
    there, elsewhere = (np.ptp(preisach(place + small, relays)[2000:]) for place in (0.3, -0.3))
    assert there > 1.5 * elsewhere


def test_creep_settles_at_gain_times_load() -> None:
    """A held load creeps to its limit with one time constant, whatever the steps."""
    time = np.sort(np.random.default_rng(1).uniform(0, 50, 400))
    load = np.r_[0.0, np.full(399, 2.0)]
    strain = kelvin_voigt(time, load, 1e-3, 4.0)
    np.testing.assert_allclose(strain[1:], 2e-3 * (1 - np.exp(-(time[1:] - time[1]) / 4.0)), atol=1e-12)


def test_memory_goes_on_through_a_break_and_a_slip_does_not() -> None:
    """Between two sessions a creeping cable rests with its load, and a homing takes a slip away."""
    for name in ("creep", "cable_slip"):
        truth = make_truth(Spec("one", (name,), 1.0, sessions=2, trajectories=4, seconds=5.0), 2)
        (label,) = truth.case.labels["effects"]
        reference, j = truth.setting.reference, label["joint"] - 1
        trace = (truth.readings.outside - truth.setting.readings.outside)[:, j]
        if name == "creep":
            assert np.abs(trace).max() < 10 * truth.case.labels["nuisance"]["noise_rms"][j]
        else:
            other = reference.session != label["params"]["session"]
            assert np.abs(trace[other]).max() < 0.05 * abs(label["params"]["step"])
