"""Transforms that ROS nodes publish on /tf and /tf_static: a tree of frames, and the pose of one frame in another."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from gpcorrect import se3
from gpcorrect.errors import LogError
from gpcorrect.logs.messages import Recorded, pose_row
from gpcorrect.logs.streams import Stream, interpolate
from gpcorrect.types import FloatArray, PoseSignal

TF_TYPES = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"})


def _source_name(parent: str, child: str) -> str:
    """Write a pair of frames as users name it, such as `/tf:base->tool`."""
    return f"/tf:{parent.strip('/')}->{child.strip('/')}"


def frames_of(name: str) -> tuple[str, str] | None:
    """Parent and child of a name such as `/tf:base->tool`; None for the name of a topic.

    Parameters
    ----------
    name : str, as the user wrote it
    """
    match = re.fullmatch(r"/?tf:/?(.+?)\s*->\s*/?(.+)", name.strip())
    return (match[1], match[2]) if match else None


@dataclass
class Tree:
    """Transforms by child frame, as they are read."""

    edges: dict[str, tuple[str, Recorded]] = field(default_factory=dict)  # parent and poses of each child
    still: set[str] = field(default_factory=set)  # children whose transform was published as static
    torn: dict[str, str] = field(default_factory=dict)  # children that were given another parent too, and which

    def add(self, message: Any, receive: int, *, static: bool) -> None:
        """Add the transforms of a message.

        Parameters
        ----------
        message : object, TFMessage
        receive : int, ns since 1970
        static : bool, whether it came from /tf_static
        """
        for transform in message.transforms:
            child = transform.child_frame_id.strip("/")
            parent = transform.header.frame_id.strip("/")
            if child not in self.edges:
                self.edges[child] = (parent, Recorded(_source_name(parent, child), pose_row))
            elif self.edges[child][0] != parent:
                self.torn[child] = parent
                continue
            self.edges[child][1].add(transform, receive)
            if static:
                self.still.add(child)

    def moving(self) -> list[str]:
        """Pairs of neighbouring frames that move, named as a source."""
        return [
            _source_name(parent, child)
            for child, (parent, recorded) in self.edges.items()
            if child not in self.still and len(set(recorded.rows)) > 1
        ]

    def pose(self, parent: str, child: str) -> Recorded:
        """Pose of one frame in another at the stamps of the moving transform between them that is published most.

        Parameters
        ----------
        parent, child : str
        """
        up, down = self._to_root(parent), self._to_root(child)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            known = sorted({*self.edges, *(p for p, _ in self.edges.values())})
            raise LogError(f"no transforms lead from {parent} to {child}.", hint=f"Frames here: {', '.join(known)}.")
        up, down = up[: up.index(common)], down[: down.index(common)]
        for frame in (*down, *up):
            if frame in self.torn:
                hint = "Two nodes publish it, or it was attached anew: record one of them, or name a pose's own topic."
                raise LogError(f"{frame} has two parents, {self.edges[frame][0]} and {self.torn[frame]}.", hint=hint)
        moving = [frame for frame in (*down, *up) if frame not in self.still]
        if not moving:
            hint = f"What moves: {', '.join(self.moving())}."
            raise LogError(f"nothing moves between {parent} and {child}.", hint=hint)
        lead = self.edges[max(moving, key=lambda frame: len(self.edges[frame][1].rows))][1]
        found = Recorded(_source_name(parent, child), pose_row, list(lead.stamp), list(lead.receive), list(lead.rows))
        if (up, down) != ([], [child]) or lead is not self.edges[child][1]:
            found.rows = self._composed(up, down, np.array(lead.stamp))
        return found

    def _to_root(self, frame: str) -> list[str]:
        """Return the frame and those above it."""
        path = [frame]
        while path[-1] in self.edges and self.edges[path[-1]][0] not in path:
            path.append(self.edges[path[-1]][0])
        return path

    def _composed(self, up: list[str], down: list[str], stamp: Any) -> list[tuple[float, ...]]:
        """Poses at these stamps, NaN where one of the transforms has a gap."""
        below = above = np.broadcast_to(np.eye(4), (len(stamp), 4, 4))
        for frame in reversed(down):
            below = below @ self._at(frame, stamp)
        for frame in reversed(up):
            above = above @ self._at(frame, stamp)
        T = se3.invert(above) @ below
        rows = np.full((len(stamp), 7), np.nan)
        seen = np.isfinite(T).all(axis=(1, 2))
        rows[seen] = np.hstack(se3.to_parts(T[seen]))
        return [tuple(row) for row in rows.tolist()]

    def _at(self, frame: str, stamp: Any) -> FloatArray:
        """Poses `(n, 4, 4)` of a frame in its parent; NaN in gaps."""
        recorded = self.edges[frame][1]
        rows = np.array(recorded.rows, dtype=np.float64)
        if frame in self.still:
            return np.broadcast_to(se3.from_parts(rows[-1, :3], rows[-1, 3:]), (len(stamp), 4, 4))
        origin = int(stamp[0])
        stream = Stream("tf", (np.array(recorded.stamp) - origin) / 1e9, PoseSignal.of(rows))
        pose = cast(PoseSignal, interpolate(stream, (stamp - origin) / 1e9))
        return se3.from_parts(pose.position, np.asarray(pose.quaternion))
