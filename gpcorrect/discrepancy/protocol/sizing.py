"""Effects of a wanted size: drawn from the catalogue, and scaled until they stand out of the noise as asked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.candidates import Candidate, all_candidates
from gpcorrect.errors import DataError
from gpcorrect.sim import Model
from gpcorrect.sim.effects import Effect
from gpcorrect.types import CalibrationLog, FloatArray

TRIES = 40  # candidates drawn before giving up
SECANTS = 6  # steps towards the wanted ratio
CLOSE = 0.1  # of the wanted ratio
SHAPE_SPREAD = 0.5  # standard deviation of the logarithm of a shape parameter around its typical value


@dataclass(frozen=True, eq=False)
class Drawn:
    """An effect, and the candidate that it came from."""

    candidate: Candidate
    effect: Effect


def noise_of(model: Model, scene: Scene) -> FloatArray:
    """Return standard deviation `(c,)` of the noise that the model gives each channel; NaN for motor encoders.

    Parameters
    ----------
    model : Model
    scene : Scene

    Raises
    ------
    DataError
        The model has no noise.
    """
    noise = model.noise
    if noise is None:
        raise DataError("sizes relative to the noise need to know it.", hint="Give the model a [noise] table.")
    zeros = (0.0,) * len(model.joints)
    joint = np.hypot(noise.external_jp_white or zeros, noise.external_jp_ar_std or zeros)
    tracker = float(np.hypot(noise.tracker_white, noise.tracker_ar_std))
    turn = float(np.hypot(noise.tracker_rotation_white, noise.tracker_rotation_ar_std)) or np.nan  # not stated: unused
    by_channel = {"external_jp": joint.tolist(), "tracker_cp": [tracker] * 3, "tracker_rotation": [turn] * 3}
    std = np.array([by_channel[c.signal][c.index] if c.signal in by_channel else np.nan for c in scene.channels])
    if not (std[np.isfinite(std)] > 0).all():
        raise DataError(
            "the model's [noise] gives an outside signal no noise.", hint="Give external_jp_white or tracker_white."
        )
    return std


def effect_to_noise(scene: Scene, std: FloatArray, effects: Sequence[Effect]) -> float:
    """Return the largest of the outside channels' ratios: RMS of what the effects change, over the noise.

    Parameters
    ----------
    scene : Scene
    std : (c,) array, noise of each channel; NaN for those that do not count
    effects : sequence of Effect, that are added
    """
    change = scene.predict(effects) - scene.predict()
    outside = np.isfinite(std)
    return float((np.sqrt(np.nanmean(change**2, axis=0))[outside] / std[outside]).max())


def drawn_effect(
    model: Model,
    scout: CalibrationLog,
    ratio: float,
    rng: np.random.Generator,
    *,
    names: Sequence[str] = (),
    besides: Sequence[Drawn] = (),
) -> Drawn:
    """Draw an effect at random, and scale it until it stands out of the noise by about `ratio`.

    Parameters
    ----------
    model : Model, nominal machine, with its noise
    scout : CalibrationLog, a recording of it, by which sizes are measured
    ratio : float, root mean square of the change over the noise, in the channel where it is largest
    rng : numpy.random.Generator
    names : sequence of str, effects to draw from; all when empty
    besides : sequence of Drawn, already there: not drawn again

    Raises
    ------
    DataError
        No effect can reach the ratio, or the model has no noise.
    """
    scene = build_scene(scout, model, np.ones(len(scout), dtype=np.bool_)).strict()
    std = noise_of(model, scene)
    taken = {d.candidate.key for d in besides}
    open_ones = [c for c in all_candidates(scene) if c.key not in taken and (not names or c.name in names)]
    keys = list(dict.fromkeys(c.name for c in open_ones))
    for _ in range(TRIES if keys else 0):
        name = keys[int(rng.integers(len(keys)))]
        same = [c for c in open_ones if c.name == name]
        candidate = same[int(rng.integers(len(same)))]
        effect = _sized(candidate, scene, std, ratio, rng)
        if effect is not None:
            return Drawn(candidate, effect)
    raise DataError(
        f"no effect of {', '.join(names) or 'the catalogue'} can stand out of the noise by {ratio:g} in this machine.",
        hint="Ask for other names, or give the model less noise.",
    )


def _sized(
    candidate: Candidate, scene: Scene, std: FloatArray, ratio: float, rng: np.random.Generator
) -> Effect | None:
    """Scale a candidate's amplitudes by secants; None when its physical range ends before the ratio is reached.

    Where it has none, its size is its first number, on a logarithmic scale, such as the radius of a play.
    """
    shape = np.array(candidate.start) + np.array(
        [0.0 if c.amplitude or c.kind != "log" else SHAPE_SPREAD * rng.standard_normal() for c in candidate.coordinates]
    )
    sign = np.array([1.0 if c.parameter.positive else rng.choice([-1.0, 1.0]) for c in candidate.coordinates])
    rows, factor = list(candidate.amplitudes), 1.0
    nothing = np.array([candidate.coordinates[i].identity for i in rows])
    full = sign[rows] * (np.array(candidate.start)[rows] - nothing)
    for _ in range(SECANTS):
        u = shape.copy()
        if rows:
            u[rows] = nothing + factor * full
        else:
            u[0] += np.log(factor)
        try:
            effect = candidate.build(np.clip(u, *candidate.bounds))
            reached = effect_to_noise(scene, std, [effect])
        except DataError:
            return None
        if abs(reached / ratio - 1.0) < CLOSE:
            return effect
        factor *= float(np.clip(ratio / max(reached, 1e-12), 1e-2, 1e2))
    return None
