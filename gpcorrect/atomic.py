"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gpcorrect.errors import GpCorrectError

__all__ = ["atomic_path", "make_folder", "require_folder"]


def require_folder(path: str | Path) -> None:
    """Check, before the work, that a file can be put somewhere.

    Parameters
    ----------
    path : str or Path
        The file to come.

    Raises
    ------
    GpCorrectError
        Its folder does not exist, or something that is no file has its name: a folder, a device.
    """
    folder = Path(path).parent
    if not folder.is_dir():
        raise GpCorrectError(f"cannot write {path}: there is no folder {folder}.", hint="Create the folder first.")
    if Path(path).exists() and not Path(path).is_file():
        raise GpCorrectError(f"cannot write {path}: it is there already, and no file.", hint="Name another output.")


def make_folder(path: str | Path) -> None:
    """Make a folder for results, and those above it, before the work; one that is there stays with what it holds.

    Parameters
    ----------
    path : str or Path
        The folder.

    Raises
    ------
    GpCorrectError
        A file has its name, or it may not be made.
    """
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise GpCorrectError(
            f"cannot make the folder {path} for the results: {error.strerror}.", hint="Name another folder."
        ) from error


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary file beside `path` to write, and rename it to `path` when the block ends well.

    A kill, a full disk or an error leaves whatever was at `path` untouched and no half-written file.

    Parameters
    ----------
    path : str or Path
        The file to come.

    Raises
    ------
    GpCorrectError
        The folder does not exist or cannot be written.
    """
    target = Path(path)
    require_folder(target)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise GpCorrectError(
            f"cannot write {target}: {error.strerror}.", hint="Name another output, or make room."
        ) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)
