"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gpcorrect.errors import GpCorrectError

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS)
"""Errors of the disk, not of what is done to other files meanwhile."""
HEAD_BYTES = 256
"""Of a file, by which its kind is known; chosen by hand."""


def require_folder(path: str | Path) -> None:
    """Check, before the work, that a file can be put somewhere.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    GpCorrectError
        Its folder does not exist or may not be written, or something that is no file has its name: a folder, a device.
    """
    folder = Path(path).parent
    if not folder.is_dir():
        raise GpCorrectError(f"cannot write {path}: there is no folder {folder}.", hint="Create the folder first.")
    if Path(path).exists() and not Path(path).is_file():
        raise GpCorrectError(f"cannot write {path}: it is there already, and no file.", hint="Name another output.")
    _require_room(folder, path)


def require_new(path: str | Path) -> None:
    """Check, before the work, that nothing is lost: what cannot be made again is not overwritten.

    Parameters
    ----------
    path : str or Path, the file or folder to come
    """
    if Path(path).exists():
        hint = "Name another one, or move it away."
        raise GpCorrectError(f"{path} is there already: it is not overwritten.", hint=hint)


def require_own(path: str | Path, begins: bytes, what: str) -> None:
    """Check, before the work, that an output has a place, and replaces nothing but an older output of its kind.

    Parameters
    ----------
    path : str or Path
    begins : bytes
        Regular expression of how files of its kind begin.
    what : str
        Their name for messages, such as "model file".

    Raises
    ------
    GpCorrectError
        As :func:`require_folder`; or a file of another kind is there, such as the recording that is read.
    """
    require_folder(path)
    target = Path(path)
    if not target.exists():
        return
    with target.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if head and not re.match(begins, head, re.DOTALL):
        hint = "Name another output, or move it away."
        raise GpCorrectError(f"{path} is there already, and is no {what}: it is not overwritten.", hint=hint)


def _require_room(folder: Path, path: str | Path) -> None:
    """Try to make a file in a folder: rights and read-only disks are known no other way."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise GpCorrectError(
            f"cannot write {path}: {error.strerror}.", hint="Name another output, or make room."
        ) from error


def make_folder(path: str | Path) -> None:
    """Make a folder for results, and those above it, before the work; one that is there stays with what it holds.

    Parameters
    ----------
    path : str or Path

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
    _require_room(Path(path), path)


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """Give a temporary file beside `path` to write, and rename it to `path` when the block ends well.

    A kill, a full disk or an error leaves whatever was at `path` untouched and no half-written file.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    GpCorrectError
        The folder does not exist or cannot be written, or the disk is full.
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
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
        raise GpCorrectError(
            f"cannot write {target}: {error.strerror}.", hint="Make room, or name another output."
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_file(path: str | Path, content: str | bytes) -> None:
    """Write a file, text as UTF-8, so that it appears whole or not at all; raises as :func:`atomic_path`.

    Parameters
    ----------
    path : str or Path
    content : str or bytes
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)
