"""ROS 1 bags and ROS 2 recordings (db3, MCAP), through rosbags."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpcorrect.errors import GpCorrectError, LogError, MissingExtraError
from gpcorrect.logs.columns import BagOptions
from gpcorrect.logs.combine import combine
from gpcorrect.logs.crtk import Choice, choose_topics
from gpcorrect.logs.messages import Recorded, Times, joint_row, joint_streams, pose_row, pose_streams
from gpcorrect.logs.raven2 import RAVEN_STATE_DEFINITION, RAVEN_STATE_TYPE, raven_row, raven_streams
from gpcorrect.logs.settings import ReadSettings
from gpcorrect.logs.streams import Stream
from gpcorrect.types import CalibrationLog

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

__all__ = ["read", "read_streams"]

DAMAGED = "the recording cannot be read, it may be cut off or still being written"


def read(path: Path, settings: ReadSettings) -> CalibrationLog:
    """Read a recording of ROS topics onto one clock; see :func:`read_streams`."""
    streams, remarks = read_streams(path, settings.columns.bag)
    bag = settings.columns.bag
    log = combine(streams, bag.base, bag.max_gap, shifts=bag.shifts, disorder=settings.disorder)
    return replace(log, remarks=(*remarks, *log.remarks))


def read_streams(path: Path, options: BagOptions) -> tuple[list[Stream], list[str]]:
    """Signals of a recording, each with its own stamps, in seconds from the start of the recording.

    Parameters
    ----------
    path : Path
        A .bag, .mcap or .db3 file, or the folder of a ROS 2 recording.
    options : BagOptions
        Which robot, arm and tracker, and by whose clock.

    Returns
    -------
    list of Stream
        One for each signal.
    list of str
        Remarks on what was decided or left out.

    Raises
    ------
    LogError
        The recording is damaged, or it does not say which topics to take.
    MissingExtraError
        The library rosbags is not installed.
    """
    with _opened(path) as bag:
        choice = choose_topics({c.topic: c.msgtype for c in bag.connections if c.msgcount}, options)
        recorded = _record(bag, choice)
        origin = bag.start_time
    streams: list[Stream] = []
    remarks = list(choice.remarks)
    for kind, messages in recorded.items():
        times = Times.of(messages, origin, options.clock)
        found, said = _streams(kind, messages, times, options)
        streams += found
        remarks += [*times.remarks, *said]
    return streams, remarks


def _row(kind: str) -> Callable[[Any], Any]:
    if kind == "raven_state":
        return raven_row
    return joint_row if kind.endswith("_js") else pose_row


def _streams(
    kind: str, messages: Recorded, times: Times, options: BagOptions
) -> tuple[list[Stream], list[str]]:
    if kind == "raven_state":
        return raven_streams(messages, times, options.arm)
    if kind.endswith("_js"):
        return joint_streams(kind, messages, times)
    return pose_streams(kind, messages, times)


def _record(bag: AnyReader, choice: Choice) -> dict[str, Recorded]:
    """Messages of the chosen topics, by kind."""
    recorded = {topic: Recorded(topic, _row(kind)) for kind, topic in choice.topics.items()}
    connections = [c for c in bag.connections if c.topic in recorded]
    for connection, receive, raw in bag.messages(connections=connections):
        recorded[connection.topic].add(bag.deserialize(raw, connection.msgtype), receive)
    return {kind: recorded[topic] for kind, topic in choice.topics.items() if recorded[topic].rows}


@contextmanager
def _opened(path: Path) -> Iterator[AnyReader]:
    """Open a recording; definitions come with it, or else from ROS 2 and this package.

    Raises
    ------
    LogError
        The recording is damaged.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError as error:
        raise MissingExtraError("rosbags", extra="ros", purpose="Reading ROS recordings") from error
    store = get_typestore(Stores.LATEST)
    store.register(get_types_from_msg(RAVEN_STATE_DEFINITION, RAVEN_STATE_TYPE))
    try:
        with AnyReader([path], default_typestore=store) as bag:
            yield bag
    except GpCorrectError:
        raise
    except _damage() as error:
        hint = "A ROS 1 bag without its index can be repaired with: rosbag reindex."
        raise LogError(f"{DAMAGED}: {error}.", hint=hint if path.suffix == ".bag" else "") from error


def _damage() -> tuple[type[Exception], ...]:
    """List what rosbags and the database library below it raise on damaged bytes (found by damaging some)."""
    from rosbags.highlevel import AnyReaderError
    from rosbags.rosbag1 import ReaderError as Ros1Error
    from rosbags.rosbag2 import ReaderError as Ros2Error
    from rosbags.typesys import TypesysError

    errors: list[type[Exception]] = [AnyReaderError, Ros1Error, Ros2Error, TypesysError]
    errors += [ValueError, AssertionError, OverflowError, MemoryError, LookupError, EOFError]
    with suppress(ImportError):
        import apsw

        errors.append(apsw.Error)
    return tuple(errors)
