"""Keys, attachments and liveliness tokens of rmw_zenoh, by which ROS 2 nodes find topics and services.

After the design document and the released sources of rmw_zenoh_cpp (0.2.4 in Jazzy and newer; Humble, Kilted, Rolling).
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass

from gpcorrect_service.protocol.cdr import ros_types
from gpcorrect_service.protocol.settings import RosDistro

GID_BYTES = 16  # length of a sender's name
ATTACHMENT = struct.Struct("<qqB16s")
DEFAULT_QOS = "::,10:,:,:,,"  # reliable, volatile, keep last 10
LATCHED_QOS = ":1:,1:,:,:,,"  # reliable, transient local, keep last 1: who comes late hears the last one
NO_HASH = "TypeHashNotSupported"  # rmw_zenoh, branch humble (pull request 388): stands where a hash would


def rmw_key(domain: int, topic: str, ros_type: str, distro: RosDistro) -> str:
    """Return the zenoh key of a ROS topic or service: `domain/topic/type/hash`.

    Parameters
    ----------
    domain : int, ROS_DOMAIN_ID
    topic, ros_type : str, as `arm1/servo_cp` and `geometry_msgs/msg/PoseStamped`, or a service's name and type
    distro : str, ROS distribution of the nodes that use it
    """
    return f"{domain}/{topic.strip('/')}/{_type_and_hash(ros_type, distro)}"


def dds_name(ros_type: str) -> str:
    """Return the name of a type as keys have it: `geometry_msgs::msg::dds_::PoseStamped_`.

    Parameters
    ----------
    ros_type : str, as `geometry_msgs/msg/PoseStamped`
    """
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Return what rmw_zenoh expects beside every message.

    Parameters
    ----------
    sequence, stamp_ns : int, its number, from 1, and its time, ns since 1970
    gid : 16 bytes
    """
    return ATTACHMENT.pack(sequence, stamp_ns, GID_BYTES, gid)


def reply_attachment(asked: bytes, stamp_ns: int) -> bytes:
    """Return what belongs beside the answer of a service: the question's number and sender; empty without one.

    Parameters
    ----------
    asked : bytes, what came beside the question
    stamp_ns : int, time of the answer, ns since 1970
    """
    if len(asked) != ATTACHMENT.size:
        return b""
    sequence, _, _, gid = ATTACHMENT.unpack(asked)
    return attachment(sequence, stamp_ns, gid)


@dataclass(frozen=True)
class RmwNode:
    """A node as the ROS graph shows it."""

    domain: int  # ROS_DOMAIN_ID
    # of the zenoh session, and of the node
    zid: str
    name: str
    distro: RosDistro  # ROS distribution of the nodes that see it

    def node_token(self) -> str:
        """Return the liveliness key that shows the node."""
        return f"@ros2_lv/{self.domain}/{self.zid}/0/0/NN/%/%/{self.name}"

    def topic_token(self, number: int, kind: str, topic: str, ros_type: str, qos: str = DEFAULT_QOS) -> str:
        """Return the liveliness key of a publisher, a subscription or a service.

        Parameters
        ----------
        number : int, which one of the node
        kind : str, "MP" for a publisher, "MS" for a subscription, "SS" for a service's server
        topic, ros_type : str, as for :func:`rmw_key`
        qos : str, quality of service in rmw_zenoh's short form
        """
        mangled = "%" + topic.strip("/").replace("/", "%")
        described = f"{mangled}/{_type_and_hash(ros_type, self.distro)}/{qos}"
        return f"@ros2_lv/{self.domain}/{self.zid}/0/{number}/{kind}/%/%/{self.name}/{described}"


def gid_of(token: str) -> bytes:
    """Return a sender's 16 bytes: only that they differ from others' matters.

    Parameters
    ----------
    token : str
    """
    return hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()


def _type_and_hash(ros_type: str, distro: RosDistro) -> str:
    hashed = NO_HASH if distro == "humble" else ros_types().hash_rihs01(ros_type)
    return f"{dds_name(ros_type)}/{hashed}"
