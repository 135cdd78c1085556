"""Calibration from pictures that others took: OpenCV's own stereo samples, read where they are."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine

from gpcorrect.vision import Chessboard, find_corners, read_cameras, triangulate
from gpcorrect.vision.opencv import cv2
from gpcorrect.vision.sources import read_image

SAMPLES = Path(os.environ.get("GPCORRECT_OPENCV_SAMPLES", "/usr/share/doc/opencv-doc/examples/data"))
SQUARE = 0.025  # m, as OpenCV's left_intrinsics.yml says
SIDES = ("left", "right")


@pytest.mark.skipif(
    not (SAMPLES / "left_intrinsics.yml").is_file(),
    reason="OpenCV's samples are not at hand: install Debian's opencv-doc, or set GPCORRECT_OPENCV_SAMPLES to the "
    "folder samples/data of OpenCV's sources",
)
def test_two_real_cameras_are_calibrated_from_published_pictures(
    gpcorrect: CommandLine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No more is left than OpenCV prints, at its focal length; squares of another pair are 25 mm to a hundredth."""
    monkeypatch.chdir(tmp_path)
    for side in SIDES:
        (tmp_path / side).mkdir()
        for file in SAMPLES.glob(f"{side}[0-9]*.jpg"):
            (tmp_path / side / file.name.removeprefix(side)).symlink_to(file.resolve())
    assert gpcorrect("vision", "rig", *SIDES, "--square", 1e3 * SQUARE).code == 0
    outcome = gpcorrect("vision", "calibrate", "rig.toml", "--json")
    assert outcome.code == 0, outcome.err
    printed = cv2.FileStorage(str(SAMPLES / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    left, right = json.loads(outcome.out)["cameras"]
    assert left["boards_used"] == right["boards_used"] == printed.getNode("nframes").real()
    assert max(left["corner_rms_px"], right["corner_rms_px"]) <= printed.getNode("avg_reprojection_error").real()
    assert left["focal_px"] == pytest.approx(printed.getNode("camera_matrix").mat()[0, 0], rel=0.01)

    cameras, board = read_cameras("cameras.json"), Chessboard(9, 6, SQUARE)
    corners = [find_corners(read_image(tmp_path / side / "14.jpg"), board) for side in SIDES]
    rays = [c.intrinsics.normalised(found) for c, found in zip(cameras, corners, strict=True) if found is not None]
    alike = np.stack([np.eye(2) / c.intrinsics.focal**2 for c in cameras])
    points = np.array([triangulate(cameras, ray, alike).position for ray in np.stack(rays, axis=1)])
    sides = np.linalg.norm(np.diff(points.reshape(board.rows, board.columns, 3), axis=1), axis=2)
    assert sides.mean() == pytest.approx(SQUARE, rel=0.01)
