"""What used to pass for good: pictures paired by number, idle cameras, balls that moved, pictures of another size."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from board_pictures import board_picture
from command_line import CommandLine, Outcome, assert_refused
from vision_support import board_before, cameras_of, path_of, record

from gpcorrect.logs import read_log
from gpcorrect.types import FloatArray
from gpcorrect.vision import END_EFFECTOR, Tracker, read_cameras, write_cameras
from gpcorrect.vision import single_ball as single_target
from gpcorrect.vision.opencv import cv2
from gpcorrect_studies.rendering import Ball, Stage, Studio, backdrop, four_cameras, single_ball

SEED, FRAMES, RATE = 411, 16, 30.0
TARGET = """
ball = [{{name = "green", place = [0.0, -0.038, 0.0]}}, {{name = "yellow", place = [0.038, 0.0, 0.0]}},
        {{name = "red", place = [0.0, {red}, 0.0]}}]
"""


@pytest.fixture(scope="module")
def stage() -> Stage:
    """Return four cameras before a plain background."""
    return Stage.standard(SEED, pieces=0)


@pytest.fixture(scope="module")
def poses() -> FloatArray:
    """Return where the tool is, frame by frame."""
    return path_of(SEED, FRAMES, RATE)


@pytest.fixture(scope="module")
def views(stage: Stage, poses: FloatArray, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Return a folder a camera; the calibration is beside them."""
    return record(tmp_path_factory.mktemp("doubts"), stage, poses)


def _track(gpcorrect: CommandLine, views: Sequence[Path], output: Path, *more: object) -> Outcome:
    return gpcorrect("vision", "track", *views, "--output", output, *more)


def _named_by_time(views: Sequence[Path], folder: Path, lost: dict[int, int], late: float = 0.0) -> list[Path]:
    """Copy pictures under the times at which they were taken; `lost`: frames of which a camera has none."""
    for k, view in enumerate(views):
        (folder / view.name).mkdir()
        for i, file in enumerate(sorted(view.iterdir())):
            if lost.get(k) != i:
                shutil.copy(file, folder / view.name / f"{1000 + i / RATE + (late if k == 1 else 0.0):.6f}.png")
    return [folder / view.name for view in views]


def test_images_named_by_their_times_are_paired_by_them(
    gpcorrect: CommandLine, views: list[Path], poses: FloatArray, tmp_path: Path
) -> None:
    """Every camera but the first lost one picture, each another: still within 0.3 mm, and the frames are named."""
    named = _named_by_time(views, tmp_path, {1: 4, 2: 7, 3: 10})
    outcome = _track(gpcorrect, named, tmp_path / "log.csv", "--cameras", views[0].parent / "cameras.json", "--json")
    assert outcome.code == 0, outcome.err
    log = read_log(tmp_path / "log.csv")
    error = np.linalg.norm(log.tracker_cp.position - poses[:, :3, 3], axis=1)
    assert error.max() < 3e-4
    for k in (1, 2, 3):
        assert f"view{k} has no picture within 17 ms of view0's in 1 of 16 frames." in outcome.json["remarks"]


def test_a_number_that_names_skip_is_a_lost_picture(
    gpcorrect: CommandLine, views: list[Path], poses: FloatArray, tmp_path: Path
) -> None:
    """Two cameras, of which one has no picture under one number: those after it keep their moments, and it is named."""
    pair = [Path(shutil.copytree(view, tmp_path / view.name)) for view in views[:2]]
    sorted(pair[1].iterdir())[4].unlink()
    write_cameras(read_cameras(views[0].parent / "cameras.json")[:2], tmp_path / "pair.json")
    outcome = _track(gpcorrect, pair, tmp_path / "log.csv", "--cameras", tmp_path / "pair.json", "--json")
    assert outcome.code == 0, outcome.err
    log = read_log(tmp_path / "log.csv")
    measured = log.extra["tracking_status"] == 0
    assert measured[[*range(4), *range(8, FRAMES)]].all()
    error = np.linalg.norm(log.tracker_cp.position - poses[:, :3, 3], axis=1)
    assert error[measured].max() < 1e-3
    assert "view1 lacks 1 of 16 pictures; the first is number" in " ".join(outcome.json["remarks"])


def test_times_that_say_nothing_are_refused(gpcorrect: CommandLine, views: list[Path], tmp_path: Path) -> None:
    """Two clocks that have nothing in common, videos of different rates, a table of too few times, no rate at all."""
    cameras = ("--cameras", views[0].parent / "cameras.json")
    (tmp_path / "named").mkdir()
    apart = _named_by_time(views, tmp_path / "named", {}, late=60.0)
    output = tmp_path / "log.csv"
    assert_refused(_track(gpcorrect, apart, output, *cameras), "no picture of view1", "view0", "--fps")
    videos = []
    for k, view in enumerate(views):
        videos.append(tmp_path / f"{view.name}.avi")
        code = cv2.VideoWriter_fourcc(*"MJPG")
        video = cv2.VideoWriter(str(videos[-1]), code, 25.0 if k == 0 else RATE, (640, 480))
        for file in sorted(view.iterdir()):
            video.write(cv2.imread(str(file)))
        video.release()
    assert_refused(_track(gpcorrect, videos, output, *cameras), "different frame rates", "view0.avi 25", "view1.avi 30")
    assert_refused(_track(gpcorrect, videos, output, *cameras, "--fps", 0), "above zero")
    (tmp_path / "film").mkdir()
    for video_file in videos:
        video_file.rename(tmp_path / "film" / video_file.name)
    (tmp_path / "film" / "times.csv").write_text("view0\n" + "".join(f"{i / RATE}\n" for i in range(FRAMES - 2)))
    assert_refused(_track(gpcorrect, [tmp_path / "film"], output, *cameras), "14 times", "16 pictures")
    assert not output.exists()


def test_a_camera_that_adds_nothing_is_named(gpcorrect: CommandLine, views: list[Path], tmp_path: Path) -> None:
    """One camera of four is dark all along: the log is right without it, and says so."""
    dark = tmp_path / "dark"
    dark.mkdir()
    for file in views[2].iterdir():
        cv2.imwrite(str(dark / file.name), np.zeros((480, 640, 3), np.uint8))
    words = [*views[:2], dark, views[3]]
    outcome = _track(
        gpcorrect, words, tmp_path / "log.csv", "--cameras", views[0].parent / "cameras.json", "--fps", RATE, "--json"
    )
    assert outcome.code == 0, outcome.err
    assert [remark for remark in outcome.json["remarks"] if remark.startswith("Camera")] == [
        "Camera cam2 adds nothing to 100 % of the measured frames: is it dark, late, or placed wrongly?"
    ]


def test_pictures_that_come_twice_are_named(gpcorrect: CommandLine, views: list[Path], tmp_path: Path) -> None:
    """A recorder that writes every picture of a slow camera twice: the log says so, for that camera alone."""
    slow = tmp_path / "slow"
    slow.mkdir()
    for i, file in enumerate(sorted(views[1].iterdir())[::2]):
        for k in (0, 1):
            shutil.copy(file, slow / f"{2 * i + k:04d}.png")
    cameras = views[0].parent / "cameras.json"
    words = [views[0], slow, *views[2:]]
    outcome = _track(gpcorrect, words, tmp_path / "log.csv", "--cameras", cameras, "--fps", RATE, "--json")
    assert outcome.code == 0, outcome.err
    assert [remark for remark in outcome.json["remarks"] if "before again" in remark] == [
        "slow: 8 of 16 pictures are the one before again: what they show was earlier than their times say."
    ]


@pytest.mark.parametrize("knocked", ["two cameras", "all pictures cropped"])
def test_of_cameras_that_contradict_each_other_none_is_blamed(
    gpcorrect: CommandLine, views: list[Path], poses: FloatArray, tmp_path: Path, knocked: str
) -> None:
    """Two of four cameras shifted, or a crop of the calibration's size: it is said, and errors are as stated."""
    changed = [tmp_path / view.name for view in views]
    for k, (view, folder) in enumerate(zip(views, changed, strict=True)):
        folder.mkdir()
        for file in view.iterdir():
            picture = cv2.imread(str(file))
            if knocked == "two cameras":
                shift = np.array([[1.0, 0.0, (0.0, 4.0, 0.0, -4.0)[k]], [0.0, 1.0, 0.0]])
                picture = cv2.warpAffine(picture, shift, (640, 480), borderMode=cv2.BORDER_REPLICATE)
            else:
                picture = cv2.resize(picture[12:468], (640, 480))
            cv2.imwrite(str(folder / file.name), picture)
    cameras = views[0].parent / "cameras.json"
    outcome = _track(gpcorrect, changed, tmp_path / "log.csv", "--cameras", cameras, "--fps", RATE, "--json")
    assert outcome.code == 0, outcome.err
    assert any("which cameras are wrong cannot be told" in remark for remark in outcome.json["remarks"])
    assert not any(remark.startswith("Camera ") for remark in outcome.json["remarks"])
    log = read_log(tmp_path / "log.csv")
    off = log.tracker_cp.position - poses[:, :3, 3]
    std = np.stack([log.extra[f"tracker_std_{axis}"] for axis in "xyz"], axis=1)
    assert np.linalg.norm(off, axis=1).mean() > 3e-4
    assert np.mean((off / std) ** 2) < 4.0


@pytest.mark.parametrize("moved", [0.0, 0.002])
def test_a_ball_that_is_not_where_the_target_says_is_named(
    gpcorrect: CommandLine, views: list[Path], tmp_path: Path, moved: float
) -> None:
    """The red ball is 2 mm beside its place: the remark has the distance; where it is right, there is none."""
    (tmp_path / "tool.toml").write_text(TARGET.format(red=0.038 - moved))
    cameras = views[0].parent / "cameras.json"
    words = ["--cameras", cameras, "--target", tmp_path / "tool.toml", "--fps", RATE, "--json"]
    outcome = _track(gpcorrect, views, tmp_path / "log.csv", *words)
    assert outcome.code == 0, outcome.err
    said = [remark for remark in outcome.json["remarks"] if remark.startswith("Balls green and red")]
    assert len(said) == (1 if moved else 0)
    assert not moved or "76.0 mm apart in the pictures from 0.0 s on, 74.0 mm in the target file" in said[0]


def test_of_two_lone_balls_that_move_none_is_taken() -> None:
    """Another red ball of the size moves too: none is reported while both are seen, and the one that stays is."""
    stage = Stage.standard(SEED, single_ball("red"), pieces=0)
    path, other = path_of(SEED, 14, 15.0), path_of(SEED + 1, 14, 15.0)
    away, found = np.array([0.0, -0.09, 0.02]), []
    with Tracker(cameras_of(stage), single_target("red")) as tracker:
        for i in range(14):
            balls = stage.balls(path[i])
            decoy = Ball(other[i][:3, 3] + away, stage.radius, (200.0, 35.0, 35.0))
            shown = [studio.photograph([*balls, decoy] if i < 8 else balls) for studio in stage.studios]
            frame = tracker.step(shown, i / 15.0)
            found.append(frame.measured is not None)
            assert not found[-1] or np.linalg.norm(frame.pose.T_tracker_tool[:3, 3] - path[i][:3, 3]) < 1e-3
    assert not any(found[:8])
    assert found[-1]


def test_balls_in_plain_sight_of_a_lost_tool_are_not_called_hidden(stage: Stage) -> None:
    """One ball of three is hidden until the tool is lost: every camera is said to see the other two, and not it."""
    with Tracker(cameras_of(stage), END_EFFECTOR) as tracker:
        for i, pose in enumerate(path_of(SEED, 20, 15.0)):
            shown = stage.balls(pose)[: 3 if i < 4 else 2]
            frame = tracker.step([studio.photograph(shown) for studio in stage.studios], i / 15.0)
    assert frame.pose.status == "lost"
    assert [sum(row[b].effective for row in frame.views) for b in range(3)] == [4, 4, 0]


def test_a_jump_that_two_cameras_see_must_show_again(stage: Stage, poses: FloatArray) -> None:
    """The tool is 2 cm away in one picture: no measured row says so; where it stays away, it is followed there."""
    away = np.array([0.0, 0.02, 0.0])
    states = []
    with Tracker(cameras_of(stage)[:2], END_EFFECTOR) as tracker:
        for i in range(FRAMES):
            pose = np.array(poses[i])
            pose[:3, 3] += away if i == 6 or i >= 9 else 0.0
            frame = tracker.step([studio.photograph(stage.balls(pose)) for studio in stage.studios[:2]], i / RATE)
            states.append(frame.pose.status.value)
            wrong = np.linalg.norm(frame.pose.T_tracker_tool[:3, 3] - pose[:3, 3])
            assert states[-1] != "measured" or wrong < 1e-3
    assert states[6] == "coasting"
    assert states[7:9] == ["measured", "measured"]
    assert states[13:] == ["measured"] * (FRAMES - 13)


def test_pictures_of_another_size_are_named_as_such(gpcorrect: CommandLine, views: list[Path], tmp_path: Path) -> None:
    """A calibration at twice the size: the first look says so, and does not blame the calibration's places."""
    double = [
        replace(c, intrinsics=type(c.intrinsics)(1280, 960, np.diag([2.0, 2.0, 1.0]) @ c.intrinsics.matrix))
        for c in read_cameras(views[0].parent / "cameras.json")
    ]
    write_cameras(double, tmp_path / "double.json")
    outcome = _track(gpcorrect, views, tmp_path / "log.csv", "--cameras", tmp_path / "double.json")
    assert_refused(outcome, "1280 x 960", "640 x 480")


def test_calibrations_that_are_none_are_refused(gpcorrect: CommandLine, views: list[Path], tmp_path: Path) -> None:
    """A matrix that is transposed, mirrored or skewed, and a place with a shear or a transposed one."""
    plain = json.loads((views[0].parent / "cameras.json").read_text())
    K, T = np.array(plain["cameras"][0]["matrix"]), np.array(plain["cameras"][0]["T_camera_tracker"])
    shear = np.diag([1.05, 1.0 / 1.05, 1.0, 1.0])
    for change, saying in (
        ({"matrix": K.T.tolist()}, "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"),
        ({"matrix": (np.diag([-1.0, 1.0, 1.0]) @ K).tolist()}, "above zero"),
        ({"distortion": [float("nan"), 0.0, 0.0, 0.0]}, "finite"),
        ({"T_camera_tracker": (T @ shear).tolist()}, "no rigid motion"),
        ({"T_camera_tracker": T.T.tolist()}, "no rigid motion"),
    ):
        row = {**plain["cameras"][0], **change}
        (tmp_path / "bad.json").write_text(json.dumps({**plain, "cameras": [row, *plain["cameras"][1:]]}))
        words = ("--cameras", tmp_path / "bad.json")
        assert_refused(_track(gpcorrect, views, tmp_path / "log.csv", *words), "bad.json", saying)


def test_a_wrong_lens_accuses_no_camera_of_being_swapped(
    gpcorrect: CommandLine, stage: Stage, views: list[Path], tmp_path: Path
) -> None:
    """The middles of all pictures are 12 px off: no order of the cameras is said to be the true one."""
    off = np.array([[0.0, 0.0, 12.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    wrong = [replace(c, intrinsics=replace(c.intrinsics, matrix=c.intrinsics.matrix + off)) for c in cameras_of(stage)]
    write_cameras(wrong, tmp_path / "wrong.json")
    outcome = _track(gpcorrect, views, tmp_path / "log.csv", "--cameras", tmp_path / "wrong.json")
    assert_refused(outcome, "the calibration does not fit the pictures")


def test_a_log_s_place_is_checked_before_the_work(
    gpcorrect: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A description of another log under the name of the new one's is found before the vision part is loaded."""
    (tmp_path / "log.toml").write_text("")
    monkeypatch.setitem(sys.modules, "gpcorrect.vision", None)  # importing it is an error now
    outcome = _track(gpcorrect, [tmp_path / "none"], tmp_path / "log.csv")
    assert_refused(outcome, "log.toml is there already")


def test_the_picture_of_the_place_is_the_one_that_counts(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """A blurred `place` is not replaced by a picture of other moments; without any, the picture taken is named.

    Nor is one believed that has another size than the boards.
    """
    rng = np.random.default_rng(SEED)
    lenses = four_cameras(rng)[:2]
    for k, lens in enumerate(lenses):
        (tmp_path / f"cam{k}").mkdir()
        studio = Studio(lens, backdrop(lens.size, rng, pieces=0), noise=1.0, rng=rng)
        for i in range(3):
            cv2.imwrite(str(tmp_path / f"cam{k}" / f"{i}.png"), board_picture(studio, board_before(lens, rng)))
    folders = [tmp_path / "cam0", tmp_path / "cam1"]
    metres = gpcorrect("vision", "rig", *folders, "--square", 0.015, "--output", tmp_path / "rig.toml")
    assert_refused(metres, "1 to 500 mm", "--square is in millimetres")
    outcome = gpcorrect("vision", "rig", *folders, "--square", 15, "--output", tmp_path / "rig.toml")
    assert outcome.code == 0
    assert "0 of every folder is taken for one moment" in outcome.said
    big = cv2.resize(cv2.imread(str(folders[1] / "0.png")), None, fx=2.0, fy=2.0)
    cv2.imwrite(str(tmp_path / "big.png"), big)
    text = (tmp_path / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(text.replace('picture = "cam1/0.png"', 'picture = "big.png"'))
    refused = gpcorrect("vision", "calibrate", tmp_path / "rig.toml", "--output", tmp_path / "c.json")
    assert_refused(refused, "camera cam1", "1280 x 960")
    shutil.copy(folders[0] / "0.png", folders[0] / "place.png")
    cv2.imwrite(str(folders[1] / "place.png"), np.full((480, 640, 3), 90, np.uint8))
    again = gpcorrect("vision", "rig", *folders, "--square", 15, "--output", tmp_path / "second.toml")
    assert_refused(again, "no picture place in which all of 2 cameras see the board: not cam1.")
