"""Frames, one after the other, into a calibration log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gpcorrect import se3
from gpcorrect.types import CalibrationLog, FloatArray, IntArray, LogMeta, PoseSignal
from gpcorrect.vision.target import Target
from gpcorrect.vision.tracker import Frame
from gpcorrect.vision.views import REASONS

__all__ = ["STATUSES", "Recording", "Track"]

STATUSES = ("measured", "coasting", "lost")


@dataclass(frozen=True, eq=False)
class Track:
    """A whole recording, tracked.

    Parameters
    ----------
    time : (n,) array
        s.
    status : (n,) int array
        Index into `STATUSES`.
    T_tracker_tool : (n, 4, 4) array
        m; NaN where lost.
    std : (n, 6) array
        Of position (m) and rotation vector (rad); NaN where lost.
    balls : (n, b, 3) array
        Each ball's centre, m; NaN where fewer than two cameras saw it.
    views : (n, c, b) int array
        0: effective; otherwise the reason, an index into `REASONS`.
    pixels : (n, c, b, 2) array
        Where each ball was seen, px; NaN where it was not.
    reprojection_px : (n,) array
        RMS over the sightings used; NaN without.
    """

    time: FloatArray
    status: IntArray
    T_tracker_tool: FloatArray
    std: FloatArray
    balls: FloatArray
    views: IntArray
    pixels: FloatArray
    reprojection_px: FloatArray

    def shares(self) -> dict[str, float]:
        """Share of the frames in each status."""
        n = max(len(self.status), 1)
        return {name: float(np.count_nonzero(self.status == k)) / n for k, name in enumerate(STATUSES)}

    def log(self, target: Target, remarks: Sequence[str] = (), name: str = "") -> CalibrationLog:
        """Return the native log: `tracker_cp`, empty where lost, and what is known of every sample in extra columns."""
        position = self.T_tracker_tool[:, :3, 3]
        quaternion = se3.quaternion_from_matrix(self.T_tracker_tool[:, :3, :3]) if target.has_pose else None
        effective = (self.views == 0).sum(axis=1).astype(np.float64)
        extra = {"tracking_status": self.status.astype(np.float64), "reprojection_px": self.reprojection_px}
        extra |= {f"tracker_std_{axis}": self.std[:, i] for i, axis in enumerate(("x", "y", "z"))}
        if target.has_pose:
            extra |= {f"tracker_std_r{axis}": self.std[:, 3 + i] for i, axis in enumerate(("x", "y", "z"))}
        for b, ball in enumerate(target.names):
            extra |= {f"ball_{ball}_{axis}": self.balls[:, b, i] for i, axis in enumerate(("x", "y", "z"))}
            extra[f"ball_{ball}_cameras"] = effective[:, b]
        n = len(self.time)
        return CalibrationLog(
            time=self.time,
            trajectory=np.zeros(n, dtype=np.int64),
            session=np.zeros(n, dtype=np.int64),
            tracker_cp=PoseSignal(position, quaternion),
            extra=extra,
            meta=LogMeta(tracker="cameras and coloured balls", notes=" ".join(remarks)),
            name=name,
            remarks=tuple(remarks),
        )


@dataclass(eq=False)
class Recording:
    """Takes frames in, and gives the track out."""

    _rows: list[tuple[object, ...]] = field(default_factory=list)

    def add(self, frame: Frame) -> None:
        """Keep what matters of a frame."""
        lost = frame.pose.status == "lost"
        none = np.full(2, np.nan)
        self._rows.append(
            (
                frame.time,
                STATUSES.index(frame.pose.status),
                np.full((4, 4), np.nan) if lost else frame.pose.T_tracker_tool,
                np.full(6, np.nan) if lost else frame.pose.std,
                frame.balls,
                [[0 if v.effective else max(_code(v.reason), 1) for v in views] for views in frame.views],
                [[none if v.outline is None else v.outline.pixel for v in views] for views in frame.views],
                frame.reprojection_px,
            )
        )

    def track(self) -> Track:
        """Return everything so far."""
        return Track(*(np.array(column) for column in zip(*self._rows, strict=True)))


def _code(reason: str) -> int:
    return next((k for k, known in enumerate(REASONS) if known == reason), 1)
