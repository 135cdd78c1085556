"""A recording on disk while it is made: what a killed recorder leaves, and how it is read."""

from __future__ import annotations

import struct
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import msgspec

from gpcorrect.atomic import require_folder, require_new
from gpcorrect.errors import LogError
from gpcorrect_service.crtk.messages import TOPICS, Message

BEGINS = b"gpcorrect recording 1\n"  # first line of a journal, with the number of its form
LENGTH = struct.Struct("<I")
LONGEST = 1 << 16  # bytes of an entry: a hundred joints have a tenth of it
SUFFIX = ".unfinished"  # behind the name of the recording to come


class _Entry(msgspec.Struct, array_like=True):
    """A message as it came: its topic, and how often the robot's clock had been set back."""

    topic: str
    epoch: int
    message: msgspec.Raw


class Journal:
    """Writes messages beside a recording to come, until it is removed because the recording is written.

    A killed process leaves all but its last few dozen messages, a power cut all but the last half minute.

    Parameters
    ----------
    recording : Path, the file to come; the journal has its name and `.unfinished` behind it
    arm : str

    Attributes
    ----------
    path : Path
    failed : OSError or None
        Why messages are not written any more: the disk is full. The recorder goes on without.

    Raises
    ------
    GpCorrectError
        The journal of an earlier recording is there: it is not overwritten.
    """

    def __init__(self, recording: Path, arm: str) -> None:
        self.path = _journal_of(recording)
        self.failed: OSError | None = None
        self._lock = threading.Lock()
        self._file = self.path.open("xb")
        self._file.write(BEGINS + arm.encode() + b"\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            try:
                self._file.close()
            except OSError as full:
                self.failed = self.failed or full

    def remove(self) -> None:
        """Remove the file: the recording is written."""
        self.path.unlink(missing_ok=True)

    def write(self, topic: str, epoch: int, message: Message) -> None:
        """Write a message.

        Parameters
        ----------
        topic : str
        epoch : int, how often the robot's clock had been set back when it came
        message : Struct
        """
        entry = msgspec.msgpack.encode(_Entry(topic, epoch, msgspec.Raw(msgspec.msgpack.encode(message))))
        with self._lock:
            if self.failed is not None or self._file.closed:
                return
            try:
                self._file.write(LENGTH.pack(len(entry)) + entry)
            except OSError as error:
                self.failed = error


def _journal_of(recording: Path) -> Path:
    """Return the name of a recording's journal."""
    return recording.with_name(recording.name + SUFFIX)


def require_no_journal(recording: Path) -> None:
    """Check, before recording, that a journal can be written and that no earlier one would be lost.

    Parameters
    ----------
    recording : path, GpCorrectError where its folder may not be written, or a recording of this name was broken off
    """
    path = _journal_of(recording)
    if path.exists():
        raise LogError(
            "a recording of this name was broken off, and this is what came until then.",
            path=str(path),
            hint=f"Read it: gpcorrect robot recover {path} --output LOG",
        )
    require_new(recording)
    require_folder(path)


def read_journal(path: Path) -> tuple[str, Iterator[tuple[str, int, Any]]]:
    """Return the arm of a journal, and its messages in the order in which they came; a torn end is left out.

    Parameters
    ----------
    path : path, LogError where there is no such file, or no journal, or, while it is read, where it was altered
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LogError(f"it cannot be read ({error.strerror}).", path=str(path)) from error
    head, _, rest = content.removeprefix(BEGINS).partition(b"\n")
    if not content.startswith(BEGINS):
        raise LogError("it is not what a recorder leaves.", path=str(path), hint=f"Its name ends in {SUFFIX}.")
    return head.decode(errors="replace"), _entries(path, memoryview(rest))


def _entries(path: Path, rest: memoryview) -> Iterator[tuple[str, int, Any]]:
    read = msgspec.msgpack.Decoder(_Entry)
    while len(rest) >= LENGTH.size:
        (length,) = LENGTH.unpack(rest[: LENGTH.size])
        if length > LONGEST:  # no torn end, behind which nothing would be lost
            raise _altered(path, f"an entry of {length} bytes")
        body, rest = rest[LENGTH.size : LENGTH.size + length], rest[LENGTH.size + length :]
        if len(body) < length:
            return
        try:
            entry = read.decode(body)
            yield entry.topic, entry.epoch, msgspec.msgpack.decode(entry.message, type=TOPICS[entry.topic].form)
        except (msgspec.MsgspecError, ValueError, KeyError) as error:
            raise _altered(path, str(error)) from error


def _altered(path: Path, why: str) -> LogError:
    return LogError(f"it was altered ({why}).", path=str(path), hint="Copy it again.")
