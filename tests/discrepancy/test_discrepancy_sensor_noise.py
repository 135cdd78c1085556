"""Effects on noise alone: silent in noise that does not change, named where it does, and steps of encoders found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discrepancy.discrepancy_core import joint_log, raven_swings
from discrepancy.discrepancy_support import nominal
from scipy.signal import lfilter

from gpcorrect.discrepancy.naming.sensor_noise import Growth, growth_of, levels_of, stated_level
from gpcorrect.discrepancy.naming.speed_noise import SpeedGrowth, speed_growth
from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.stated_noise import quantisation_of, stated_noises
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.discrepancy.search.prepared import prepare_data
from gpcorrect.sim import machine_of, model_from_dict, simulate
from gpcorrect.sim.effects import EncoderQuantisation, NoiseChange
from gpcorrect.sim.effects.noise import SpeedNoise
from gpcorrect.types import FloatArray

TRAJECTORIES, SAMPLES = 16, 300


def noise(rng: np.random.Generator, tail: float = np.inf, uneven: float = 0.0) -> FloatArray:
    """White noise of unit deviation with slow noise beside it, each trajectory noisier or softer by chance."""
    shape = (TRAJECTORIES, SAMPLES)
    white = rng.standard_normal(shape) if np.isinf(tail) else rng.standard_t(tail, shape) / np.sqrt(tail / (tail - 2))
    slow = lfilter([np.sqrt(1 - 0.95**2)], [1.0, -0.95], rng.standard_normal(shape), axis=1)
    return (white + 0.5 * slow) * np.exp(uneven * rng.standard_normal((TRAJECTORIES, 1)))


def grown(values: FloatArray, stated: float | None = None) -> Growth | None:
    number = np.repeat(np.arange(TRAJECTORIES), SAMPLES)
    levels, numbers, errors = levels_of(values.ravel(), number, np.ones(len(number), dtype=np.bool_))
    assert np.array_equal(numbers, np.arange(TRAJECTORIES))
    start = 10.0 * numbers
    return growth_of(levels, errors, start, start + 3.0, stated, 1)


@pytest.mark.parametrize(("tail", "uneven"), [(np.inf, 0.0), (4.0, 0.0), (2.6, 0.0), (np.inf, 0.5)])
def test_noise_that_does_not_change_is_called_so(tail: float, uneven: float) -> None:
    """In 150 recordings, heavy tails or uneven trajectories included, at most one is called changed."""
    named = sum(grown(noise(np.random.default_rng(seed), tail, uneven)) is not None for seed in range(150))
    assert named <= 1


@pytest.mark.parametrize("since", [3, 8, 12])
def test_further_noise_is_found_with_size_and_moment(since: int) -> None:
    """As much noise again, from one trajectory on: its size within its interval, its moment to the trajectory."""
    rng = np.random.default_rng(since)
    values = noise(rng)
    values[since:] += 1.0 * rng.standard_normal(values[since:].shape)
    found = grown(values)
    assert found is not None
    assert found.since == 10.0 * since
    assert found.since_ci95[0] < 10.0 * since < found.since_ci95[1]
    assert found.std_ci95[0] < 1.0 < found.std_ci95[1]


def test_noise_beyond_the_stated_is_found_and_the_stated_itself_is_not() -> None:
    """A sensor as noisy as stated is no discrepancy; one that is half as noisy again all along is."""
    stated = stated_level(ChannelNoise(1.0, 0.5, -0.01 / np.log(0.95)), 0.01)
    rng = np.random.default_rng(0)
    assert grown(noise(rng), stated) is None
    noisier = grown(1.5 * noise(rng), stated)
    assert noisier is not None
    assert noisier.since == 0.0
    assert noisier.std == pytest.approx(np.sqrt(1.5**2 - 1.0), rel=0.05)


def faster(values: FloatArray, speed: FloatArray, stated: float = 0.0) -> SpeedGrowth | None:
    number = np.repeat(np.arange(TRAJECTORIES), SAMPLES)
    rows = np.ones(len(number), dtype=np.bool_)
    return speed_growth(
        values.ravel(), speed.reshape(len(number), -1), 0, number, rows, stated=stated, rounding=0.0, channels=1
    )


def speeds(rng: np.random.Generator) -> FloatArray:
    """Sinusoidal motion, each trajectory as fast as it likes: up to 2 rad/s, unit of noise a radian."""
    time = 0.01 * np.arange(SAMPLES)
    fastest, frequency = rng.uniform(0.1, 2.0, (TRAJECTORIES, 1)), rng.uniform(0.5, 1.0, (TRAJECTORIES, 1))
    return fastest * np.sin(2 * np.pi * frequency * time + rng.uniform(0, 6, (TRAJECTORIES, 1)))


@pytest.mark.parametrize(("tail", "uneven"), [(np.inf, 0.0), (4.0, 0.0), (2.6, 0.0), (np.inf, 0.5)])
def test_noise_that_does_not_grow_with_speed_is_called_so(tail: float, uneven: float) -> None:
    """In 150 recordings, heavy tails or uneven trajectories included, at most one is called faster than it is."""
    drawn = [np.random.default_rng(seed) for seed in range(150)]
    assert sum(faster(noise(rng, tail, uneven), speeds(rng)) is not None for rng in drawn) <= 1


@pytest.mark.parametrize("uneven", [0.0, 0.5])
def test_noise_that_grows_with_speed_is_found_with_its_size(uneven: float) -> None:
    """The interval holds the true instant in nine of ten recordings at least; a model that knows of it leaves none."""
    held = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        speed = speeds(rng)
        values = noise(rng, uneven=uneven) + 1.5 * speed * rng.standard_normal(speed.shape)
        found = faster(values, speed)
        assert found is not None
        held += found.seconds_ci95[0] < 1.5 < found.seconds_ci95[1]
        assert faster(values, speed, stated=1.5) is None
    assert held >= 36


def test_a_smooth_error_that_grows_with_speed_is_no_noise() -> None:
    """What a model leaves unexplained of fast motion counts against noise, however large it is."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        speed = speeds(rng)
        assert faster(noise(rng) + 30.0 * speed * np.abs(speed), speed) is None


@pytest.mark.parametrize("law", ["the arm's pace", "another joint", "any motion"])
def test_other_noise_of_a_moving_arm_does_not_grow_with_the_joint(law: str) -> None:
    """Noise that all joints have when the arm is fast, that another joint makes, or that rounding does."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        moved = np.stack([speeds(rng) for _ in range(3)], axis=-1)
        size = np.abs(moved)
        louder = {
            "the arm's pace": 3.0 * (size / size.max(axis=(0, 1))).max(axis=-1),
            "another joint": 2.0 * size[..., 1],
            "any motion": 2.0 * (size[..., 0] > 0.05 * np.sqrt(np.mean(size[..., 0] ** 2))),
        }[law]
        assert faster(noise(rng) + louder * rng.standard_normal(louder.shape), moved) is None


def test_softer_noise_is_no_further_noise() -> None:
    """Noise that calms down is not named: nothing can be added that makes it so."""
    values = noise(np.random.default_rng(1))
    values[8:] *= 0.4
    assert grown(values) is None


@pytest.mark.parametrize("step", [2e-4, 1e-3, 7e-3])
def test_the_step_of_counts_is_found(step: float) -> None:
    """Values on a grid give its step, rounded a second time or not; the interval holds the true step."""
    path = 0.3 * np.sin(np.linspace(0, 40, 5000)) + 0.1 * np.sin(np.linspace(0, 93, 5000))
    for values in (step * np.round(path / step), np.round(step * np.round(path / step), 5)):
        found = quantisation_of(values)
        assert found is not None
        assert abs(found.step - step) <= found.error


def test_the_step_is_found_where_the_lowest_count_stands_alone() -> None:
    """Alone it agrees with every step: the first one tried was taken, and the grid was lost from there on."""
    found = quantisation_of(2e-4 * np.append(np.arange(400.0), -30.0))
    assert found is not None
    assert abs(found.step - 2e-4) <= found.error


def test_smooth_values_are_on_no_grid() -> None:
    """Paths, rests and random values lie on no grid."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        path = np.cumsum(rng.standard_normal(int(rng.integers(9, 2000))))
        path[len(path) // 3 : len(path) // 2] = path[len(path) // 3]
        assert quantisation_of(path) is None
        assert quantisation_of(rng.uniform(size=500)) is None


def test_noise_effects_are_named_written_and_then_known() -> None:
    """A noisier sensor is named by the whole run; the model that it writes asks for nothing more."""
    log = joint_log(11)
    rng = np.random.default_rng(2)
    seen = np.array(log.external_jp)
    late = log.time > np.median(log.time)
    seen[late, 1] += 2e-3 * rng.standard_normal(int(late.sum()))
    found = find_discrepancy(nominal(), replace(log, external_jp=seen))
    assert found.level == "EXACT"
    (effect,) = found.model.effects
    assert isinstance(effect, NoiseChange)
    assert effect.joint == 2
    assert effect.std == pytest.approx(2e-3, rel=0.1)
    assert abs(effect.since - float(np.median(log.time))) < 70.0


def test_a_noisier_tracker_is_named_with_the_size_of_its_positions() -> None:
    """Its orientations have noise of their own, in rad, which `noise_change` does not act on: no mean of both."""
    noise = {"tracker_white": 2e-4, "tracker_rotation_white": 1e-3}
    model = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 100, "noise": noise})
    noisier = machine_of(model).with_effects(NoiseChange("tool", 4e-4))
    log = replace(simulate(noisier, raven_swings(3, 12, 6.0), seed=4), external_jp=None)
    found = find_discrepancy(model, log, seed=0)
    (effect,) = found.effects
    assert (effect.name, effect.joint) == ("noise_change", "tool")
    low, high = effect.parameters["std"].ci95
    assert low < 4e-4 < high
    dataset = prepare_data(log, found.model, np.random.default_rng(0)).dataset
    noises = zip(dataset.scene.channels, stated_noises(dataset.scene, dataset.resolution), strict=True)
    stated = {c.signal: n.white for c, n in noises if n is not None}
    assert stated["tracker_cp"] == pytest.approx(np.hypot(2e-4, effect.parameters["std"].value))
    assert stated["tracker_rotation"] == pytest.approx(1e-3)


def test_an_unsure_instant_is_named_written_and_then_known() -> None:
    """A sensor that reads at unsure instants is named with their spread, not called noisier all along."""
    log = joint_log(13)
    seen, rng = np.array(log.external_jp), np.random.default_rng(3)
    seen[:, 0] += 4e-3 * np.gradient(log.measured_jp[:, 0], log.time) * rng.standard_normal(len(log))
    log = replace(log, external_jp=seen)
    found = find_discrepancy(nominal(), log)
    assert [(type(e), e.joint) for e in found.model.effects] == [(SpeedNoise, 1)]
    low, high = found.effects[0].parameters["seconds"].ci95
    assert low < 4e-3 < high
    assert not find_discrepancy(found.model, log).effects


def test_a_coarse_encoder_is_named_and_then_known() -> None:
    """An encoder of large steps is named with its step; the model that it writes asks for nothing more."""
    log, step = joint_log(12), 3e-3
    assert log.measured_jp is not None
    coarse = np.array(log.measured_jp)
    coarse[:, 0] = step * np.round(coarse[:, 0] / step)
    log = replace(log, measured_jp=coarse)
    found = find_discrepancy(nominal(), log)
    assert [(type(e), e.joint) for e in found.model.effects] == [(EncoderQuantisation, 1)]
    assert found.effects[0].parameters["step"].value == pytest.approx(step, rel=1e-3)
    assert not find_discrepancy(found.model, log).effects


def test_a_sensor_that_is_held_between_its_samples_is_no_noisier() -> None:
    """At half the rate each value comes twice: a value that is old had been noise that grows with speed."""
    log = joint_log(5)
    first = np.arange(len(log)) % 2 == 0  # motions have an even number of rows
    seen = np.where(first[:, None], log.external_jp, np.roll(log.external_jp, 1, axis=0))
    found = find_discrepancy(nominal(), replace(log, external_jp=seen))
    assert found.level == "NONE"
    (remark,) = [words for words in found.provenance.remarks if "is held" in words]
    assert "external_jp" in remark
    assert "50 %" in remark
