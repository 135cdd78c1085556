"""A rig file from pictures of a printed board: a folder a camera, and one moment of all of them for the frame."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from gpcorrect.errors import DataError
from gpcorrect.vision.boards import Chessboard, find_corners
from gpcorrect.vision.sources import IMAGES, read_image

PLACE = "place"  # name of the picture of the board where all cameras see it at once


def rig_text(folders: Sequence[Path], board: Chessboard, beside: Path) -> str:
    """Return a rig file (TOML) for cameras that each have a folder of pictures of the board.

    The tracker frame is that of the board in the picture `place` of every folder; without one, in the first picture
    whose name all folders share and in which every camera sees the board.

    Parameters
    ----------
    folders : sequence of Path, one a camera, named as the camera
    board : Chessboard
    beside : Path
        Folder of the rig file: pictures are named from there.

    Raises
    ------
    DataError
        A folder has no pictures, or there is no picture in which all cameras see the board.
    """
    if board.turns_alike:
        raise DataError(
            f"a board of {board.columns} x {board.rows} inner corners looks the same turned by half.",
            hint="Take one even and one odd number, as `gpcorrect vision board` does.",
        )
    pictures: list[dict[str, Path]] = []
    for folder in folders:
        files = sorted(folder.iterdir()) if folder.is_dir() else []
        pictures.append({file.stem: file for file in files if file.suffix.lower() in IMAGES})
        if not pictures[-1]:
            hint = "Give one folder of pictures of the board a camera."
            raise DataError(f"there are no pictures in {folder}.", hint=hint)
    shared = sorted(set.intersection(*(set(one) for one in pictures)), key=lambda name: (name != PLACE, name))
    for name in shared:
        if all(find_corners(read_image(one[name]), board) is not None for one in pictures):
            break
    else:
        raise DataError(
            f"there is no picture of one name in which all of {len(folders)} cameras see the board.",
            hint="Lay the board where every camera sees it, and save that moment as place.png in each folder.",
        )
    lines = ["[board]", f"columns = {board.columns}", f"rows = {board.rows}", f"square = {board.square}"]
    for folder, one in zip(folders, pictures, strict=True):
        where = Path(os.path.relpath(folder, beside)).as_posix()
        lines += ["", "[[camera]]", f'name = "{folder.name}"', f'boards = "{where}"']
        lines += [f'board_at = {{picture = "{where}/{one[name].name}", position = [0.0, 0.0, 0.0]}}']
    return "\n".join(lines) + "\n"
