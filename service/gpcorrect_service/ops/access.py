"""Who may do what at a secured router: roles, and the rules of zenoh's access control that they become.

A role is a certificate and a password, both: a password that leaked is worth nothing behind another certificate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gpcorrect_service.protocol.cdr import CORRECT
from gpcorrect_service.protocol.rmw import dds_name
from gpcorrect_service.protocol.sessions import LIVE_KEYS, PREFILTER

ASKED = ("correct", "correct_path", "correct_joints", "model", "health")
ROLES: dict[str, tuple[str, ...]] = {
    "server": (),
    "planner": ASKED,
    "operator": (*ASKED, "metrics", "model/list", "admin/**"),
    "monitor": ("health", "metrics", "model"),
}
ROBOT = "robot"  # it and the pre-filter ask nobody, and are asked by nobody
USERS = (*ROLES, ROBOT, PREFILTER)

# The ROS 2 service of any domain, arm and distribution, and the tokens of the ROS graph; neither has a namespace.
ROS_CORRECT, ROS_GRAPH = f"*/*/correct/{dds_name(CORRECT)}/*", "@ros2_lv/**"

WANTED = ("servo_cp", "move_cp")
CORRECTED = ("corrected/servo_cp", "corrected/move_cp")
JOINTS = ("servo_jp", "move_jp", "state_command")
STATE = (
    "measured_js", "setpoint_js", "external_js", "measured_cp", "setpoint_cp", "tracker_cp", "operating_state",
    "heartbeat", "error", "warning",
)  # fmt: skip
SEEN = (*STATE, "estimate", "corrected/report")
RECEIVED = {
    "server": ("measured_js",),
    "planner": SEEN,
    "operator": (*SEEN, *WANTED, *CORRECTED, "event"),
    "monitor": (*SEEN, "servo_cp"),
    ROBOT: (*WANTED, *CORRECTED, *JOINTS),
    PREFILTER: (*WANTED, "operating_state"),
}
PUBLISHED = {
    "server": ("estimate",),
    "planner": WANTED,
    "operator": (*WANTED, *JOINTS, "event"),
    ROBOT: STATE,
    PREFILTER: (*CORRECTED, "corrected/report", "error"),
}
Right = tuple[str, list[str], list[str], list[str]]


def access_rules(namespace: str) -> dict[str, Any]:
    """Return the rules of zenoh's access control: what is not named is denied, in both directions.

    Parameters
    ----------
    namespace : str
        First part of every key.
    """
    rules: list[dict[str, Any]] = []
    policies: list[dict[str, Any]] = []
    for user in USERS:
        ids = []
        for name, flows, messages, keys in (*_rights(user, namespace), *_ros_rights(user)):
            if keys:
                ids.append(f"{user} {name}")
                rules.append(
                    {"id": ids[-1], "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}
                )
        policies.append({"rules": ids, "subjects": [user]})
    # Nobody may delete. The rule gives a subject to those whose certificate and password do not go together, by which
    # zenoh names them where it denies.
    nothing = {"id": "nothing", "permission": "deny", "flows": ["ingress"], "messages": ["delete"], "key_exprs": ["**"]}
    mixed = [
        {"id": f"{user} mixed", "cert_common_names": [user], "usernames": [one for one in USERS if one != user]}
        for user in USERS
    ]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [*rules, nothing],
        # What one subject lists of different kinds must all hold.
        "subjects": [*({"id": user, "cert_common_names": [user], "usernames": [user]} for user in USERS), *mixed],
        "policies": [*policies, {"rules": ["nothing"], "subjects": [subject["id"] for subject in mixed]}],
    }


def _rights(user: str, namespace: str) -> list[Right]:
    """Return name, directions (as the router sees them), messages and keys of what a user may do."""

    def full(keys: Sequence[str]) -> list[str]:
        return [f"{namespace}/*/{key}" for key in keys]

    asked, received, published = (full(part.get(user, ())) for part in (ROLES, RECEIVED, PUBLISHED))
    rights: list[Right] = [
        ("asks", ["ingress"], ["query"], asked),
        ("is answered", ["egress"], ["reply", "declare_queryable"], asked),
        ("subscribes", ["ingress"], ["declare_subscriber"], received),
        ("receives", ["egress"], ["put"], received),
        ("publishes", ["ingress"], ["put"], published),
        ("is subscribed to", ["egress"], ["declare_subscriber"], published),
    ]
    if user == "server":
        everything = full(["**"])
        rights.append(("answers", ["ingress"], ["reply", "declare_queryable", "liveliness_token"], everything))
        rights.append(("is asked", ["egress"], ["query"], everything))
    elif user == PREFILTER:
        own, both = full([f"{PREFILTER}/*"]), ["ingress", "egress"]
        rights.append(("is the only one", both, ["liveliness_token", "liveliness_query"], own))
    elif user in ROLES:
        live = full([LIVE_KEYS])
        rights.append(("asks who lives", ["ingress"], ["liveliness_query", "declare_liveliness_subscriber"], live))
        rights.append(("sees who lives", ["egress"], ["liveliness_token"], live))
    return rights


def _ros_rights(user: str) -> list[Right]:
    """Return the same for ROS 2 nodes: who may ask `correct` may call the service, and see that it is there."""
    if user == "server":
        return [
            ("answers ROS", ["ingress"], ["reply", "declare_queryable"], [ROS_CORRECT]),
            ("is asked by ROS", ["egress"], ["query"], [ROS_CORRECT]),
            ("shows ROS", ["ingress"], ["liveliness_token"], [ROS_GRAPH]),
        ]
    if "correct" not in ROLES.get(user, ()):
        return []
    return [
        ("asks ROS", ["ingress"], ["query"], [ROS_CORRECT]),
        ("is answered by ROS", ["egress"], ["reply", "declare_queryable"], [ROS_CORRECT]),
        ("asks the ROS graph", ["ingress"], ["liveliness_query", "declare_liveliness_subscriber"], [ROS_GRAPH]),
        ("sees the ROS graph", ["egress"], ["liveliness_token"], [ROS_GRAPH]),
    ]
