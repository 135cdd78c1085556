"""How ROS 2 nodes on rmw_zenoh find and read topics: keys, attachments and liveliness tokens.

After the design document and the released sources of rmw_zenoh_cpp (0.2.4 in Jazzy and newer; Humble, Kilted, Rolling).
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass

from gpcorrect_service.crtk.ros_messages import ros_definition

__all__ = ["RmwNode", "attachment", "read_attachment", "rmw_key"]

GID_BYTES = 16
ATTACHMENT = struct.Struct("<qqB16s")
DEFAULT_QOS = "::,10:,:,:,,"  # reliable, volatile, keep last 10


def rmw_key(domain: int, topic: str, ros_type: str) -> str:
    """Return the zenoh key of a ROS topic: `domain/topic/type/hash`."""
    return f"{domain}/{topic.strip('/')}/{_dds_name(ros_type)}/{ros_definition(ros_type)[1]}"


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Return what rmw_zenoh expects beside every message: its number from 1, its time (ns since 1970), its sender."""
    return ATTACHMENT.pack(sequence, stamp_ns, GID_BYTES, gid)


def read_attachment(data: bytes) -> tuple[int, int, bytes]:
    """Return number, time in ns and sender of a message."""
    sequence, stamp_ns, _, gid = ATTACHMENT.unpack(data)
    return sequence, stamp_ns, gid


@dataclass(frozen=True)
class RmwNode:
    """A node as the ROS graph shows it.

    Parameters
    ----------
    domain : int
        ROS_DOMAIN_ID.
    zid : str
        Of the zenoh session.
    name : str
        Of the node.
    """

    domain: int
    zid: str
    name: str

    def node_token(self) -> str:
        """Return the liveliness key that shows the node."""
        return f"@ros2_lv/{self.domain}/{self.zid}/0/0/NN/%/%/{self.name}"

    def topic_token(self, number: int, kind: str, topic: str, ros_type: str) -> str:
        """Return the liveliness key of a publisher ("MP") or a subscription ("MS"), the `number`-th of the node."""
        mangled = "%" + topic.strip("/").replace("/", "%")
        described = f"{mangled}/{_dds_name(ros_type)}/{ros_definition(ros_type)[1]}/{DEFAULT_QOS}"
        return f"@ros2_lv/{self.domain}/{self.zid}/0/{number}/{kind}/%/%/{self.name}/{described}"


def gid_of(token: str) -> bytes:
    """Return a sender's 16 bytes: only that they differ from others' matters."""
    return hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()


def _dds_name(ros_type: str) -> str:
    package, _, name = ros_type.split("/")
    return f"{package}::msg::dds_::{name}_"
