"""From a printed board to a calibrated rig without markers, and from cameras to a folder that is tracked."""

from __future__ import annotations

import shutil
import zlib
from pathlib import Path

import numpy as np
from board_pictures import Board, board_picture
from command_line import exit_status
from vision_support import board_before, path_of, place_of, record

from gpcorrect import se3
from gpcorrect.logs import read_log
from gpcorrect.vision import read_cameras, read_rig
from gpcorrect.vision.opencv import cv2
from gpcorrect_studies.rendering import Stage, Studio, backdrop, four_cameras

SEED = 407


def test_the_printed_board_has_its_size(tmp_path: Path) -> None:
    """The PDF is one page of A4 with 35 dark squares of 20 mm; what does not fit, or turns alike, is refused."""
    assert exit_status("vision", "board", "--output", tmp_path / "board.pdf") == 0
    pdf = (tmp_path / "board.pdf").read_bytes()
    assert b"/MediaBox [ 0 0 841.88" in pdf
    streams = [part.split(b"endstream")[0].strip(b"\r\n") for part in pdf.split(b"stream\n")[1:]]
    drawn = next(text for text in map(_inflated, streams) if b" l\n" in text)
    shapes = [shape for shape in drawn.split(b"h\n")[:-1] if shape.count(b" l\n") >= 3]
    sizes = []
    for shape in shapes:
        corners = np.array([line.split()[:2] for line in shape.splitlines() if line[-2:] in (b" m", b" l")], float)
        sizes.append(np.ptp(corners, axis=0) * 25.4 / 72.0)
    assert np.isclose(sizes, 20.0, atol=0.01).all(axis=1).sum() == 35
    assert exit_status("vision", "board", "--square", 40, "--output", tmp_path / "b.pdf") == 2
    assert exit_status("vision", "board", "--columns", 8, "--output", tmp_path / "b.pdf") == 2


def _inflated(stream: bytes) -> bytes:
    try:
        return zlib.decompress(stream)
    except zlib.error:
        return b""


def test_a_printed_board_alone_calibrates(tmp_path: Path) -> None:
    """Two cameras on opposite sides of a board at rest, without markers: their places in its frame to 1.5 mm."""
    rng = np.random.default_rng(SEED)
    lenses = [four_cameras(rng)[k] for k in (0, 2)]
    rest = Board(9, 6, 0.02, np.array([-0.08, -0.05, 0.15]), np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0]))
    T_world_board = se3.pose(np.stack([rest.x, rest.y, np.cross(rest.x, rest.y)], axis=1), rest.origin)
    folders = [tmp_path / name for name in ("front", "back")]
    for folder, lens in zip(folders, lenses, strict=True):
        folder.mkdir()
        studio = Studio(lens, backdrop(lens.size, rng, pieces=0), noise=1.0, rng=rng)
        for i in range(8):
            cv2.imwrite(str(folder / f"{i}.png"), board_picture(studio, board_before(lens, rng, square=0.02)))
        cv2.imwrite(str(folder / "place.png"), board_picture(studio, rest))
    assert exit_status("vision", "rig", *folders, "--output", tmp_path / "rig.toml") == 0
    assert exit_status("vision", "calibrate", tmp_path / "rig.toml", "--output", tmp_path / "cameras.json") == 0
    for lens, camera in zip(lenses, read_cameras(tmp_path / "cameras.json"), strict=True):
        true = se3.invert(se3.compose(place_of(lens), T_world_board))
        assert np.linalg.norm(camera.position - true[:3, 3]) < 1.5e-3
        assert camera.covariance is not None
    alike = [tmp_path / name / "boards" for name in ("left", "right")]
    for folder in alike:
        shutil.copytree(folders[0], folder)
    assert exit_status("vision", "rig", *alike, "--output", tmp_path / "alike.toml") == 2
    assert not (tmp_path / "alike.toml").exists()
    odd = [folders[0].rename(tmp_path / "cam[0]"), folders[1].rename(tmp_path / 'the "back"')]
    assert exit_status("vision", "rig", *odd, "--output", tmp_path / "odd.toml") == 0
    assert [camera.name for camera in read_rig(tmp_path / "odd.toml").cameras] == ["cam[0]", 'the "back"']
    folders = odd
    (folders[0] / "place.png").unlink()
    for i in range(8):
        (folders[1] / f"{i}.png").rename(folders[1] / f"other{i}.png")
    assert exit_status("vision", "rig", *folders, "--output", tmp_path / "rig.toml") == 2


def test_a_recording_is_a_folder_that_is_tracked(tmp_path: Path) -> None:
    """Video files in the place of cameras are recorded with times and tracked; what cannot be opened is refused."""
    stage, poses = Stage.standard(SEED, pieces=5), path_of(SEED, 5)
    videos = []
    for view in record(tmp_path, stage, poses):
        videos.append(tmp_path / f"{view.name}.avi")
        writer = cv2.VideoWriter(str(videos[-1]), cv2.VideoWriter_fourcc(*"MJPG"), 30.0, (640, 480))
        for file in sorted(view.iterdir()):
            writer.write(cv2.imread(str(file)))
        writer.release()
    assert exit_status("vision", "record", *videos, "--output", tmp_path / "monday") == 0
    words = ["track", tmp_path / "monday", "--cameras", tmp_path / "cameras.json", "--output", tmp_path / "log.csv"]
    assert exit_status("vision", *words, "--fps", 30) == 0
    log = read_log(tmp_path / "log.csv")
    assert np.linalg.norm(log.tracker_cp.position - poses[:, :3, 3], axis=1).max() < 0.3e-3
    assert len((tmp_path / "monday" / "times.csv").read_text().splitlines()) == 6
    for missing in (tmp_path / "none.avi", 97, "/dev/video97"):
        assert exit_status("vision", "record", missing, "--output", tmp_path / "tuesday") == 2
