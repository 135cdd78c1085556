"""A first look before tracking: whether these pictures, this calibration and this target belong together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.vision.acquire import Hypothesis, acquire, hypotheses
from gpcorrect.vision.camera import Camera
from gpcorrect.vision.colour import hue_name
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.rim import Outline
from gpcorrect.vision.search import look_everywhere
from gpcorrect.vision.target import Target

__all__ = ["check_fit", "seen_hues"]

ENOUGH = 0.75  # of the sightings that agree: no reason to doubt
BETTER = 1.25  # times as many agreeing sightings make another order of the cameras the true one
FEW_SIGHTINGS = 1.5  # cameras a ball and frame, on average: with fewer, nothing speaks against the calibration
SOME = 0.34  # of the sightings must agree in the best order
MOST_ORDERED = 5  # cameras of which all orders are tried; of more, only swaps of two
Candidates = Sequence[Sequence[Sequence[Outline]]]  # cameras, balls, candidates


@dataclass(frozen=True)
class _Tally:
    """Sightings (frame, ball, camera) that agree in space, and all there are."""

    agreeing: int
    seen: int

    @property
    def share(self) -> float:
        return self.agreeing / max(self.seen, 1)


def check_fit(
    frames: Sequence[Sequence[Image | None]], cameras: Sequence[Camera], target: Target, names: Sequence[str]
) -> None:
    """Refuse what cannot be tracked, and say why.

    Parameters
    ----------
    frames : sequence (frames) of sequence (cameras) of pictures
        A few, spread over the recording.
    cameras : sequence of Camera
        In the order of the pictures.
    target : Target
        What is to be tracked.
    names : sequence of str
        Of the videos or folders, for the message.

    Raises
    ------
    LogError
        A ball's colour is nowhere, the cameras are in the wrong order, the calibration is of another set of cameras,
        or the balls are larger or farther apart than the target says.
    """
    looked = [
        [
            [[] if image is None else look_everywhere(image, camera, ball) for ball in target.balls]
            for camera, image in zip(cameras, images, strict=True)
        ]
        for images in frames
    ]
    _check_colours(looked, frames, target)
    tally = _tally(looked, cameras, target)
    if tally.share >= ENOUGH:
        return
    order, best = _best_order(looked, cameras, target)
    if best.agreeing > BETTER * tally.agreeing + 2 and best.share >= SOME:
        _refuse_swap(order, cameras, names)
    if tally.share < SOME:
        _check_size(looked, cameras, target)
        if tally.seen >= FEW_SIGHTINGS * len(looked) * len(target.balls):
            _refuse_calibration(cameras, tally)
        if not tally.agreeing:
            _refuse_colours(target.names, frames)


def _check_colours(looked: Sequence[Candidates], frames: Sequence[Sequence[Image | None]], target: Target) -> None:
    missing = [
        ball.name for b, ball in enumerate(target.balls) if not any(camera[b] for frame in looked for camera in frame)
    ]
    if missing:
        _refuse_colours(missing, frames)


def _refuse_colours(missing: Sequence[str], frames: Sequence[Sequence[Image | None]]) -> None:
    hues = ", ".join(seen_hues(frames)) or "no strong colours"
    several = "s" if len(missing) > 1 else ""
    raise LogError(
        f"the ball{several} {', '.join(missing)} cannot be found: in none of {len(frames)} frames do two cameras see "
        f"a ball of that colour; strong colours there: {hues}.",
        hint="Check the colours in the target file (hue in degrees, or color = '#rrggbb'). If the balls come into "
        "sight for a short while only: --no-first-look",
    )


def seen_hues(frames: Sequence[Sequence[Image | None]]) -> list[str]:
    """Names of the strong colours in pictures, the most frequent first, each with its middle hue in degrees."""
    counts = np.zeros(180)
    for image in itertools.chain.from_iterable(frames):
        if image is None:
            continue
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        strong = (hsv[..., 1] > 110) & (hsv[..., 2] > 50)
        counts += np.bincount(hsv[..., 0][strong], minlength=180)[:180]
    groups: dict[str, list[float]] = {}
    for hue in np.flatnonzero(counts > 0.02 * max(counts.sum(), 1.0)):
        groups.setdefault(hue_name(2.0 * float(hue)), []).append(2.0 * float(hue))
    return [f"{name} (hue {np.median(hues):.0f})" for name, hues in groups.items()]


def _tally(looked: Sequence[Candidates], cameras: Sequence[Camera], target: Target) -> _Tally:
    agreeing = sum(len(h.views) for frame in looked for h in acquire(cameras, target, frame) if h is not None)
    seen = sum(bool(balls[b]) for frame in looked for balls in frame for b in range(len(target.balls)))
    return _Tally(agreeing, seen)


def _best_order(
    looked: Sequence[Candidates], cameras: Sequence[Camera], target: Target
) -> tuple[tuple[int, ...], _Tally]:
    """Which calibrated camera each video seems to be from."""
    n = len(cameras)
    if n <= MOST_ORDERED:
        orders = list(itertools.permutations(range(n)))
    else:
        orders = [tuple(range(n))]
        for i, j in itertools.combinations(range(n), 2):
            swapped = list(range(n))
            swapped[i], swapped[j] = j, i
            orders.append(tuple(swapped))
    tallies = [_reordered(looked[:3], cameras, order, target) for order in orders]
    best = orders[int(np.argmax([t.agreeing for t in tallies]))]
    return best, _reordered(looked, cameras, best, target)


def _reordered(
    looked: Sequence[Candidates], cameras: Sequence[Camera], order: tuple[int, ...], target: Target
) -> _Tally:
    """Tally with the pictures taken for those of other cameras: their rays are those cameras' then."""
    taken = [cameras[k] for k in order]
    again = [
        [[[_through(o, camera) for o in found] for found in balls] for balls, camera in zip(frame, taken, strict=True)]
        for frame in looked
    ]
    return _tally(again, taken, target)


def _through(found: Outline, camera: Camera) -> Outline:
    lens = camera.intrinsics
    ray = lens.normalised(found.pixel[None])[0]
    return replace(found, ray=ray, half_angle=float(np.arctan(found.radius / lens.focal)))


def _refuse_swap(order: tuple[int, ...], cameras: Sequence[Camera], names: Sequence[str]) -> None:
    moved = [f"{names[i]} shows what camera {cameras[k].name} sees" for i, k in enumerate(order) if i != k]
    right = " ".join(names[order.index(k)] for k in range(len(order)))
    raise LogError(
        f"the cameras are swapped: {'; '.join(moved)}.", hint=f"Give them in the calibration's order: {right}"
    )


def _check_size(looked: Sequence[Candidates], cameras: Sequence[Camera], target: Target) -> None:
    """When the balls agree in space but not with the target, its sizes are wrong, or the calibration's scale is."""
    found: list[list[Hypothesis]] = [[] for _ in target.balls]
    for frame in looked:
        for b in range(len(target.balls)):
            best = hypotheses(cameras, [camera[b] for camera in frame], None)
            if best and len(best[0].views) >= min(3, len(cameras)):
                found[b].append(best[0])
    if not all(found):
        return
    for ball, seen in zip(target.balls, found, strict=True):
        measured = float(np.median([h.radius for h in seen]))
        if ball.radius is not None and abs(measured - ball.radius) > 0.25 * ball.radius:
            raise LogError(
                f"ball {ball.name} has a radius of {1e3 * measured:.1f} mm in the pictures, {1e3 * ball.radius:.1f} mm "
                "in the target file.",
                hint="Correct the target file; or the calibration was done with another size of chessboard or markers.",
            )
    for (i, first), (j, second) in itertools.combinations(enumerate(target.balls), 2):
        pairs = zip(found[i], found[j], strict=False)
        measured = float(np.median([np.linalg.norm(p.position - q.position) for p, q in pairs]))
        known = float(np.linalg.norm(np.subtract(first.place, second.place)))
        if abs(measured - known) > 0.1 * known + 0.002:
            raise LogError(
                f"balls {first.name} and {second.name} are {1e3 * measured:.1f} mm apart in the pictures, "
                f"{1e3 * known:.1f} mm in the target file.",
                hint="Correct the places in the target file; or the calibration is of another scale.",
            )


def _refuse_calibration(cameras: Sequence[Camera], tally: _Tally) -> None:
    raise LogError(
        f"the calibration does not fit the pictures: of {tally.seen} sightings of balls only {tally.agreeing} agree on "
        f"a place in space, with cameras {', '.join(camera.name for camera in cameras)} in this order or any other.",
        hint="Take these cameras' calibration file, or calibrate again if they were moved; check the colours too.",
    )
