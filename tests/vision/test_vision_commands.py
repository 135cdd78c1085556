"""`gpcorrect vision` as a user runs it: a whole job, and every bad input named clearly with nothing invented."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from board_pictures import Board, board_picture
from command_line import CommandLine, Outcome, assert_refused
from vision_support import COVER, board_before, cameras_of, path_of, place_of, record

from gpcorrect import se3
from gpcorrect.logs import read_log
from gpcorrect.types import FloatArray
from gpcorrect.vision import read_cameras, write_cameras
from gpcorrect.vision.opencv import cv2
from gpcorrect_studies.rendering import Ball, Stage, Studio, backdrop, four_cameras, marker_points

pytestmark = pytest.mark.slow
Vision = Callable[..., Outcome]
SEED = 405
FRAMES = 8


@dataclass(frozen=True, eq=False)
class _Recorded:
    folder: Path
    stage: Stage
    views: list[Path]
    poses: FloatArray


@pytest.fixture
def vision(gpcorrect: CommandLine) -> Vision:
    """Call `gpcorrect vision` with words."""
    return partial(gpcorrect, "vision")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> _Recorded:
    """Return a recording of four cameras; the second one is covered in two frames."""
    folder = tmp_path_factory.mktemp("recorded")
    stage, poses = Stage.standard(SEED), path_of(SEED, FRAMES)
    views = record(folder, stage, poses, lambda i: {1: [COVER]} if i in (3, 4) else {})
    return _Recorded(folder, stage, views, poses)


def _track(recorded: _Recorded, output: Path, *more: object) -> list[object]:
    return ["track", *recorded.views, "--cameras", recorded.folder / "cameras.json", "--output", output, *more]


def _beginnings(recorded: _Recorded, folder: Path, frames: int) -> list[Path]:
    """Return folders with copies of the first frames of each camera."""
    for view in recorded.views:
        (folder / view.name).mkdir()
        for i in range(frames):
            shutil.copy(view / f"{i:04d}.png", folder / view.name)
    return [folder / view.name for view in recorded.views]


def test_a_recording_becomes_a_log(vision: Vision, recorded: _Recorded, tmp_path: Path) -> None:
    """Within a fifth of a millimetre, with the status of every row, an annotated video and a page."""
    output, video, page = tmp_path / "log.parquet", tmp_path / "look.avi", tmp_path / "page.html"
    outcome = vision(*_track(recorded, output, "--annotated", video, "--report", page, "--fps", 30, "--json"))
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out)["measured_share"] == 1.0
    log = read_log(output)
    assert log.tracker_cp.quaternion is not None
    assert np.allclose(np.diff(log.time), 1 / 30)
    error = 1e3 * np.linalg.norm(log.tracker_cp.position - recorded.poses[:, :3, 3], axis=1)
    assert np.sqrt(np.mean(error**2)) < 0.2
    assert (log.extra["tracking_status"] == 0).all()
    assert log.extra["ball_red_cameras"].tolist() == [4, 4, 4, 3, 3, 3, 3, 3]
    drawn = cv2.VideoCapture(str(video))
    assert int(drawn.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES
    text = page.read_text()
    assert text.count('class="chart"') == 4
    assert "Which camera saw what" in text


def test_swapped_cameras_are_named(vision: Vision, recorded: _Recorded, tmp_path: Path) -> None:
    """Two folders in each other's place: the message says which, and the right order; no log appears."""
    a, b, c, d = recorded.views
    words = ["track", b, a, c, d, "--cameras", recorded.folder / "cameras.json", "--output", tmp_path / "log.csv"]
    assert_refused(
        vision(*words), "cameras are swapped", "view1 shows what camera cam1 sees", "view0 view1 view2 view3"
    )
    assert not (tmp_path / "log.csv").exists()


def test_another_rig_s_calibration_is_named(vision: Vision, recorded: _Recorded, tmp_path: Path) -> None:
    """Cameras that stand elsewhere: the calibration does not fit, in this order or any other."""
    other = Stage.standard(SEED + 50, pieces=0)
    turned = cameras_of(other)[2:] + cameras_of(other)[:2]
    moved = [
        type(c)(
            f"c{k}",
            c.intrinsics,
            se3.compose(se3.exp(np.array([0.03, -0.05, 0.02, 0.1, 0.15, -0.2])), c.T_camera_tracker),
        )
        for k, c in enumerate(turned)
    ]
    write_cameras(moved, tmp_path / "wrong.json")
    words = ["track", *recorded.views, "--cameras", tmp_path / "wrong.json", "--output", tmp_path / "log.csv"]
    assert_refused(vision(*words), "calibration does not fit the pictures")


def test_wrong_colours_and_wrong_sizes_are_named(vision: Vision, recorded: _Recorded, tmp_path: Path) -> None:
    """A colour that is nowhere (with those that are there), balls of other sizes or distances: no camera is blamed."""
    first = replace(recorded, views=_beginnings(recorded, tmp_path, 1))
    target = tmp_path / "target.toml"
    target.write_text('[[ball]]\nname = "violet"\nhue = 285.0\nhue_tolerance = 8.0\n')
    assert_refused(
        vision(*_track(first, tmp_path / "l.csv", "--target", target)), "ball violet cannot be found", "red (hue"
    )
    rows = {"green": (0, -0.038, 0), "yellow": (0.038, 0, 0), "red": (0, 0.038, 0)}
    wrong = [(1.0, r, "has a radius of") for r in (0.004, 0.006, 0.014, 0.019)]
    wrong += [(k, 0.0095, "apart in the pictures") for k in (0.5, 0.85, 0.95, 1.05, 1.15, 2.0)]
    for scale, radius, word in wrong:
        balls = [{"name": n, "place": [scale * v for v in p], "radius": radius} for n, p in rows.items()]
        (tmp_path / "target.json").write_text(json.dumps({"ball": balls}))
        assert_refused(
            vision(*_track(first, tmp_path / "l.csv", "--target", tmp_path / "target.json")), word, "target file"
        )


def test_a_recording_that_breaks_off_is_named_and_kept(vision: Vision, recorded: _Recorded, tmp_path: Path) -> None:
    """One camera ends early and one picture is unreadable: both reported, every frame in the log, none invented."""
    views = [shutil.copytree(view, tmp_path / view.name) for view in recorded.views]
    for i in range(5, FRAMES):
        (views[3] / f"{i:04d}.png").unlink()
    (views[2] / "0002.png").write_bytes((views[2] / "0002.png").read_bytes()[:300])
    outcome = vision(*_track(replace(recorded, views=views), tmp_path / "log.csv"))
    assert outcome.code == 0, outcome.err
    assert "view3 ends after 5 of 8 frames" in outcome.said
    assert "view2: 1 pictures cannot be read, the first is number 3" in outcome.said
    log = read_log(tmp_path / "log.csv")
    assert len(log) == FRAMES
    known = log.extra["tracking_status"] == 0
    error = 1e3 * np.linalg.norm(log.tracker_cp.position - recorded.poses[:, :3, 3], axis=1)
    assert known.sum() >= FRAMES - 1
    assert error[known].max() < 0.4


def test_a_truncated_video_is_named(vision: Vision, recorded: _Recorded, tmp_path: Path) -> None:
    """A video cut in its middle is read as far as it goes, or refused when nothing of it can be read."""
    videos = [_video(view, tmp_path / f"{view.name}.avi") for view in recorded.views]
    whole = videos[1].read_bytes()
    videos[1].write_bytes(whole[: len(whole) * 6 // 10])
    outcome = vision("track", *videos, "--cameras", recorded.folder / "cameras.json", "--output", tmp_path / "log.csv")
    assert outcome.code == 0, outcome.err
    assert "view1.avi ends after" in outcome.said
    videos[1].write_bytes(whole[:60])
    assert_refused(
        vision("track", *videos, "--cameras", recorded.folder / "cameras.json", "--output", tmp_path / "l.csv"),
        "truncated",
    )


def _video(view: Path, path: Path) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (640, 480))
    for file in sorted(view.iterdir()):
        writer.write(cv2.imread(str(file)))
    writer.release()
    return path


def test_a_ball_out_of_sight_leaves_rows_empty(vision: Vision, recorded: _Recorded, tmp_path: Path) -> None:
    """Without one of its balls the tool has no pose: those rows are coasted and marked, then empty."""
    views = _beginnings(recorded, tmp_path, 2)
    stage = recorded.stage
    bare = Stage(stage.lenses, stage.studios, {n: p for n, p in stage.places.items() if n != "yellow"})
    for i in range(2, 6):
        for view, image in zip(views, bare.frame(recorded.poses[i]), strict=True):
            cv2.imwrite(str(view / f"{i:04d}.png"), image)
    words = ["track", *views, "--cameras", recorded.folder / "cameras.json", "-o", tmp_path / "log.csv", "--fps", 4]
    outcome = vision(*words)
    assert outcome.code == 0, outcome.err
    assert "Ball yellow is seen by fewer than two cameras" in outcome.said
    log = read_log(tmp_path / "log.csv")
    assert log.extra["tracking_status"].tolist() == [0, 0, 1, 1, 2, 2]
    assert np.isfinite(log.tracker_cp.position).all(axis=1).tolist() == [True] * 4 + [False] * 2
    assert np.isnan(log.extra["ball_yellow_x"][2:]).all()
    outcome = vision(*words, "--measured-only")
    measured = read_log(tmp_path / "log.csv").tracker_cp
    assert measured is not None
    assert np.isfinite(measured.position).all(axis=1).tolist() == [True] * 2 + [False] * 4


def test_files_that_are_not_what_they_should_be_are_refused(
    vision: Vision, recorded: _Recorded, tmp_path: Path
) -> None:
    """Missing, empty or foreign files, wrong counts and wrong sizes: each says what was expected."""
    calibration = recorded.folder / "cameras.json"
    assert_refused(vision(*_track(recorded, tmp_path / "log.txt")), ".csv or .parquet")
    assert_refused(
        vision("track", *recorded.views[:2], "-c", calibration, "-o", tmp_path / "l.csv"), "2 recordings", "4 cameras"
    )
    assert_refused(
        vision("track", tmp_path / "no", *recorded.views[1:], "-c", calibration, "-o", tmp_path / "l.csv"),
        "no such video",
    )
    (tmp_path / "empty").mkdir()
    assert_refused(
        vision("track", tmp_path / "empty", *recorded.views[1:], "-c", calibration, "-o", tmp_path / "l.csv"),
        "no images",
    )
    plain = json.loads(calibration.read_text())
    for change, word in (
        ({"focal": 3}, "focal"),
        ({"matrix": [[1, 2], [3, 4]]}, "matrix"),
        ({"name": "cam1"}, "same name"),
    ):
        row: dict[str, Any] = {**plain["cameras"][0], **change}
        (tmp_path / "bad.json").write_text(json.dumps({**plain, "cameras": [row, *plain["cameras"][1:]]}))
        assert_refused(
            vision("track", *recorded.views, "-c", tmp_path / "bad.json", "-o", tmp_path / "l.csv"), "bad.json", word
        )
    small = [
        type(c)(c.name, type(c.intrinsics)(320, 240, c.intrinsics.matrix), c.T_camera_tracker)
        for c in read_cameras(calibration)
    ]
    write_cameras(small, tmp_path / "small.json")
    assert_refused(
        vision("track", *recorded.views, "-c", tmp_path / "small.json", "-o", tmp_path / "l.csv"),
        "320 x 240",
        "640 x 480",
    )


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a rig file with rendered pictures of two cameras: boards, the board at its place, and the markers."""
    folder = tmp_path_factory.mktemp("rig")
    rng = np.random.default_rng(SEED)
    text = ["[board]", "columns = 9", "rows = 6", "square = 0.015", "[markers]"]
    text += [f"m{k} = {place.tolist()}" for k, place in enumerate(marker_points())]
    for k, lens in enumerate(four_cameras(rng)[:2]):
        studio = Studio(lens, backdrop(lens.size, rng, pieces=0), noise=1.0, rng=rng)
        (folder / f"boards{k}").mkdir()
        for i in range(6):
            image = board_picture(studio, board_before(lens, rng))
            cv2.imwrite(str(folder / f"boards{k}" / f"{i}.png"), image)
        x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        at = Board(9, 6, 0.015, np.array([-0.06, -0.0375, 0.1]), x, y)
        cv2.imwrite(str(folder / f"place{k}.png"), board_picture(studio, at))
        dots = [Ball(place, 0.0025, (20.0, 20.0, 20.0), 0.0) for place in marker_points()]
        cv2.imwrite(str(folder / f"markers{k}.png"), studio.photograph(dots))
        np.savetxt(folder / f"truth{k}.txt", place_of(lens))
        text += ["[[camera]]", f'name = "cam{k}"', f'boards = "boards{k}/*.png"', f'markers = "markers{k}.png"']
        text += [
            f'board_at = {{picture = "place{k}.png", position = [-0.058, -0.039, 0.103], rotvec = [0.02, 0.01, -0.02]}}'
        ]
    (folder / "rig.toml").write_text("\n".join(text))
    return folder / "rig.toml"


def test_pictures_become_a_calibration(vision: Vision, rig: Path, tmp_path: Path) -> None:
    """Boards, one board at its rough place and dots at known points place both cameras to a millimetre, with a page."""
    output, page = tmp_path / "cameras.json", tmp_path / "page.html"
    outcome = vision("calibrate", rig, "--output", output, "--report", page, "--json")
    assert outcome.code == 0, outcome.err
    for k, (camera, row) in enumerate(zip(read_cameras(output), json.loads(outcome.out)["cameras"], strict=True)):
        true = se3.invert(np.loadtxt(rig.parent / f"truth{k}.txt"))[:3, 3]
        assert np.linalg.norm(camera.position - true) < 1.5e-3
        assert row["boards_used"] == 6
        assert row["markers"] >= 12
        assert row["moved_from_rough_mm"] > 1.0
        assert np.linalg.norm(camera.position - true) < 4e-3 * row["position_std_mm"]
    assert "Where each marker is seen" in page.read_text()


def test_calibrations_that_cannot_be_are_refused(vision: Vision, rig: Path, tmp_path: Path) -> None:
    """No chessboard of that size, markers without a place, swapped pictures of places, and pictures not there."""
    text, folder = rig.read_text(), rig.parent
    cases = [
        (text.replace("columns = 9", "columns = 12"), ["camera cam0", "no chessboard of 12 x 6 inner corners"]),
        (text.replace("square = 0.015", "square = 15"), ["1 to 500 mm", "in a rig file in metres"]),
        (text.replace('"boards1/*.png"', '"nowhere/*.png"'), ["no pictures", "nowhere"]),
        (text.replace('"markers0.png"', "{m0 = [nan, 2.0]}"), ["camera.0.markers", "finite"]),
        (text.replace('"markers0.png"', "{m0 = [1.0, 2.0]}"), ["camera cam0", "at least 6 known points; got 1"]),
        (text.replace('"markers0.png"', '"latin.csv"'), ["latin.csv", "marker, u, v"]),
        (text.replace('"markers0.png"', '"empty.csv"'), ["empty.csv", "no pixel of m0"]),
        (text.replace('"markers0.png"', "{ghost = [1.0, 2.0]}"), ["camera cam0", "without a place: ghost"]),
        (text.replace("columns = 9", "columns = 9\ncolour = 1"), ["board.colour"]),
        (text.replace('picture = "place0.png"', 'picture = "boards0/none.png"'), ["no picture"]),
        (text.replace('picture = "place0.png"', 'picture = "markers0.png"'), ["camera cam0", "no chessboard", "place"]),
    ]
    (folder / "latin.csv").write_bytes("marker,u,v\nm0,1,2 \xb5\n".encode("latin-1"))
    (folder / "empty.csv").write_bytes("\ufeffmarker, u, v\n m0, nan, 2\n".encode())
    for i, (changed, saying) in enumerate(cases):
        (folder / f"bad{i}.toml").write_text(changed)
        assert_refused(vision("calibrate", folder / f"bad{i}.toml", "--output", tmp_path / "c.json"), *saying)
    assert not (tmp_path / "c.json").exists()


def test_swapped_markers_are_named(vision: Vision, rig: Path, tmp_path: Path) -> None:
    """Marker pixels of two cameras in each other's place: both are named, and which would fit."""
    rng = np.random.default_rng(SEED)
    lenses = four_cameras(rng)[:2]
    text = rig.read_text()
    for k in range(2):
        seen = ", ".join(f"m{i} = {p.tolist()}" for i, p in enumerate(lenses[1 - k].pixels(marker_points())))
        text = text.replace(f'"markers{k}.png"', f"{{{seen}}}")
    (rig.parent / "swapped.toml").write_text(text)
    assert_refused(
        vision("calibrate", rig.parent / "swapped.toml", "-o", tmp_path / "c.json"),
        "cameras are swapped",
        "cam0",
        "cam1",
    )
