"""The workflow whole: nothing in noise, the true name where one is hidden, no name for what the catalogue lacks."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from discrepancy.discrepancy_core import joint_log, motors
from discrepancy.discrepancy_support import nominal

from gpcorrect.discrepancy import DiscrepancyResult, Level, find_discrepancy
from gpcorrect.errors import DataError, LogError
from gpcorrect.report import write_discrepancy_report
from gpcorrect.sim.effects import Backlash, CableCoupling, Effect, HomingOffset, TransmissionRatio, play
from gpcorrect.types import FloatArray

SCHEMA = json.loads(files("gpcorrect.discrepancy.outcome").joinpath("report.schema.json").read_text())


def names(found: DiscrepancyResult) -> set[tuple[str, int | str]]:
    return {(e.name, e.joint) for e in found.effects}


@pytest.mark.parametrize(("tail", "sessions"), [(np.inf, 1), (3.0, 1), (np.inf, 4)])
@pytest.mark.parametrize("seed", [1, 2])
def test_noise_gets_no_name(tail: float, sessions: int, seed: int) -> None:
    """White noise with slow noise beside it, heavy tails or several sessions: no effect is named."""
    found = find_discrepancy(nominal(), joint_log(seed, tail=tail, sessions=sessions), seed=seed)
    assert found.level in (Level.NONE, Level.INCONCLUSIVE)
    assert not found.effects


@pytest.mark.parametrize("silent", [(1,), (0, 1)])
def test_a_sensor_that_says_nothing_shows_nothing(silent: tuple[int, ...], tmp_path: Path) -> None:
    """A column without a number is no proof that its joint is right: "nothing is missing" was said of it."""
    log = joint_log(1)
    seen = np.array(log.external_jp)
    seen[:, silent] = np.nan
    found = find_discrepancy(nominal(), replace(log, external_jp=seen), seed=1)
    assert found.level == Level.INCONCLUSIVE
    levels = {place.place: place.level for place in found.verdict.places}
    assert [levels[j + 1] for j in silent] == [Level.INCONCLUSIVE] * len(silent)
    write_discrepancy_report(found, tmp_path / "report.html")
    jsonschema.validate(json.loads(json.dumps(found.to_report(), allow_nan=False)), SCHEMA)


@pytest.mark.parametrize(
    "hidden",
    [
        HomingOffset(2, 0.003),
        HomingOffset(1, -np.pi / 2),  # a zero by another convention
        TransmissionRatio(1, 0.013),
        CableCoupling(2, source=1, coefficient=-0.011),
        Backlash(1, 0.0037),
        TransmissionRatio(1, 0.013, home=0.5),
        TransmissionRatio(2, 1.0),  # a gear entered twice
        TransmissionRatio(2, -0.5),
        CableCoupling(2, source=1, coefficient=-0.011, home=-0.7),
    ],
)
def test_the_hidden_effect_is_named_with_its_number(hidden: Effect) -> None:
    """One effect, most about as large as the noise: its name, its joint and a number near the truth; the gap closes."""
    found = find_discrepancy(nominal(), joint_log(3, hidden))
    assert names(found) == {(hidden.about.name, hidden.joint)}
    parameter = hidden.about.parameters[0].name
    value = found.effects[0].parameters[parameter].value
    assert value == pytest.approx(getattr(hidden, parameter), rel=0.15)
    assert found.gap[int(hidden.joint) - 1].closed > 0.8


def test_no_size_stands_beside_an_interval_that_holds_zero(tmp_path: Path) -> None:
    """Of an EXACT offset in the second of two sessions, that of the first is a bound, on page and in headline."""
    found = find_discrepancy(nominal(), joint_log(4, HomingOffset(2, (0.0, 0.004)), sessions=2), seed=1)
    write_discrepancy_report(found, tmp_path / "page.html")
    (effect,) = found.to_report()["verdict"]["effects"]
    (low, high), second = effect["parameters"]["offset"]["ci95"]
    assert effect["level"] == "EXACT"
    assert low < 0.0 < high < second[0] < 0.004 < second[1]
    page = (tmp_path / "page.html").read_text()
    intervals = re.findall(r"\((-?[\d.]+) to (-?[\d.]+)\)", page)
    assert len(intervals) >= 2  # in the headline, and in the table
    assert all(float(first) * float(last) > 0.0 for first, last in intervals)
    assert page.count(f"below {max(-low, high) * 180.0 / np.pi:.4f}°; 0.2") >= 2


def test_a_hysteresis_of_another_kind_is_no_play() -> None:
    """A sum of plays of far apart widths is never one play, by that name alone."""
    _, q = motors(np.random.default_rng(9))
    more = np.zeros(q.shape)
    more[..., 0] = 0.06 * (0.75 * play(q[..., 0], 0.02) + 0.25 * play(q[..., 0], 0.3) - q[..., 0])
    found = find_discrepancy(nominal(), joint_log(9, more=more))
    assert not [e for e in found.effects if e.name == "backlash" and e.level == Level.EXACT]
    assert found.level != Level.NONE


def test_what_the_catalogue_lacks_gets_no_exact_name() -> None:
    """A product of two joints' positions is in no effect's equation: none may be named as the cause."""
    q = motors(np.random.default_rng(4))[1]
    more = np.zeros(q.shape)
    more[..., 0] = 0.05 * q[..., 0] * q[..., 1]
    found = find_discrepancy(nominal(), joint_log(4, more=more))
    assert found.level == Level.UNKNOWN
    assert not found.effects


def test_the_same_seed_gives_the_same_report() -> None:
    """Splits and draws come from the seed alone."""
    log = joint_log(5, HomingOffset(1, 0.004))
    first, second = (find_discrepancy(nominal(), log, seed=7).to_report() for _ in range(2))
    for report in (first, second):
        report["provenance"].pop("seconds")
    assert first == second
    jsonschema.validate(json.loads(json.dumps(first | {"provenance": {**first["provenance"], "seconds": 1.0}})), SCHEMA)
    assert [(v["place"], v["level"]) for v in first["verdict"]["places"]] == [(1, "EXACT"), (2, "NONE")]


def test_the_schema_refuses_what_is_no_report() -> None:
    """A field that is not there, or one that nobody knows, is an error of the report."""
    report = find_discrepancy(nominal(), joint_log(5), seed=7).to_report()
    for wrong in ({k: v for k, v in report.items() if k != "gap"}, report | {"surprise": 1}, report | {"version": 1}):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(json.loads(json.dumps(wrong)), SCHEMA)


def test_what_is_small_beside_something_large_is_minor() -> None:
    """A ratio of a fifth of the noise beside a large offset is listed, and neither named nor in the model."""
    found = find_discrepancy(nominal(), joint_log(8, HomingOffset(1, 0.02), TransmissionRatio(2, 0.0004)))
    assert names(found) == {("homing_offset", 1)}
    assert all(e.size < 0.25 for e in found.verdict.minor)
    assert {e.about.name for e in found.model.effects} == {"homing_offset"}


def test_what_is_small_beside_something_unknown_is_minor() -> None:
    """A ratio of a fifth of the noise may be a part of what has no name: listed, neither named nor in the model."""
    logs = []
    for seed in range(4, 12):
        q = motors(np.random.default_rng(seed))[1]
        more = np.zeros(q.shape)
        more[..., 0] = 0.05 * q[..., 0] * q[..., 1]
        logs.append(joint_log(seed, TransmissionRatio(2, 0.00055), more=more))
    found = find_discrepancy(nominal(), logs)
    assert found.level == Level.UNKNOWN
    assert {(e.name, e.joint) for e in found.verdict.minor} == {("transmission_ratio", 2)}
    assert not found.effects
    assert not found.model.effects


def test_the_written_model_leaves_nothing_to_find() -> None:
    """A model that has the named effect is not asked for it again."""
    log = joint_log(6, TransmissionRatio(2, 0.02))
    once = find_discrepancy(nominal(), log)
    again = find_discrepancy(once.model, log)
    assert not again.effects


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda q: q * [1.0, -1.0], "joint 2 moves the other way"),
        (lambda q: q[:, ::-1].copy(), "joint 1 moves as joint 2"),
        (np.degrees, "neither a turning joint in radians"),
    ],
)
def test_a_sensor_in_other_units_signs_or_columns_is_refused(
    change: Callable[[FloatArray], FloatArray], words: str
) -> None:
    """None of it is missing physics: it was UNKNOWN, without a reason."""
    log = joint_log(3)
    assert log.external_jp is not None
    with pytest.raises(LogError, match=words):
        find_discrepancy(nominal(), replace(log, external_jp=change(log.external_jp)))


def test_a_log_without_outside_truth_is_refused() -> None:
    """Without external_jp or tracker_cp there is nothing to compare with."""
    log = joint_log(0).select(slice(0, 500))
    object.__setattr__(log, "external_jp", None)
    with pytest.raises(DataError, match="external_jp"):
        find_discrepancy(nominal(), log)


@pytest.mark.parametrize(
    "clock",
    [np.zeros_like, lambda t: np.full(len(t), np.nan), lambda t: t[::-1].copy(), lambda t: t - t % 60.0],
    ids=["nothing", "missing", "backwards", "still"],
)
def test_a_clock_that_does_not_run_is_refused(clock: Callable[[FloatArray], FloatArray]) -> None:
    """A log from Python need not have passed a reader: backwards it was NONE, otherwise a traceback."""
    log = joint_log(0)
    with pytest.raises(DataError, match="clock"):
        find_discrepancy(nominal(), replace(log, time=clock(log.time)))


def test_a_table_of_poses_is_refused() -> None:
    """Point and measure has no clock, and nearly every law of the catalogue needs one."""
    with pytest.raises(DataError, match="no clock"):
        find_discrepancy(nominal(), replace(joint_log(0), static=True))
