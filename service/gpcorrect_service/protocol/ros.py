"""What ROS 2 nodes see: messages in CDR, and the keys, attachments and tokens of rmw_zenoh.

CDR goes through rosbags' types; `correct` is PoseStamped for PoseStamped, and a ROS service. Keys are after the design
document and the released sources of rmw_zenoh_cpp (0.2.4 in Jazzy and newer; Humble, Kilted, Rolling).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from importlib.util import find_spec
from typing import Any

import numpy as np

from gpcorrect.errors import MissingExtraError
from gpcorrect_service.protocol.answer import PoseAnswer
from gpcorrect_service.protocol.errors import bad_input
from gpcorrect_service.protocol.messages import Numbers
from gpcorrect_service.protocol.settings import RosDistro

POSE_STAMPED = "geometry_msgs/msg/PoseStamped"  # this and the next are names of ROS types
JOINT_STATE = "sensor_msgs/msg/JointState"  # name of the ROS type
OPERATING_STATE = "crtk_msgs/msg/OperatingState"  # crtk_msgs, ROS 2
STRING_STAMPED = "crtk_msgs/msg/StringStamped"  # crtk_msgs, ROS 2
TF_MESSAGE = "tf2_msgs/msg/TFMessage"  # what `/tf` carries
CORRECT = "gpcorrect_msgs/srv/Correct"  # the ROS service, whose definition is in the folder `ros`
CDR_ENCODING = f"application/cdr;{POSE_STAMPED}"
CALL_ENCODING = f"application/cdr;{CORRECT}"
# https://github.com/collaborative-robotics/crtk_msgs, ROS 2
CRTK_DEFINITIONS = {
    OPERATING_STATE: "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n",
    STRING_STAMPED: "std_msgs/Header header\nstring string\n",
}
# https://github.com/ros2/rcl_interfaces, service_msgs; its constants are not part of a type's hash
EVENT_INFO = "uint8 event_type\nbuiltin_interfaces/Time stamp\nuint8[16] client_gid\nint64 sequence_number\n"
GID_BYTES = 16  # length of a sender's name
ATTACHMENT = struct.Struct("<qqB16s")
DEFAULT_QOS = "::,10:,:,:,,"  # reliable, volatile, keep last 10
LATCHED_QOS = ":1:,1:,:,:,,"  # reliable, transient local, keep last 1: who comes late hears the last one
NO_HASH = "TypeHashNotSupported"  # rmw_zenoh, branch humble (pull request 388): stands where a hash would


@dataclass(frozen=True)
class StampedPose:
    """A pose `x y z qw qx qy qz`, with the header it came under."""

    pose: tuple[float, ...]
    sec: int
    nanosec: int
    frame_id: str


@lru_cache(maxsize=1)
def ros_types() -> Any:
    """Return rosbags' types with CRTK's own; MissingExtraError where rosbags is not installed."""
    if find_spec("rosbags") is None:
        raise MissingExtraError("rosbags", extra="ros", purpose="Speaking with ROS 2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in CRTK_DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    text = files("gpcorrect_service").joinpath("ros", *f"{CORRECT}.srv".split("/")).read_text(encoding="utf-8")
    _register_service(store, CORRECT, text)
    return store


def _register_service(store: Any, name: str, text: str) -> None:
    """Register a service's question and answer, and the type that its hash is of: both, and the event of both."""
    from rosbags.interfaces import Nodetype
    from rosbags.typesys import get_types_from_msg

    event_info = "service_msgs/msg/ServiceEventInfo"
    store.register(get_types_from_msg(EVENT_INFO, event_info))
    asked, answered = (f"{name}_{part}" for part in ("Request", "Response"))
    for part, definition in zip((asked, answered), text.split("---\n"), strict=True):
        (described,) = get_types_from_msg(definition, part).values()
        store.register({part: described})

    def one(kind: str) -> Any:
        return (Nodetype.NAME, kind)

    event = f"{name}_Event"
    lists = [(role, (Nodetype.SEQUENCE, (one(kind), 1))) for role, kind in (("request", asked), ("response", answered))]
    store.register({event: ([], [("info", one(event_info)), *lists])})
    members = (("request_message", asked), ("response_message", answered), ("event_message", event))
    store.register({name: ([], [(role, one(kind)) for role, kind in members])})


def decode_cdr(data: bytes, ros_type: str) -> Any:
    """Read one ROS message; BAD_INPUT where the bytes are none, or rosbags is not installed here.

    Parameters
    ----------
    data : bytes, CDR with its 4-byte header
    ros_type : str, as `geometry_msgs/msg/PoseStamped`
    """
    try:
        store = ros_types()
    except MissingExtraError as error:
        raise bad_input("CDR is not spoken here.", error.hint) from error
    from rosbags.serde import SerdeError

    try:
        return store.deserialize_cdr(data, ros_type)
    except (SerdeError, ValueError, IndexError) as error:
        hint = "Send the message as ROS 2 serialises it, with its 4-byte header."
        raise bad_input(f"{len(data)} bytes are not a {ros_type} in CDR ({error}).", hint) from error


def ros_pose(stamped: StampedPose) -> Any:
    """Return a PoseStamped; ROS writes quaternions x y z w.

    Parameters
    ----------
    stamped : StampedPose
    """
    kinds = ros_types().types
    x, y, z, qw, qx, qy, qz = stamped.pose
    stamp = kinds["builtin_interfaces/msg/Time"](sec=stamped.sec, nanosec=stamped.nanosec)
    body = kinds["geometry_msgs/msg/Pose"](
        position=kinds["geometry_msgs/msg/Point"](x=x, y=y, z=z),
        orientation=kinds["geometry_msgs/msg/Quaternion"](x=qx, y=qy, z=qz, w=qw),
    )
    header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id=stamped.frame_id)
    return kinds[POSE_STAMPED](header=header, pose=body)


def read_pose(data: bytes) -> StampedPose:
    """Read the question of `correct`; BAD_INPUT as :func:`decode_cdr`, and where its stamp is 0.

    Parameters
    ----------
    data : bytes, a PoseStamped in CDR
    """
    return _stamped(decode_cdr(data, POSE_STAMPED))


def _stamped(message: Any) -> StampedPose:
    stamp = message.header.stamp
    if stamp.sec == 0 and stamp.nanosec == 0:
        raise bad_input("the stamp of the message is 0.", "Set header.stamp: nothing else says when.")
    p, q = message.pose.position, message.pose.orientation
    return StampedPose((p.x, p.y, p.z, q.w, q.x, q.y, q.z), stamp.sec, stamp.nanosec, message.header.frame_id)


def write_pose(stamped: StampedPose) -> bytes:
    """Write the answer of `correct`.

    Parameters
    ----------
    stamped : StampedPose
    """
    return bytes(ros_types().serialize_cdr(ros_pose(stamped), POSE_STAMPED))


def read_call(data: bytes) -> tuple[StampedPose, Numbers | None]:
    """Read the ROS service's question: desired pose, and its twist where known; BAD_INPUT as :func:`read_pose`.

    Parameters
    ----------
    data : bytes, a Correct_Request in CDR
    """
    message = decode_cdr(data, f"{CORRECT}_Request")
    v, w = message.twist.linear, message.twist.angular
    twist = (v.x, v.y, v.z, w.x, w.y, w.z) if message.with_twist else None
    return _stamped(message.desired), twist


def write_answer(command: StampedPose, answer: PoseAnswer, model_hash: str) -> bytes:
    """Write the answer of the ROS service.

    Parameters
    ----------
    command : StampedPose
    answer : PoseAnswer, how sure the command is
    model_hash : str
    """
    std, interval = (np.array(row, dtype=np.float64) for row in (answer.std, answer.interval95))
    posed = ros_pose(command)
    return _response(True, answer.status, answer.reason, posed, std, interval, answer.in_domain, model_hash)


def write_refusal(status: str, message: str) -> bytes:
    """Write a refusal of the ROS service: ROS nodes never see zenoh's own error replies.

    Parameters
    ----------
    status, message : str, why there is no command, and what to do
    """
    unknown, nowhere = np.full(6, np.nan), ros_pose(StampedPose((np.nan,) * 7, 0, 0, ""))
    return _response(False, status, message, nowhere, unknown, unknown, False, "")


def _response(*fields: Any) -> bytes:
    kind = f"{CORRECT}_Response"
    return bytes(ros_types().serialize_cdr(ros_types().types[kind](*fields), kind))


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


def _type_and_hash(ros_type: str, distro: RosDistro) -> str:
    hashed = NO_HASH if distro == "humble" else ros_types().hash_rihs01(ros_type)
    return f"{dds_name(ros_type)}/{hashed}"
