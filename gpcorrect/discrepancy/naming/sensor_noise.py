"""Effects that change no mean: noise that grew, at some moment or with speed, and encoders that count in steps.

The search looks for means and cannot find these. Each has a test of its own on the residual that the named effects
leave, or on the reported values themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.naming.posterior import Alternative, Explanation, Level, Named
from gpcorrect.discrepancy.naming.speed_noise import second_differences, speed_growth
from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.recording.noise import NORMAL_MAD, ChannelNoise
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.recording.stated_noise import NOISY, UNIFORM, Quantisation, quantisation_of, stated_noises
from gpcorrect.discrepancy.search.candidates import Candidate, Estimate, FittedEffect
from gpcorrect.discrepancy.search.coordinates import coordinate_of
from gpcorrect.discrepancy.search.state import penalty
from gpcorrect.discrepancy.settings import NAMING, NOISE, SENSORS
from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Effect, of_kind
from gpcorrect.sim.effects.geometry import HomingOffset
from gpcorrect.sim.effects.noise import EncoderQuantisation, NoiseChange, SpeedNoise
from gpcorrect.types import BoolArray, FloatArray, IntArray

Numbers = Mapping[str, tuple[float, tuple[float, float], str]]  # of an effect: value, 95 % interval and unit


@dataclass(frozen=True)
class Growth:
    """Noise beyond what was there before, or beyond what is stated."""

    std: float  # in the channel's unit
    std_ci95: tuple[float, float]  # by the scatter of the trajectories
    since: float  # session time from which on it is there, s
    since_ci95: tuple[float, float]
    nats: float  # gain of log-likelihood of the trajectories' levels


def levels_of(residual: FloatArray, trajectory: IntArray, rows: BoolArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Levels `(k,)` of white noise of the trajectories that have enough samples, their numbers, relative errors `(k,)`.

    Parameters
    ----------
    residual : (n,) array, single samples; NaN is missing
    trajectory : (n,) int array, of each sample
    rows : (n,) bool array, samples that may be looked at
    """
    levels, numbers, errors = [], [], []
    for number in np.unique(trajectory[rows]):
        second = second_differences(residual[rows & (trajectory == number)])
        second = second[np.isfinite(second)]
        scale = float(np.median(np.abs(second))) / NORMAL_MAD if len(second) else 0.0
        inner = second[np.abs(second) < SENSORS.trim * scale]
        if len(inner) < SENSORS.fewest:
            continue
        levels.append(float(np.sqrt(np.mean(inner**2))))
        numbers.append(number)
        # neighbouring second differences share samples: their squares count 35 / 18 times less than independent ones
        errors.append(float(0.5 * np.std(inner**2) / np.mean(inner**2) * np.sqrt(35.0 / 18.0 / len(inner))))
    return np.array(levels), np.array(numbers, dtype=np.int64), np.array(errors)


def stated_level(noise: ChannelNoise, step: float) -> float:
    """Return the level that :func:`levels_of` gives noise as it is stated.

    Parameters
    ----------
    noise : ChannelNoise, as it is stated
    step : float, s from sample to sample
    """
    phi = np.exp(-step / noise.time_constant)
    slow = noise.slow**2 * (6.0 - 8.0 * phi + 2.0 * phi**2) / 6.0
    return float(np.sqrt(noise.white**2 + slow))


def growth_of(
    levels: FloatArray, errors: FloatArray, start: FloatArray, end: FloatArray, stated: float | None, channels: int
) -> Growth | None:
    """Return by how much noise grew at some moment, or exceeds what is stated; None when neither is beyond doubt.

    Parameters
    ----------
    levels, errors : (k,) arrays, level of each trajectory, and its relative error
    start, end : (k,) arrays, session time at which each begins and ends, s
    stated : float or None, level as the model states it
    channels : int, that are looked at: each has its part of the chance of a false alarm
    """
    grown = _change(np.log(levels), errors, start, end, channels) if len(levels) >= 2 * SENSORS.side else None
    if grown is None and stated is not None and len(levels):
        return _excess(levels, errors, start, stated)
    return grown


def _change(height: FloatArray, errors: FloatArray, start: FloatArray, end: FloatArray, channels: int) -> Growth | None:
    """Return the clearest rise of the levels' logarithms, by Student's test; they scatter as their errors at least."""
    order = np.argsort(start, kind="stable")
    height, start, end = height[order], start[order], end[order]
    splits = np.flatnonzero(np.diff(start) > 0) + 1
    splits = splits[(splits >= SENSORS.side) & (splits <= len(height) - SENSORS.side)]
    if len(splits) == 0:
        return None
    floor, found = float(np.median(errors)), []
    for at in map(int, splits):
        before, after = height[:at], height[at:]
        left = ((before - before.mean()) ** 2).sum() + ((after - after.mean()) ** 2).sum()
        spread = np.sqrt(max(left / (len(height) - 2), floor**2))
        width = spread * np.sqrt(1.0 / len(before) + 1.0 / len(after))
        found.append((float((after.mean() - before.mean()) / width), at, spread, width))
    rise, at, spread, width = max(found, key=lambda f: f[0])
    low_level, high_level = float(height[:at].mean()), float(height[at:].mean())
    chance = min(1.0, len(splits) * float(student.sf(rise, len(height) - 2)))
    if chance > SENSORS.chance / channels or high_level - low_level < SENSORS.least_change:
        return None
    low, std, high = (_further(high_level + side * 1.96 * width, low_level) for side in (-1.0, 0.0, 1.0))
    total = max(float(np.mean((height - height.mean()) ** 2)), floor**2)
    nats = 0.5 * len(height) * float(np.log(total / spread**2))
    return Growth(std, (low, high), float(start[at]), (float(start[at - 1]), float(end[at])), nats)


def _further(after: float, before: float) -> float:
    """Further standard deviation from the logarithms of two levels."""
    return float(np.sqrt(max(np.exp(2.0 * after) - np.exp(2.0 * before), 0.0)))


def _excess(levels: FloatArray, errors: FloatArray, start: FloatArray, stated: float) -> Growth | None:
    """Return noise beyond the stated one, when nearly every trajectory has it."""
    if float(np.mean(levels > SENSORS.beyond * stated)) < SENSORS.nearly:
        return None
    height, nominal = np.log(levels), float(np.log(stated))
    spread, middle = max(float(height.std()), float(np.median(errors))), float(height.mean())
    half = 1.96 * spread / np.sqrt(len(height))
    low, std, high = (_further(middle + side * half, nominal) for side in (-1.0, 0.0, 1.0))
    nats = 0.5 * float((((height - nominal) / spread) ** 2 - ((height - middle) / spread) ** 2).sum())
    return Growth(std, (low, high), 0.0, (0.0, float(start.min())), nats)


@dataclass(frozen=True, eq=False)
class NoiseEffect:
    """A named effect on noise, with its numbers as reports have them."""

    named: Named
    parameters: Mapping[str, Estimate]


def noise_effects(dataset: Dataset, effects: Sequence[Effect], level: FloatArray) -> tuple[NoiseEffect, ...]:
    """Return what the sensors' noise has that the model does not know of.

    Parameters
    ----------
    dataset : Dataset
    effects : sequence of Effect, named so far
    level : (c,) array, standard deviation of the noise of single samples of every channel
    """
    scene = dataset.scene
    counts = [quantisation_of(path) if scene.measured else None for path in scene.motor_path().T]
    found = [_rounded(scene, i, c, level) for i, c in enumerate(counts)]
    coarse = {e.named.fit.candidate.joint for e in found if e is not None}
    steps = [max(_stated_step(scene, i), 0.0 if c is None else c.step) for i, c in enumerate(counts)]
    grown = _grown(dataset, effects, coarse, steps)
    return tuple(e for e in (*found, *grown) if e is not None)


def _grown(
    dataset: Dataset, effects: Sequence[Effect], coarse: set[int | str], steps: Sequence[float]
) -> list[NoiseEffect]:
    """Noisier outside sensors; a joint whose encoder counts in coarse steps is noisier by that.

    `steps` are those of the motors' encoders, rad or m, as stated or as their values show them; 0 for none.
    """
    scene = dataset.scene
    if scene.step > NOISE.dense:  # neighbouring samples differ by motion more than by noise
        return []
    groups: dict[int | str, list[int]] = {}
    for i, channel in enumerate(scene.channels):
        if channel.signal in NOISY and channel.joint not in coarse:
            groups.setdefault(channel.joint or "tool", []).append(i)
    residual, seen = scene.residual(effects), dataset.group >= 0
    seen[seen] = dataset.training[dataset.group[seen]]
    speeds = scene.layout.gather(scene.motion.velocity)
    found, known = [], of_kind(scene.model.effects, SpeedNoise)
    stated = stated_noises(scene, dataset.resolution)
    for joint, indices in groups.items():
        own = residual[:, indices]
        if isinstance(joint, int):
            column = scene.joints.index(joint)
            faster = speed_growth(
                own[:, 0],
                speeds,
                column,
                scene.trajectory,
                seen,
                stated=float(np.linalg.norm([e.seconds for e in known if e.joint == joint])),
                rounding=steps[column] / float(UNIFORM),
                channels=len(groups),
            )
            if faster is not None:
                numbers: Numbers = {"seconds": (faster.seconds, faster.seconds_ci95, "s")}
                found.append(_noise_effect(SpeedNoise, joint, "R", numbers, faster.nats, len(groups)))
                # of what is left a change at some moment may be seen
                own = own / np.hypot(1.0, faster.seconds * speeds[:, [column]] / faster.level)
        growth = _growth(scene, own, seen, [stated[i] for i in indices], len(groups))
        if growth is not None:
            unit = scene.channels[indices[0]].unit
            numbers = {
                "std": (growth.std, growth.std_ci95, unit),
                "since": (growth.since, growth.since_ci95, "s"),
            }
            joint_type = "P" if unit == "m" else "R"
            found.append(_noise_effect(NoiseChange, joint, joint_type, numbers, growth.nats, len(groups)))
    return found


def _stated_step(scene: Scene, column: int) -> float:
    """Step of a joint's encoder as the model's [noise] states it, rad or m; 0 where it does not."""
    stated = scene.model.noise.encoder_step if scene.model.noise is not None else ()
    return max(stated[column : column + 1], default=0.0)


def _growth(
    scene: Scene,
    residual: FloatArray,
    seen: BoolArray,
    known: Sequence[ChannelNoise | None],
    channels: int,
) -> Growth | None:
    """Growth of one sensor; the axes of a tracker are one."""
    every = [levels_of(column, scene.trajectory, seen) for column in residual.T]
    numbers = every[0][1]
    if any(not np.array_equal(numbers, other) for _, other, _ in every) or not len(numbers):
        return None
    levels = np.exp(np.mean([np.log(level) for level, _, _ in every], axis=0))
    errors = np.mean([error for _, _, error in every], axis=0) / np.sqrt(len(every))
    clock = scene.layout.gather(scene.motion.time)
    moments = [clock[scene.trajectory == k] for k in numbers]
    start, end = np.array([m.min() for m in moments]), np.array([m.max() for m in moments])
    stated = [stated_level(n, scene.step) for n in known if n is not None]
    nominal = float(np.exp(np.mean(np.log(stated)))) if len(stated) == len(known) else None
    return growth_of(levels, errors, start, end, nominal, channels)


def _rounded(scene: Scene, column: int, counts: Quantisation | None, level: FloatArray) -> NoiseEffect | None:
    """Return the encoder of one joint, when it counts in steps that matter."""
    if counts is None or not _matters(scene, column, counts.step, level):
        return None
    joint_type = scene.machine.body.types[column]
    ends = (counts.step - counts.error, counts.step + counts.error)
    numbers: Numbers = {"step": (counts.step, ends, "m" if joint_type == "P" else "rad")}
    # Each visited count beyond those that fix step and remainder agrees by chance in one of a hundred cases.
    nats = (counts.visited - 2) * float(np.log(100.0))
    return _noise_effect(EncoderQuantisation, scene.joints[column], joint_type, numbers, nats, len(scene.joints))


def _matters(scene: Scene, column: int, step: float, level: FloatArray) -> bool:
    """Whether rounding is coarser than the model says, and large enough to be seen from outside."""
    joint = scene.joints[column]
    known = [e.step for e in of_kind(scene.model.effects, EncoderQuantisation) if e.joint == joint]
    if step < SENSORS.coarser * max([_stated_step(scene, column), *known]):
        return False
    outside = np.array([c.signal != "measured_jp" for c in scene.channels])
    try:
        whole = scene.strict()
        change = whole.predict([HomingOffset(joint, step / UNIFORM)]) - whole.predict()
    except DataError:
        return False
    size = np.sqrt(np.nanmean(change[:, outside] ** 2, axis=0))
    second = second_differences(scene.residual()[:, outside]).T  # an outside sensor may be coarse as well
    rough = [np.sqrt(np.nanmean(s**2)) if np.isfinite(s).any() else 0.0 for s in second]
    return bool((size > SENSORS.rounding_matters * np.maximum(level[outside], rough)).any())


def _noise_effect(
    kind: type[Effect], joint: int | str, joint_type: str, numbers: Numbers, nats: float, tried: int
) -> NoiseEffect:
    """Return an effect with its numbers; against it stands only that nothing is there."""
    parameters = kind.about.parameters
    coordinates = tuple(coordinate_of(p, joint_type, amplitude=True) for p in parameters if p.name in numbers)
    u = tuple(numbers[c.parameter.name][0] / c.typical for c in coordinates)
    fit = FittedEffect(Candidate(kind, joint, (), coordinates, u), np.array(u))
    probability = float(1.0 / (1.0 + np.exp(-np.clip(nats - penalty(tried), -50.0, 50.0))))
    alternatives = (
        Alternative.of(fit.candidate, probability),
        Alternative(Explanation.NOTHING, 1.0 - probability, "nothing"),
        Alternative(Explanation.UNKNOWN, 0.0, "unknown"),
    )
    level = Level.EXACT if probability >= NAMING.exact else Level.INCONCLUSIVE
    return NoiseEffect(
        Named(fit, level, probability, nats, alternatives, ()), {name: Estimate(*n) for name, n in numbers.items()}
    )
