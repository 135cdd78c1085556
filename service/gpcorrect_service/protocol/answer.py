"""The one answer on the wire, and its two conversions: from and to :class:`gpcorrect.correction.Correction`."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, TypeVar

import msgspec
import numpy as np

from gpcorrect.correction import Correction, Reason
from gpcorrect.types import FloatArray

UNKNOWN = np.empty(0)


class Single(msgspec.Struct, frozen=True, kw_only=True):
    """What every :class:`gpcorrect.correction.Correction` of one question says as it travels, beside the command.

    `status` and `reason` are for people; `flags` holds the same reasons as bits, for programs. The command is a field
    of each message of its own: msgspec's `rename` does not reach what is inherited.
    """

    std: list[float | None]
    interval95: list[float | None]
    in_domain: bool
    status: str
    reason: str
    flags: int


class Rows(msgspec.Struct, frozen=True, kw_only=True):
    """The columns of n answers, as in :class:`Single`."""

    std: list[list[float | None]]
    interval95: list[list[float | None]]
    in_domain: list[bool]
    status: list[str]
    reason: list[str]
    flags: list[int]


A = TypeVar("A", bound=Single | Rows)


class PoseAnswer(Single, frozen=True, kw_only=True):
    """Answer of `correct`; no quaternion where a position alone was asked."""

    position: list[float]
    quaternion: list[float] | None


class PathAnswer(Rows, frozen=True, kw_only=True, rename={"position": "positions", "quaternion": "quaternions"}):
    """Answer of `correct_path`, as in :class:`PoseAnswer`."""

    position: list[list[float]]
    quaternion: list[list[float]] | None


class JointsAnswer(Rows, frozen=True, kw_only=True, rename={"joints": "q"}):
    """Answer of `correct_joints`."""

    joints: list[list[float | None]]


class EstimateAnswer(Single, frozen=True, kw_only=True, rename={"joints": "position"}):
    """One sample of the stream `estimate`: `stamp` and `session` of the robot's sample, and which model answered."""

    joints: list[float | None]
    stamp: float
    session: int
    model_hash: str
    replica: str


def pack(form: type[A], answer: Correction, **beside: Any) -> A:
    """Return a correction as a message.

    Parameters
    ----------
    form : type, the message; one for single answers or one for n, as the correction is
    answer : Correction
    **beside
        Further fields of the message.
    """
    flags: Any = answer.reasons.tolist() if isinstance(answer.reasons, np.ndarray) else int(answer.reasons)
    columns: Any = _meaning(flags) if isinstance(flags, int) else map(list, zip(*map(_meaning, flags), strict=True))
    in_domain, status, reason = columns
    return form(
        **_command(answer),
        std=nullable(answer.std),
        interval95=nullable(answer.interval95),
        in_domain=in_domain,
        status=status,
        reason=reason,
        flags=flags,
        **beside,
    )


def _command(answer: Correction) -> dict[str, Any]:
    """Return the fields of a message that command something: those of a pose, or of joints."""
    if answer.position is None:
        assert answer.joints is not None
        return {"joints": nullable(answer.joints)}
    quaternion = None if answer.quaternion is None else answer.quaternion.tolist()
    return {"position": answer.position.tolist(), "quaternion": quaternion}


def unpack(message: Single | Rows) -> Correction:
    """Return the correction in a message.

    Parameters
    ----------
    message : Single or Rows
    """
    flags = message.flags
    return Correction(
        position=_array(getattr(message, "position", None)),
        quaternion=_array(getattr(message, "quaternion", None)),
        joints=_array(getattr(message, "joints", None)),
        std=np.array(message.std, dtype=np.float64),
        interval95=np.array(message.interval95, dtype=np.float64),
        reasons=Reason(flags) if isinstance(flags, int) else np.array(flags, dtype=np.int64),
    )


def _array(values: Any) -> FloatArray | None:
    return None if values is None else np.array(values, dtype=np.float64)  # null becomes NaN


def nullable(values: FloatArray) -> Any:
    """Return nested lists with None where a number does not exist: JSON knows no NaN.

    Parameters
    ----------
    values : (k,) or (n, k) array
    """
    listed: list[Any] = values.tolist()
    if values.ndim == 1:
        return listed if math.isfinite(sum(listed)) else [one if math.isfinite(one) else None for one in listed]
    return listed if np.isfinite(values).all() else [nullable(row) for row in values]


@lru_cache(maxsize=1024)  # all combinations of reasons
def _meaning(code: int) -> tuple[bool, str, str]:
    """Return what reasons say of one answer: whether it is in the domain, its status, and words."""
    answer = Correction(None, None, None, UNKNOWN, UNKNOWN, Reason(code))
    return bool(answer.in_domain), str(answer.status), answer.reason
