"""Effects that change no mean: noise that grew, at some moment or with speed, and encoders that count in steps.

The search looks for means and cannot find these. Each has a test of its own on the residual that the named effects
leave, or on the reported values themselves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t as student

from gpcorrect.discrepancy.naming.posterior import Alternative, Explanation, Level, Named
from gpcorrect.discrepancy.naming.speed_noise import SpeedGrowth, speed_growth
from gpcorrect.discrepancy.recording.channels import Channel
from gpcorrect.discrepancy.recording.dataset import Dataset
from gpcorrect.discrepancy.recording.noise import NORMAL_MAD, ChannelNoise
from gpcorrect.discrepancy.recording.quantisation import Quantisation, quantisation_of
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.recording.stated_noise import UNIFORM, stated_noises
from gpcorrect.discrepancy.search.candidates import Candidate, Estimate, FittedEffect
from gpcorrect.discrepancy.search.coordinates import coordinate_of
from gpcorrect.discrepancy.search.state import penalty
from gpcorrect.discrepancy.settings import NAMING, NOISE, SENSORS
from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Effect, of_kind
from gpcorrect.sim.effects.geometry import HomingOffset
from gpcorrect.sim.effects.noise import EncoderQuantisation, NoiseChange, SpeedNoise
from gpcorrect.types import BoolArray, FloatArray, IntArray

NORM = np.sqrt(6.0)  # deviation of a second difference of unit white noise


@dataclass(frozen=True)
class Growth:
    """Noise beyond what was there before, or beyond what is stated.

    Parameters
    ----------
    std : float
        Of the further noise, unit of the channel.
    std_ci95 : pair of float
        By the scatter of the trajectories.
    since, since_ci95 : float, pair of float
        Session time from which on it is there, s.
    nats : float
        Gain of log-likelihood of the trajectories' levels.
    chance : float
        Of a change at least as clear in noise that does not change.
    """

    std: float
    std_ci95: tuple[float, float]
    since: float
    since_ci95: tuple[float, float]
    nats: float
    chance: float


def levels_of(residual: FloatArray, trajectory: IntArray, rows: BoolArray) -> tuple[FloatArray, IntArray, FloatArray]:
    """Levels `(k,)` of white noise of the trajectories that have enough samples, their numbers, relative errors `(k,)`.

    Parameters
    ----------
    residual : (n,) array
        Single samples; NaN is missing.
    trajectory : (n,) int array
        Of each sample.
    rows : (n,) bool array
        Samples that may be looked at.
    """
    levels, numbers, errors = [], [], []
    for number in np.unique(trajectory[rows]):
        values = residual[rows & (trajectory == number)]
        second = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / NORM
        second = second[np.isfinite(second)]
        scale = float(np.median(np.abs(second))) / NORMAL_MAD if len(second) else 0.0
        inner = second[np.abs(second) < SENSORS.trim * scale]
        if len(inner) < SENSORS.fewest:
            continue
        levels.append(float(np.sqrt(np.mean(inner**2))))
        numbers.append(number)
        # neighbouring second differences fraction samples: their squares count 35 / 18 times less than independent ones
        errors.append(float(0.5 * np.std(inner**2) / np.mean(inner**2) * np.sqrt(35.0 / 18.0 / len(inner))))
    return np.array(levels), np.array(numbers, dtype=np.int64), np.array(errors)


def roughness(residual: FloatArray) -> float:
    """Return the root mean square of all second differences, as white noise would have it.

    Parameters
    ----------
    residual : (n,) array
        Single samples, rad or m.
    """
    second = (residual[2:] - 2.0 * residual[1:-1] + residual[:-2]) / NORM
    return float(np.sqrt(np.nanmean(second**2))) if np.isfinite(second).any() else 0.0


def stated_level(noise: ChannelNoise, step: float) -> float:
    """Return the level that :func:`levels_of` gives noise as it is stated.

    Parameters
    ----------
    noise : ChannelNoise
        As it is stated.
    step : float
        s from sample to sample.
    """
    phi = np.exp(-step / noise.time_constant)
    slow = noise.slow**2 * (6.0 - 8.0 * phi + 2.0 * phi**2) / 6.0
    return float(np.sqrt(noise.white**2 + slow))


def growth_of(
    levels: FloatArray,
    errors: FloatArray,
    start: FloatArray,
    end: FloatArray,
    stated: float | None,
    channels: int,
) -> Growth | None:
    """Return by how much noise grew at some moment, or exceeds what is stated; None when neither is beyond doubt.

    Parameters
    ----------
    levels, errors : (k,) arrays
        Level of each trajectory, and its relative error.
    start, end : (k,) arrays
        Session time at which each begins and ends, s.
    stated : float or None
        Level as the model states it.
    channels : int
        That are looked at: each has its fraction of the chance of a false alarm.
    """
    grown = _change(np.log(levels), errors, start, end, channels) if len(levels) >= 2 * SENSORS.side else None
    if grown is None and stated is not None and len(levels):
        return _excess(levels, errors, start, stated)
    return grown


def _change(height: FloatArray, errors: FloatArray, start: FloatArray, end: FloatArray, channels: int) -> Growth | None:
    order = np.argsort(start, kind="stable")
    height, start, end = height[order], start[order], end[order]
    splits = np.flatnonzero(np.diff(start) > 0) + 1
    splits = splits[(splits >= SENSORS.side) & (splits <= len(height) - SENSORS.side)]
    if len(splits) == 0:
        return None
    floor = float(np.median(errors))
    rises = [_rise(height[:at], height[at:], floor) for at in splits]
    best = int(np.argmax(rises))
    chance = min(1.0, len(splits) * float(student.sf(rises[best], len(height) - 2)))
    at = int(splits[best])
    before, after = height[:at], height[at:]
    if chance > SENSORS.chance / channels or after.mean() - before.mean() < SENSORS.least_change:
        return None
    spread = np.sqrt(max(_within(before, after), floor**2))
    half = 1.96 * spread * np.hypot(1.0 / np.sqrt(len(after)), 1.0 / np.sqrt(len(before)))
    low, high = (_further(float(after.mean()) + side * half, float(before.mean())) for side in (-1.0, 1.0))
    total = max(float(np.mean((height - height.mean()) ** 2)), floor**2)
    nats = 0.5 * len(height) * float(np.log(total / spread**2))
    std = _further(float(after.mean()), float(before.mean()))
    return Growth(std, (low, high), float(start[at]), (float(start[at - 1]), float(end[at])), nats, chance)


def _rise(before: FloatArray, after: FloatArray, floor: float) -> float:
    """Student's statistic of a rise; trajectories scatter at least as their samples do."""
    spread = np.sqrt(max(_within(before, after), floor**2) * (1.0 / len(before) + 1.0 / len(after)))
    return float((after.mean() - before.mean()) / spread)


def _within(before: FloatArray, after: FloatArray) -> float:
    left = ((before - before.mean()) ** 2).sum() + ((after - after.mean()) ** 2).sum()
    return float(left / (len(before) + len(after) - 2))


def _further(after: float, before: float) -> float:
    """Further standard deviation from the logarithms of two levels."""
    return float(np.sqrt(max(np.exp(2.0 * after) - np.exp(2.0 * before), 0.0)))


def _excess(levels: FloatArray, errors: FloatArray, start: FloatArray, stated: float) -> Growth | None:
    """Return noise beyond the stated one, when nearly every trajectory has it."""
    if float(np.mean(levels > SENSORS.beyond * stated)) < SENSORS.nearly:
        return None
    height, floor = np.log(levels), float(np.median(errors))
    spread = max(float(height.std()), floor)
    half = 1.96 * spread / np.sqrt(len(height))
    middle, nominal = float(height.mean()), float(np.log(stated))
    nats = 0.5 * float((((height - nominal) / spread) ** 2 - ((height - middle) / spread) ** 2).sum())
    ends = _further(middle - half, nominal), _further(middle + half, nominal)
    return Growth(_further(middle, nominal), ends, 0.0, (0.0, float(start.min())), nats, 0.0)


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
        Recording and simulator.
    effects : sequence of Effect
        Named so far.
    level : (c,) array
        Standard deviation of the noise of single samples of every channel.
    """
    found = [_rounded(dataset.scene, i, level) for i in range(len(dataset.scene.joints))]
    coarse = {e.named.fit.candidate.joint for e in found if e is not None}
    grown = _grown(dataset, effects, coarse)
    return tuple(e for e in (*found, *grown) if e is not None)


def _grown(dataset: Dataset, effects: Sequence[Effect], coarse: set[int | str]) -> list[NoiseEffect]:
    """Noisier outside sensors; a joint whose encoder counts in steps is noisier by that."""
    scene = dataset.scene
    if scene.step > NOISE.dense:  # neighbouring samples differ by motion more than by noise
        return []
    groups: dict[int | str, list[int]] = {}
    for i, channel in enumerate(scene.channels):
        if channel.signal != "measured_jp" and channel.joint not in coarse:
            groups.setdefault(channel.joint or "tool", []).append(i)
    residual, seen = scene.residual(effects), dataset.group >= 0
    seen[seen] = dataset.training[dataset.group[seen]]
    speeds = scene.layout.gather(scene.motion.velocity)
    found, known = [], of_kind(scene.model.effects, SpeedNoise)
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
                rounding=_rounding(scene, column),
                channels=len(groups),
            )
            if faster is not None:
                found.append(_speed_noise(joint, faster, len(groups)))
                own = (
                    own / faster.times(speeds[:, column])[:, None]
                )  # of what is left a change at some moment may be seen
        growth = _growth(scene, own, seen, indices, len(groups))
        if growth is not None:
            found.append(_noise_change(scene.channels[indices[0]], joint, growth, len(groups)))
    return found


def _rounding(scene: Scene, column: int) -> float:
    """Return the standard deviation of the rounding of a motor's path, as stated or as its values show it, rad or m."""
    counts = quantisation_of(scene.motor_path()[:, column]) if scene.measured else None
    stated = scene.model.noise.encoder_step if scene.model.noise is not None else ()
    step = max([*stated[column : column + 1], *([] if counts is None else [counts.step])], default=0.0)
    return step / float(UNIFORM)


def _speed_noise(joint: int, growth: SpeedGrowth, channels: int) -> NoiseEffect:
    (seconds,) = SpeedNoise.about.parameters
    coordinate = coordinate_of(seconds, "R", amplitude=True)
    u = (growth.seconds / coordinate.typical,)
    candidate = Candidate(SpeedNoise, joint, (), (coordinate,), u)
    numbers = {"seconds": Estimate(growth.seconds, growth.seconds_ci95, "s")}
    return NoiseEffect(_named(FittedEffect(candidate, np.array(u)), growth.nats, channels), numbers)


def _growth(
    scene: Scene, residual: FloatArray, seen: BoolArray, indices: Sequence[int], channels: int
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
    known = [stated_noises(scene)[i] for i in indices]
    stated = [stated_level(n, scene.step) for n in known if n is not None]
    nominal = float(np.exp(np.mean(np.log(stated)))) if len(stated) == len(known) else None
    return growth_of(levels, errors, start, end, nominal, channels)


def _noise_change(channel: Channel, joint: int | str, growth: Growth, channels: int) -> NoiseEffect:
    kind = "P" if channel.unit == "m" else "R"
    parameters = {p.name: p for p in NoiseChange.about.parameters}
    coordinates = tuple(coordinate_of(parameters[name], kind, amplitude=True) for name in ("std", "since"))
    u = (growth.std / coordinates[0].typical, growth.since / coordinates[1].typical)
    candidate = Candidate(NoiseChange, joint, (), coordinates, u)
    numbers = {
        "std": Estimate(growth.std, growth.std_ci95, channel.unit),
        "since": Estimate(growth.since, growth.since_ci95, "s"),
    }
    return NoiseEffect(_named(FittedEffect(candidate, np.array(u)), growth.nats, channels), numbers)


def _rounded(scene: Scene, column: int, level: FloatArray) -> NoiseEffect | None:
    """Return the encoder of one joint, when it counts in steps that matter."""
    if not scene.measured:
        return None
    counts = quantisation_of(scene.motor_path()[:, column])
    if counts is None or not _matters(scene, column, counts, level):
        return None
    joint, kind = scene.joints[column], scene.machine.body.types[column]
    (step,) = [p for p in EncoderQuantisation.about.parameters if p.name == "step"]
    coordinate = coordinate_of(step, kind, amplitude=True)
    u = (counts.step / coordinate.typical,)
    candidate = Candidate(EncoderQuantisation, joint, (), (coordinate,), u)
    ends = (counts.step - counts.error, counts.step + counts.error)
    numbers = {"step": Estimate(counts.step, ends, "m" if kind == "P" else "rad")}
    # Each visited count beyond those that fix step and remainder agrees by chance in one of a hundred cases.
    nats = (counts.visited - 2) * float(np.log(100.0))
    return NoiseEffect(_named(FittedEffect(candidate, np.array(u)), nats, len(scene.joints)), numbers)


def _matters(scene: Scene, column: int, counts: Quantisation, level: FloatArray) -> bool:
    """Whether rounding is coarser than the model says, and large enough to be seen from outside."""
    joint = scene.joints[column]
    stated = scene.model.noise.encoder_step if scene.model.noise is not None else ()
    known = [e.step for e in scene.model.effects if isinstance(e, EncoderQuantisation) and e.joint == joint]
    if counts.step < SENSORS.coarser * max([*stated[column : column + 1], *known], default=0.0):
        return False
    outside = np.array([c.signal != "measured_jp" for c in scene.channels])
    try:
        whole = scene.strict()
        change = whole.predict([HomingOffset(joint, counts.step / UNIFORM)]) - whole.predict()
    except DataError:
        return False
    size = np.sqrt(np.nanmean(change[:, outside] ** 2, axis=0))
    raw = np.array([roughness(r) for r in scene.residual()[:, outside].T])  # an outside sensor may be coarse as well
    return bool((size > SENSORS.rounding_matters * np.maximum(level[outside], raw)).any())


def _named(fit: FittedEffect, nats: float, tried: int) -> Named:
    """Named effect; against it stands only that nothing is there."""
    gain = nats - penalty(tried)
    probability = float(1.0 / (1.0 + np.exp(-np.clip(gain, -50.0, 50.0))))
    alternatives = (
        replace(Alternative.of(fit.candidate, gain), extra=0, probability=probability),
        Alternative(Explanation.NOTHING, 0.0, "nothing", probability=1.0 - probability),
        Alternative(Explanation.UNKNOWN, 0.0, "unknown"),
    )
    level = Level.EXACT if probability >= NAMING.exact else Level.INCONCLUSIVE
    return Named(fit, level, probability, nats, alternatives, ())
