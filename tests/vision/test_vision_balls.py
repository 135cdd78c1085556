"""Balls in pictures: counted, coloured, and found to a small fraction of a pixel."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from vision_support import cameras_of, intrinsics_of, path_of

from gpcorrect.errors import DataError
from gpcorrect.vision import END_EFFECTOR, BallSpec, Target, colour_of, outline, read_target
from gpcorrect.vision.opencv import cv2
from gpcorrect.vision.rim import fit_cone
from gpcorrect.vision.search import Window, detect_everywhere, find_circle
from gpcorrect.vision.settings import DEFAULT, BallSettings
from gpcorrect_studies.rendering import Card, Lens, Light, Stage, looking_at

SEED = 402


def _lens(distortion: tuple[float, float, float, float, float]) -> Lens:
    position = np.array([0.3, -0.2, 0.35])
    return Lens(position, looking_at(position, np.zeros(3)), (600.0, 610.0), (322.0, 238.0), distortion)


@pytest.mark.parametrize("distortion", [(0.0, 0.0, 0.0, 0.0, 0.0), (-0.2, 0.06, 1e-3, -1e-3, 0.0)])
def test_the_cone_of_touching_rays_is_exact(distortion: tuple[float, float, float, float, float]) -> None:
    """Rim points of a ball far from the picture's middle give the ray to its centre and its size, bent lens or not."""
    lens = _lens(distortion)
    centre, radius = np.array([0.11, 0.07, -0.03]), 0.012
    axis = centre - lens.position
    distance = float(np.linalg.norm(axis))
    half = np.arcsin(radius / distance)
    a = np.cross(axis, [0.0, 0.0, 1.0])
    a, angles = a / np.linalg.norm(a), np.linspace(0, 2 * np.pi, 64, endpoint=False)
    b = np.cross(axis / distance, a)
    tangent = np.cos(half) * axis / distance + np.sin(half) * (
        np.cos(angles)[:, None] * a + np.sin(angles)[:, None] * b
    )
    intrinsics = intrinsics_of(lens)
    found = fit_cone(intrinsics.normalised(lens.pixels(lens.position + tangent)), intrinsics)
    assert found is not None
    assert np.allclose(found.pixel, lens.pixels(centre), atol=1e-4)
    assert found.half_angle == pytest.approx(half, rel=1e-5)


def test_centres_are_found_within_eight_hundredths_of_a_pixel() -> None:
    """Shaded, blurred and noisy balls before clutter, in every camera; its reported size is at least half."""
    stage = Stage.standard(SEED)
    errors, reported = [], []
    for pose in path_of(SEED, 4, 5.0):
        for lens, image, camera in zip(stage.lenses, stage.frame(pose), cameras_of(stage), strict=True):
            for ball, spec in zip(stage.balls(pose), END_EFFECTOR.balls, strict=True):
                true = lens.pixels(ball.centre)
                window = Window.around(true + np.array([3.0, -4.0]), 30.0, image)
                circle = find_circle(image, spec.colour, window, (8.0, 22.0))
                assert circle is not None
                found = outline(image, circle, camera.intrinsics)
                assert found is not None
                errors.append(found.pixel - true)
                reported.append(camera.intrinsics.focal * np.sqrt(np.trace(found.covariance) / 2))
    assert np.sqrt(np.mean(np.square(errors))) < 0.08
    assert np.median(reported) > 0.5 * np.sqrt(np.mean(np.square(errors)))


def test_the_side_that_light_comes_from_moves_no_centre() -> None:
    """A lens blurs light, and grey levels are its 2.2th root: the steepest change of these lies beside the rim."""
    stage = Stage.standard(SEED, pieces=0, light=Light((0.3, -0.5, 1.0), 0.4), radius=0.02)
    assert _offset_px(stage, DEFAULT.balls) < 0.06
    assert _offset_px(stage, replace(DEFAULT.balls, gamma=1.0)) > 0.12


def test_light_from_one_side_alone_moves_centres_little() -> None:
    """What darkens towards the rim is the ball's own colour; all three channels alike take that for the rim."""
    stage = Stage.standard(SEED, pieces=0, light=Light((1.0, -0.3, 0.25), 0.05), radius=0.02)
    assert _offset_px(stage, DEFAULT.balls) < 0.16
    assert _offset_px(stage, replace(DEFAULT.balls, least_scatter=10.0, contrast=0.0)) > 0.25


def test_overexposed_sides_move_no_centre() -> None:
    """A channel that is cut off at its brightest changes fastest beside the rim."""
    bright = {"green": (40.0, 260.0, 60.0), "yellow": (300.0, 270.0, 40.0), "red": (300.0, 35.0, 35.0)}
    stage = Stage.standard(SEED, pieces=0, light=Light((0.3, -0.5, 1.0), 0.4), radius=0.02, colours=bright)
    assert _offset_px(stage, DEFAULT.balls) < 0.06
    assert _offset_px(stage, replace(DEFAULT.balls, clipped=256)) > 0.07


def test_centres_in_compressed_pictures_are_as_uncertain_as_they_say() -> None:
    """JPEG of quality 30 errs slowly along the rim and blurs colours: 95 % ellipses hold 85 % of centres or more."""
    stage, inside = Stage.standard(SEED, pieces=0, noise=6.0, radius=0.02), []
    for pose in path_of(SEED, 3, 5.0):
        for ball in stage.balls(pose):
            for lens, studio in zip(stage.lenses, stage.studios, strict=True):
                _, coded = cv2.imencode(".jpg", studio.photograph([ball]), [cv2.IMWRITE_JPEG_QUALITY, 30])
                true, away = lens.pixels(ball.centre), float(np.linalg.norm(ball.centre - lens.position))
                circle = np.array([*true, lens.focal[0] * ball.radius / away])
                found = outline(cv2.imdecode(coded, cv2.IMREAD_COLOR), circle, intrinsics_of(lens))
                assert found is not None
                off = (found.pixel - true) / lens.focal
                inside.append(off @ np.linalg.solve(found.covariance, off) < 5.99)  # chi squared of two, 95 %
    assert np.mean(inside) >= 0.85


def _offset_px(stage: Stage, settings: BallSettings) -> float:
    """RMS over cameras and balls of the mean offset of the centres, px: what no averaging takes away."""
    off = []
    for pose in path_of(SEED, 4):
        for ball in stage.balls(pose):
            for lens, studio in zip(stage.lenses, stage.studios, strict=True):
                true = lens.pixels(ball.centre)
                size = lens.focal[0] * ball.radius / float(np.linalg.norm(ball.centre - lens.position))
                found = outline(studio.photograph([ball]), np.array([*true, size]), intrinsics_of(lens), settings)
                assert found is not None
                off.append(found.pixel - true)
    mean = np.reshape(off, (4, -1, 2)).mean(axis=0)
    return float(np.sqrt((mean**2).sum(axis=1).mean()))


def test_a_half_hidden_ball_is_not_drawn_to_the_side_that_is_seen() -> None:
    """With a third of the ball covered, the centre stays within half a pixel, and its uncertainty grows."""
    stage = Stage.standard(SEED)
    pose = path_of(SEED, 1)[0]
    lens, studio = stage.lenses[3], stage.studios[3]
    ball = stage.balls(pose)[0]
    u, v = lens.pixels(ball.centre)
    card = Card((int(u + 5), int(v - 60), int(u + 80), int(v + 60)))
    intrinsics = intrinsics_of(lens)
    start = np.array([u + 1.0, v - 1.0, 14.0])
    free = outline(studio.photograph([ball]), start, intrinsics)
    covered = outline(studio.photograph([ball], [card]), start, intrinsics)
    assert free is not None
    assert covered is not None
    assert np.linalg.norm(covered.pixel - [u, v]) < 0.5
    assert covered.arc < 0.9
    assert np.trace(covered.covariance) > np.trace(free.covariance)


def test_one_circle_is_found_where_there_are_several() -> None:
    """The bisected threshold gives one of the balls of a colour, and none where the colour is not."""
    picture, places = np.full((160, 320, 3), 120, np.uint8), (50, 120, 200)
    for k, u in enumerate(places):
        cv2.circle(picture, (u, 80), 14 + k, (40, 40, 200), -1, cv2.LINE_AA)
    everywhere = Window(0, 0, 320, 160)
    found = find_circle(picture, colour_of("red"), everywhere, (9.0, 24.0))
    assert found is not None
    assert min(np.hypot(found[0] - u, found[1] - 80) for u in places) < 2.0
    assert find_circle(picture, colour_of("green"), everywhere, (9.0, 24.0)) is None


def test_two_merged_balls_of_one_colour_are_told_apart() -> None:
    """Two touching balls are two candidates, each in its place, not one large ball between them."""
    stage = Stage.standard(SEED, {"red_a": (0.0, 0.0, 0.0), "red_b": (0.0, 0.016, 0.0)}, pieces=0)
    pose = path_of(SEED, 1)[0]
    for lens, image, camera in zip(stage.lenses, stage.frame(pose), cameras_of(stage), strict=True):
        true = [lens.pixels(ball.centre) for ball in stage.balls(pose)]
        for found in detect_everywhere(image, camera, END_EFFECTOR.balls[2]):
            assert min(float(np.linalg.norm(found.pixel - t)) for t in true) < 2.0


def test_colours_may_be_named_measured_or_given_as_hues() -> None:
    """A name, a hue and a shade of red all take a red pixel and leave a green one."""
    hsv = cv2.cvtColor(np.array([[[30, 30, 200], [40, 170, 50]]], np.uint8), cv2.COLOR_BGR2HSV)
    for given in ("red", 0.0, "#c81e1e", (200, 30, 30)):
        assert colour_of(given).mask(hsv).tolist() == [[255, 0]]


def test_targets_that_cannot_work_are_refused(tmp_path: Path) -> None:
    """Balls on a line, colours that cannot be told apart, grey, unknown names and unknown keys."""

    def target(*balls: dict[str, object]) -> Target:
        path = tmp_path / "target.json"
        path.write_text(json.dumps({"ball": balls}))
        return read_target(path)

    line = [BallSpec(n, colour_of(n), (0.01 * k, 0.0, 0.0)) for k, n in enumerate(("green", "yellow", "red"))]
    with pytest.raises(DataError, match="on a line"):
        Target(tuple(line))
    with pytest.raises(DataError, match="cannot be distinguished"):
        target({"name": "a", "hue": 10.0}, {"name": "b", "color": "red"})
    with pytest.raises(DataError, match="nearly grey"):
        colour_of((120, 121, 119))
    with pytest.raises(DataError, match="no name here"):
        target({"name": "ball", "color": "mauvish"})
    with pytest.raises(DataError, match="size"):
        target({"name": "red", "size": 3})
