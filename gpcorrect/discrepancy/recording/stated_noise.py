"""Noise that is known without an estimate: as the model file states it, and by the steps of written values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.discrepancy.recording.noise import ChannelNoise
from gpcorrect.discrepancy.recording.scene import Channel, Scene
from gpcorrect.discrepancy.settings import NOISE, SENSORS
from gpcorrect.sim import Noise
from gpcorrect.sim.effects import of_kind
from gpcorrect.sim.effects.noise import EncoderQuantisation, NoiseChange, SpeedNoise
from gpcorrect.types import FloatArray

FINEST = 1e-9  # rad or m; a sensor without any white noise is rounding
NEAR = np.array(sorted(np.linspace(-1.0, 1.0, 25), key=abs))  # step sizes tried near a guess, the guess itself first
NOISY = ("external_jp", "tracker_cp")  # signals that `noise_change` acts on: of a tracker's poses, the positions
UNIFORM = np.sqrt(12.0)  # step of a rounded value over the standard deviation of its error


def stated_noises(scene: Scene, steps: Sequence[float] | FloatArray) -> tuple[ChannelNoise | None, ...]:
    """Return the noise of single samples of every channel as the model states it; None where it says nothing.

    Parameters
    ----------
    scene : Scene
    steps : (c,) sequence
        Step in which each channel is written down, 0 for none. What an outside sensor's rounding adds to its noise is
        known by it, whether the model says so or not.
    """
    noise = scene.model.noise
    if noise is None:
        return (None,) * len(scene.channels)
    return tuple(_of_channel(scene, c, noise, float(step)) for c, step in zip(scene.channels, steps, strict=True))


def _of_channel(scene: Scene, channel: Channel, noise: Noise, written: float) -> ChannelNoise | None:
    """Noise of a channel by its parts, the step in which it is written down, and the model's effects on it."""
    white, slow, phi = _parts(noise, channel, written)
    if not white and not slow:
        return None
    effects = scene.model.effects
    parts = [white, FINEST]
    if channel.signal in NOISY:
        parts += [e.std for e in of_kind(effects, NoiseChange) if e.joint == (channel.joint or "tool")]
    for effect in of_kind(effects, SpeedNoise):
        if effect.joint == channel.joint and channel.signal == "external_jp":
            speed = scene.motion.velocity[..., effect.column(scene.joints)]
            parts.append(effect.seconds * float(np.sqrt(np.nanmean(speed**2))))
    parts += [e.step / UNIFORM for e in of_kind(effects, EncoderQuantisation) if e.joint == channel.joint]
    time_constant = -scene.step / np.log(phi) if 0.0 < phi < 1.0 else scene.step / 10.0
    return ChannelNoise(float(np.linalg.norm(parts)), slow, time_constant)


def _parts(noise: Noise, channel: Channel, written: float) -> tuple[float, float, float]:
    """White and slow standard deviation, and the slow part's correlation from sample to sample."""
    of_joints = (noise.encoder_step, noise.external_jp_white, noise.external_jp_ar_std)
    if channel.signal == "tracker_cp":
        step, white, slow, phi = 0.0, noise.tracker_white, noise.tracker_ar_std, noise.tracker_ar_phi
    elif channel.signal == "tracker_rotation":
        step, white, slow = 0.0, noise.tracker_rotation_white, noise.tracker_rotation_ar_std
        phi = noise.tracker_ar_phi
    else:
        step, white, slow = (values[channel.index] if values else 0.0 for values in of_joints)
        phi = noise.external_jp_ar_phi
    if channel.signal == "measured_jp":  # steps coarser than stated are a discrepancy, `encoder_quantisation`
        return step / float(UNIFORM), 0.0, 0.0
    rounded = max(step, written) / float(UNIFORM)
    return float(np.hypot(white, rounded)) if white or slow else 0.0, slow, phi


def averaged(noise: ChannelNoise, count: int, step: float) -> ChannelNoise:
    """Return the noise of means over neighbouring samples.

    Parameters
    ----------
    noise : ChannelNoise, of single samples
    count : int, samples in a mean
    step : float, s from sample to sample
    """
    if count <= 1:
        return noise
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count))) * step
    left = float(np.sqrt(np.mean(np.exp(-lag / noise.time_constant))))
    return replace(noise, white=noise.white / np.sqrt(count), slow=noise.slow * left)


def rounded_to(noise: ChannelNoise, step: float, moving: ChannelNoise) -> ChannelNoise:
    """Return the noise of a channel that is written down in steps: no smaller than rounding makes it.

    A coarse sensor stands still while nothing moves, each time at another distance from the truth: what it does in
    holds says nothing of its error, which is as slow as the motion. What it hides there beside shows while it moves.

    Parameters
    ----------
    noise : ChannelNoise, in holds
    step : float, size of the steps, rad or m; 0 for none
    moving : ChannelNoise, of the same channel while it moves
    """
    error = step / float(UNIFORM)
    if noise.std >= error:
        return noise
    if moving.std > error:  # what is not rounding's is new at every sample
        white = float(np.sqrt(moving.std**2 - error**2))
        return replace(noise, white=white, slow=error, time_constant=NOISE.rounded_for, rounding_step=step)
    slow = float(np.sqrt(error**2 - noise.white**2))
    return replace(noise, slow=slow, time_constant=NOISE.rounded_for, rounding_step=step)


def chosen_noise(own: ChannelNoise, stated: ChannelNoise | None, step: float) -> ChannelNoise:
    """Return the noise to go by: what is stated, unless the recording is clearly noisier from sample to sample.

    A stated noise that is too small would give names to noise, so it is not believed against the recording. Over
    longer lags a recording is also noisier by the very effects that are looked for: there the stated noise counts.
    Tails are always the recording's.

    Parameters
    ----------
    own, stated : ChannelNoise, as the recording shows it, and as the model states it
    step : float, seconds from one row to the next
    """
    if stated is None:
        return own
    change, stated_change = (
        np.sqrt(n.white**2 - n.slow**2 * np.expm1(-step / n.time_constant)) for n in (own, stated)
    )  # root of half the mean squared change from one row to the next
    ratio = float(change) / float(stated_change)
    return replace(own, times_stated=ratio) if ratio > NOISE.noisier else replace(stated, tail=own.tail)


@dataclass(frozen=True)
class Quantisation:
    """A step in which values are written down, in their unit."""

    step: float
    error: float  # half width of what the values leave open of it
    visited: int  # counts that differ


def quantisation_of(values: FloatArray) -> Quantisation | None:
    """Return the largest step on whose multiples (and a common remainder) values lie; None when there is none.

    Remainders then all agree (Widrow and Kollar 2008, Ch. 1), also of values rounded a second time, more finely. Each
    value counts once, however long the joint rested there.

    Parameters
    ----------
    values : (n,) array, rad or m
    """
    distinct = np.unique(values[np.isfinite(values)])
    if len(distinct) < SENSORS.fewest_counts:
        return None
    gaps = np.diff(distinct)
    gaps = np.sort(gaps[gaps > 1e-9 * gaps.max()])
    jump = int(np.argmax(gaps[1:] / gaps[:-1])) + 1 if len(gaps) > 1 else 0
    guesses = {float(gaps[0]), float(np.median(gaps[jump:]))}  # the smallest, and that between groups of neighbours
    found = [c for guess in sorted(guesses) if (c := _fitted(distinct, guess)) is not None]
    return max(found, key=lambda c: c.step, default=None)


def _fitted(distinct: FloatArray, guess: float) -> Quantisation | None:
    """Best step near a guess, fitted over an ever wider range of values, so that no count is skipped."""
    step, base = guess, distinct[0]
    span = float(np.ptp(distinct))
    if span < (SENSORS.fewest_counts - 1) * guess:
        return None
    reach = 4.0 * guess
    while True:
        near = distinct[distinct - base <= reach]
        width = 0.3 * step**2 / max(reach, step)
        tried = step + width * NEAR
        agreements = [_agreement(near, t) for t in tried]  # all the same where a value stands alone: the guess holds
        step = float(tried[int(np.argmax(agreements))])
        if max(agreements) < SENSORS.agreement:
            return None
        if reach >= span:
            break
        reach *= 2.0
    visited = len(np.unique(np.round((distinct - base) / step)))
    if _agreement(distinct, step) < SENSORS.agreement or visited < SENSORS.fewest_counts:
        return None
    return Quantisation(step, float(width), visited)


def _agreement(values: FloatArray, step: float) -> float:
    """From 0 for remainders that are spread evenly to 1 for all the same."""
    return float(np.abs(np.mean(np.exp(2j * np.pi * (values - values[0]) / step))))
