"""What a planner gets back: the command, how sure it is, and which model and process said so.

msgspec structs and not dataclasses: making a frozen dataclass of nine fields takes longer than reading the reply.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import msgspec
import numpy as np

from gpcorrect.types import BoolArray, FloatArray
from gpcorrect_service.protocol import wire
from gpcorrect_service.protocol.errors import ServiceError
from gpcorrect_service.protocol.wire_joints import CorrectJointsAnswer

__all__ = ["CorrectionReply", "JointsReply", "PathReply", "Provenance"]

Provenance = wire.ReplyMeta
Fallback = Literal["", "identity"]


class CorrectionReply(msgspec.Struct, frozen=True, eq=False):
    """What to command instead of one desired pose.

    Parameters
    ----------
    position : (3,) array
        Command, base frame, m.
    quaternion : (4,) array or None
        Command wxyz; None when none was asked for.
    std, interval95 : (6,) arrays
        Standard deviation and half width of the 95 % interval: m, then rad; NaN where not learned.
    in_domain : bool
        Whether the query lies near training data.
    status : str
        OK, EXTRAPOLATING or LIMITED; in a fallback NO_SERVICE, BUSY, STALE, NO_MODEL or INTERNAL.
    reason : str
        Why the status is not OK, or what was not used.
    fallback : str
        "identity" when no server corrected and the desired pose itself is handed back; empty otherwise.
    provenance : Provenance
        Which model and process answered.
    """

    position: FloatArray
    quaternion: FloatArray | None
    std: FloatArray
    interval95: FloatArray
    in_domain: bool
    status: str
    reason: str
    fallback: Fallback = ""
    provenance: Provenance = Provenance()

    @property
    def pose(self) -> FloatArray:
        """The command as `(7,)` x y z qw qx qy qz, or `(3,)`."""
        return self.position if self.quaternion is None else np.concatenate([self.position, self.quaternion])

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and texts; NaN becomes None."""
        return _plain(self)

    @classmethod
    def received(cls, answer: wire.CorrectAnswer, meta: wire.ReplyMeta) -> CorrectionReply:
        """Return the reply of a server."""
        return cls(
            position=np.array(answer.position),
            quaternion=None if answer.quaternion is None else np.array(answer.quaternion),
            std=_floats(answer.std),
            interval95=_floats(answer.interval95),
            in_domain=answer.in_domain,
            status=answer.status,
            reason=answer.reason,
            provenance=meta,
        )

    @classmethod
    def identity(cls, pose: Sequence[float], error: ServiceError) -> CorrectionReply:
        """Return the desired pose itself, flagged with the failure that left it uncorrected."""
        position, quaternion = _parts(np.array(pose, dtype=np.float64))
        unknown = np.full(6, np.nan)
        return cls(position, quaternion, unknown, unknown.copy(), False, error.status, error.message, "identity")


class PathReply(msgspec.Struct, frozen=True, eq=False):
    """What to command instead of a path of n poses; fields as in :class:`CorrectionReply`, a row a pose.

    Parameters
    ----------
    positions : (n, 3) array
    quaternions : (n, 4) array or None
    std, interval95 : (n, 6) arrays
    in_domain : (n,) bool array
    status, reason : tuples of n str
    fallback : str
    provenance : Provenance
    """

    positions: FloatArray
    quaternions: FloatArray | None
    std: FloatArray
    interval95: FloatArray
    in_domain: BoolArray
    status: tuple[str, ...]
    reason: tuple[str, ...]
    fallback: Fallback = ""
    provenance: Provenance = Provenance()

    @property
    def poses(self) -> FloatArray:
        """The commands as `(n, 7)` x y z qw qx qy qz, or `(n, 3)`."""
        return self.positions if self.quaternions is None else np.hstack([self.positions, self.quaternions])

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and texts; NaN becomes None."""
        return _plain(self)

    @classmethod
    def received(cls, answer: wire.CorrectPathAnswer, meta: wire.ReplyMeta) -> PathReply:
        """Return the reply of a server."""
        return cls(
            positions=np.array(answer.positions),
            quaternions=None if answer.quaternions is None else np.array(answer.quaternions),
            std=_floats(answer.std),
            interval95=_floats(answer.interval95),
            in_domain=np.array(answer.in_domain, dtype=bool),
            status=tuple(answer.status),
            reason=tuple(answer.reason),
            provenance=meta,
        )

    @classmethod
    def identity(cls, poses: Sequence[Sequence[float]], error: ServiceError) -> PathReply:
        """Return the desired path itself, flagged with the failure that left it uncorrected."""
        positions, quaternions = _parts(np.array(poses, dtype=np.float64))
        n = len(positions)
        unknown = np.full((n, 6), np.nan)
        inside = np.zeros(n, dtype=bool)
        status, reason = (error.status,) * n, (error.message,) * n
        return cls(positions, quaternions, unknown, unknown.copy(), inside, status, reason, "identity")


class JointsReply(msgspec.Struct, frozen=True, eq=False):
    """What true joints belong to reported ones (or what to command, by the model's direction), n rows of d.

    Parameters
    ----------
    q, std : (n, d) arrays
        Corrected joints and standard deviations, rad or m; NaN where a number was missing.
    status : tuple of n str
        OK or MISSING; in a fallback the failure.
    fallback : str
    provenance : Provenance
    """

    q: FloatArray
    std: FloatArray
    status: tuple[str, ...]
    fallback: Fallback = ""
    provenance: Provenance = Provenance()

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and texts; NaN becomes None."""
        return _plain(self)

    @classmethod
    def received(cls, answer: CorrectJointsAnswer, meta: wire.ReplyMeta) -> JointsReply:
        """Return the reply of a server."""
        return cls(_floats(answer.q), _floats(answer.std), tuple(answer.status), provenance=meta)

    @classmethod
    def identity(cls, q: FloatArray, error: ServiceError) -> JointsReply:
        """Return the joints themselves, flagged with the failure that left them uncorrected."""
        return cls(q, np.full(q.shape, np.nan), (error.status,) * len(q), "identity")


def _parts(poses: FloatArray) -> tuple[FloatArray, FloatArray | None]:
    return poses[..., :3], (poses[..., 3:] if poses.shape[-1] > 3 else None)


def _floats(values: Any) -> FloatArray:
    return np.array(values, dtype=np.float64)  # None becomes NaN


def _plain(reply: CorrectionReply | PathReply | JointsReply) -> dict[str, Any]:
    plain: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(reply, enc_hook=np.ndarray.tolist))
    return plain
