"""Calibrate from a published set of pictures of two cameras, and print what is left beside the published figures.

    python bench/vision_published.py [FOLDER]

The pictures are OpenCV's own stereo samples (left01.jpg, right01.jpg, ..., 13 pairs of a board of 9 x 6 corners, 25
mm) and its result for the left camera, left_intrinsics.yml. They are in `samples/data` of OpenCV's sources, and in
Debian's package opencv-doc, whose place is looked at without FOLDER. They are read where they are.

`gpcorrect vision rig` and `gpcorrect vision calibrate` do the work. The place of each camera comes from one pair; the
other pairs, which it has not seen, are measured with the two cameras: how long are the sides of the squares? OpenCV's
`stereoCalibrate`, which has all pairs at once, is the peer in the same run.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from support import print_table, save_results

from gpcorrect import se3
from gpcorrect.types import FloatArray
from gpcorrect.vision import Camera, Chessboard, Intrinsics, find_corners, read_cameras, triangulate
from gpcorrect.vision.opencv import cv2
from gpcorrect.vision.sources import read_image

DEBIAN = Path("/usr/share/doc/opencv-doc/examples/data")
BOARD = Chessboard(9, 6, 0.025)  # as left_intrinsics.yml says
SIDES = ("left", "right")


def calibrated(samples: Path, folder: Path) -> tuple[list[dict[str, Any]], tuple[Camera, ...]]:
    """Return what `vision calibrate` says of each camera, and its calibration file's cameras."""
    for side in SIDES:
        (folder / side).mkdir()
        for file in sorted(samples.glob(f"{side}[0-9]*.jpg")):
            (folder / side / file.name.removeprefix(side)).symlink_to(file.resolve())
    command = [sys.executable, "-m", "gpcorrect", "vision"]
    square = str(1e3 * BOARD.square)
    subprocess.run([*command, "rig", *SIDES, "--square", square, "--json"], cwd=folder, check=True, capture_output=True)
    done = subprocess.run(
        [*command, "calibrate", "rig.toml", "--json"], cwd=folder, check=True, capture_output=True, text=True
    )
    return json.loads(done.stdout)["cameras"], read_cameras(folder / "cameras.json")


def sides_mm(pairs: list[list[FloatArray]], cameras: tuple[Camera, ...]) -> FloatArray:
    """Return every side of every square between inner corners, as the two cameras measure it, mm."""
    found = []
    for pair in pairs:
        rays = np.stack([c.intrinsics.normalised(pixels) for c, pixels in zip(cameras, pair, strict=True)], axis=1)
        alike = np.stack([np.eye(2) / c.intrinsics.focal**2 for c in cameras])
        points = np.array([triangulate(cameras, ray, alike).position for ray in rays])
        grid = points.reshape(BOARD.rows, BOARD.columns, 3)
        found += [np.linalg.norm(np.diff(grid, axis=axis), axis=2).ravel() for axis in (0, 1)]
    return 1e3 * np.concatenate(found)


def stereo_calibrated(pairs: list[list[FloatArray]], size: tuple[int, int]) -> tuple[float, tuple[Camera, ...]]:
    """Return what OpenCV leaves of all pairs at once, px, and its cameras."""
    points = [BOARD.points.astype(np.float32)] * len(pairs)
    left, right = ([pair[k].astype(np.float32) for pair in pairs] for k in range(2))
    lenses = [cv2.calibrateCamera(points, corners, size, None, None)[1:3] for corners in (left, right)]
    (K, d), (K2, d2) = lenses
    rms, K, d, K2, d2, R, t, *_ = cv2.stereoCalibrate(points, left, right, K, d, K2, d2, size, flags=0)
    T = se3.pose(R, np.ravel(t))
    both = zip(SIDES, ((K, d), (K2, d2)), (np.eye(4), T), strict=True)
    return rms, tuple(Camera(name, Intrinsics(*size, K, np.ravel(d)[:5]), T) for name, (K, d), T in both)


def main() -> None:
    """Print what each leaves."""
    samples = Path(sys.argv[1]) if len(sys.argv) > 1 else DEBIAN
    if not (samples / "left_intrinsics.yml").is_file():
        sys.exit(f"skipped: {samples} does not hold OpenCV's samples (Debian: opencv-doc; or name their folder)")
    with tempfile.TemporaryDirectory() as folder:
        reports, cameras = calibrated(samples, Path(folder))
    printed = cv2.FileStorage(str(samples / "left_intrinsics.yml"), cv2.FILE_STORAGE_READ)
    files = sorted(samples.glob("left[0-9]*.jpg"))
    images = [[read_image(f.with_name(f.name.replace("left", side))) for side in SIDES] for f in files]
    pairs = [[corners for image in pair if (corners := find_corners(image, BOARD)) is not None] for pair in images]
    pairs = [pair for pair in pairs if len(pair) == len(SIDES)]
    rms, peers = stereo_calibrated(pairs, (images[0][0].shape[1], images[0][0].shape[0]))
    rows: list[list[Any]] = [
        ["left, printed by OpenCV", printed.getNode("nframes").real(), printed.getNode("avg_reprojection_error").real()]
    ]
    rows[0].append(printed.getNode("camera_matrix").mat()[0, 0])
    rows += [
        [name, r["boards_used"], r["corner_rms_px"], r["focal_px"]] for name, r in zip(SIDES, reports, strict=True)
    ]
    print_table(["one camera", "boards", "reprojection px", "focal px"], rows)
    rows = []
    for name, pair in (
        ("placed by the first pair", cameras),
        (f"OpenCV, all {len(pairs)} pairs ({rms:.3f} px)", peers),
    ):
        lengths = sides_mm(pairs[1:], pair)
        apart = 1e3 * float(np.linalg.norm(pair[0].position - pair[1].position))
        rows.append([name, apart, float(lengths.mean()), float(lengths.std())])
    print_table(["two cameras", "apart mm", "side of a square mm (25)", "SD mm"], rows)
    save_results("vision_published", {"one": reports, "two": rows})


if __name__ == "__main__":
    main()
