"""Checks before tracking: whether these pictures, this calibration and this target belong together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpcorrect.errors import LogError
from gpcorrect.vision.agreement import Hypothesis, acquire, hypotheses
from gpcorrect.vision.camera import Camera, require_two
from gpcorrect.vision.opencv import Image, cv2
from gpcorrect.vision.rim import Outline
from gpcorrect.vision.search import detect_everywhere
from gpcorrect.vision.settings import DEFAULT, VisionSettings
from gpcorrect.vision.target import Target, hue_name

STRONG = (110, 50)  # saturation and value (of 255) above which a pixel counts as coloured, for the message only
FREQUENT = 0.02  # of the coloured pixels: hues that the message names
Candidates = Sequence[Sequence[Sequence[Outline]]]  # cameras, balls, candidates
Pictures = Sequence[Image | None]


@dataclass(frozen=True)
class _Agreement:
    """Views (frame, ball, camera) that agree in space, and all there are."""

    agreeing: int
    seen: int

    @property
    def fraction(self) -> float:
        return self.agreeing / max(self.seen, 1)


def check_fit(
    frames: Sequence[Pictures],
    cameras: Sequence[Camera],
    target: Target,
    names: Sequence[str],
    settings: VisionSettings = DEFAULT,
) -> None:
    """Refuse what cannot be tracked, and name the reason.

    Parameters
    ----------
    frames : sequence (frames) of sequence (cameras) of pictures, a few, spread over the recording
    cameras : sequence of Camera, in the order of the pictures
    target : Target
    names : sequence of str, of the videos or folders, for the message
    settings : VisionSettings

    Raises
    ------
    DataError
        There is one camera, or a picture has another size than its camera's calibration.
    LogError
        A ball's colour is nowhere, the cameras are in the wrong order, the calibration is of another set of cameras,
        or the balls are larger or farther apart than the target says.
    """
    require_two(cameras)
    check = settings.check
    for camera, image in itertools.chain.from_iterable(zip(cameras, images, strict=True) for images in frames):
        if image is not None:
            camera.intrinsics.require_size(image, camera.name)
    candidates = _candidates(frames, cameras, target, settings)
    missing = [n for b, n in enumerate(target.names) if not any(c[b] for frame in candidates for c in frame)]
    if missing:
        raise _no_such_colours(missing, frames)
    given = _agreement(candidates, cameras, target, settings)
    if given.fraction >= check.enough:
        return
    # Of what size the balls are and how far apart is left open here: a wrong target file says nothing of the cameras.
    placed = _agreement(candidates, cameras, target, settings, sizes=False)
    if placed.fraction >= check.enough:
        _check_sizes(candidates, cameras, target, settings)
    order, best = _best_order(candidates, cameras, target, settings)
    if best.agreeing > check.better * placed.agreeing + 2 and best.fraction >= check.enough:
        moved = [f"{names[i]} shows what camera {cameras[k].name} sees" for i, k in enumerate(order) if i != k]
        right = " ".join(names[order.index(k)] for k in range(len(order)))
        hint = f"Give them in the calibration's order: {right}"
        raise LogError(f"the cameras are swapped: {'; '.join(moved)}.", hint=hint)
    if given.fraction >= check.some:
        return
    _check_sizes(candidates, cameras, target, settings)
    if given.seen >= check.few_views * len(frames) * len(target.balls):
        raise LogError(
            f"the calibration does not fit the pictures: of {given.seen} sightings of balls only {given.agreeing} "
            f"agree on a place in space, with cameras {', '.join(camera.name for camera in cameras)} in this order "
            "or any other.",
            hint="Take these cameras' calibration file, or calibrate again if they were moved; check the colours too.",
        )
    if not given.agreeing:
        raise _no_such_colours(target.names, frames)


def check_distances(
    frames: Sequence[Pictures], cameras: Sequence[Camera], target: Target, settings: VisionSettings = DEFAULT
) -> None:
    """Refuse a target whose balls are a little farther apart than in the pictures, for where nothing was tracked.

    :func:`check_fit` lets distances miss by a fraction as well, which the tracker does not.

    Parameters
    ----------
    frames, cameras, target, settings : as of :func:`check_fit`

    Raises
    ------
    LogError
        Two balls are farther apart, or nearer, than the target says.
    """
    strict = replace(settings, agreement=replace(settings.agreement, shape_fraction=0.0))
    _check_sizes(_candidates(frames, cameras, target, settings), cameras, target, strict)


def _candidates(
    frames: Sequence[Pictures], cameras: Sequence[Camera], target: Target, settings: VisionSettings
) -> list[Candidates]:
    """Find what may be each ball in every picture."""
    return [
        [
            [[] if image is None else detect_everywhere(image, camera, ball, settings) for ball in target.balls]
            for camera, image in zip(cameras, images, strict=True)
        ]
        for images in frames
    ]


def _no_such_colours(missing: Sequence[str], frames: Sequence[Pictures]) -> LogError:
    counts = np.zeros(180)
    for image in itertools.chain.from_iterable(frames):
        if image is not None:
            hue, saturation, value = cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2HSV))
            counts += np.bincount(hue[(saturation > STRONG[0]) & (value > STRONG[1])], minlength=180)[:180]
    groups: dict[str, list[float]] = {}
    for hue in np.flatnonzero(counts > FREQUENT * max(counts.sum(), 1.0)):
        groups.setdefault(hue_name(2.0 * float(hue)), []).append(2.0 * float(hue))
    named = [f"{name} (hue {np.median(degrees):.0f})" for name, degrees in groups.items()]
    hues = ", ".join(named) or "no strong colours"
    several = "s" if len(missing) > 1 else ""
    return LogError(
        f"the ball{several} {', '.join(missing)} cannot be found: in none of {len(frames)} frames do two cameras see "
        f"a ball of that colour; strong colours there: {hues}.",
        hint="Check the colours in the target file (hue in degrees, or color = '#rrggbb'). If the balls come into "
        "sight for a short while only: --no-first-look",
    )


def _agreement(
    candidates: Sequence[Candidates],
    cameras: Sequence[Camera],
    target: Target,
    settings: VisionSettings,
    *,
    sizes: bool = True,
) -> _Agreement:
    """Count the views that agree; on places in space alone without `sizes`."""
    if sizes:
        found = [acquire(cameras, target, frame, settings.agreement) for frame in candidates]
        agreeing = sum(len(h.views) for frame in found for h in frame if h is not None)
    else:
        balls = [[camera[b] for camera in frame] for frame in candidates for b in range(len(target.balls))]
        places = [hypotheses(cameras, ball, None, settings.agreement) for ball in balls]
        agreeing = sum(len(options[0].views) for options in places if options)
    return _Agreement(agreeing, sum(bool(ball) for frame in candidates for balls in frame for ball in balls))


def _best_order(
    candidates: Sequence[Candidates], cameras: Sequence[Camera], target: Target, settings: VisionSettings
) -> tuple[tuple[int, ...], _Agreement]:
    """Which calibrated camera each video seems to be from."""
    n = len(cameras)
    if n <= settings.check.most_ordered:
        orders = list(itertools.permutations(range(n)))
    else:
        orders = [tuple(range(n))]
        for i, j in itertools.combinations(range(n), 2):
            swapped = list(range(n))
            swapped[i], swapped[j] = j, i
            orders.append(tuple(swapped))

    def agreement(order: tuple[int, ...], frames: Sequence[Candidates]) -> _Agreement:
        """Agreement with the pictures taken for those of other cameras: their rays are those cameras' then."""
        taken = [cameras[k] for k in order]

        def _through(found: Outline, camera: Camera) -> Outline:
            lens = camera.intrinsics
            ray, half_angle = lens.normalised(found.pixel[None])[0], float(np.arctan(found.radius / lens.focal))
            return replace(found, ray=ray, half_angle=half_angle)

        again = [
            [
                [[_through(o, camera) for o in ball] for ball in balls]
                for balls, camera in zip(frame, taken, strict=True)
            ]
            for frame in frames
        ]
        return _agreement(again, taken, target, settings, sizes=False)

    likely = [  # of every ball in every camera
        [[ball[: settings.check.order_candidates] for ball in balls] for balls in frame]
        for frame in candidates[: settings.check.order_frames]
    ]
    best = max(orders, key=lambda order: agreement(order, likely).agreeing)
    return best, agreement(best, candidates)


def _check_sizes(
    candidates: Sequence[Candidates], cameras: Sequence[Camera], target: Target, settings: VisionSettings
) -> None:
    """When the balls agree in space but not with the target, its sizes are wrong, or the calibration's scale is."""
    found: list[list[Hypothesis]] = [[] for _ in target.balls]
    for frame, b in itertools.product(candidates, range(len(target.balls))):
        best = hypotheses(cameras, [camera[b] for camera in frame], None, settings.agreement)
        if best and len(best[0].views) >= min(3, len(cameras)):
            found[b].append(best[0])
    if not all(found):
        return
    limits = settings.agreement
    for ball, seen in zip(target.balls, found, strict=True):
        measured = float(np.median([h.radius for h in seen]))
        if ball.radius is not None and abs(measured - ball.radius) > settings.check.radius * ball.radius:
            raise LogError(
                f"ball {ball.name} has a radius of {1e3 * measured:.1f} mm in the pictures, {1e3 * ball.radius:.1f} mm "
                "in the target file.",
                hint="Correct the target file; or the calibration was done with another size of chessboard or markers.",
            )
    for (i, first), (j, second) in itertools.combinations(enumerate(target.balls), 2):
        pairs = zip(found[i], found[j], strict=False)
        measured = float(np.median([np.linalg.norm(p.position - q.position) for p, q in pairs]))
        known = float(np.linalg.norm(np.subtract(first.place, second.place)))
        if abs(measured - known) > limits.shape + limits.shape_fraction * known:
            raise LogError(
                f"balls {first.name} and {second.name} are {1e3 * measured:.1f} mm apart in the pictures, "
                f"{1e3 * known:.1f} mm in the target file.",
                hint="Correct the places in the target file; or the calibration is of another scale.",
            )
