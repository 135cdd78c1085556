"""The liveliness token of a server: that it lives, and which models it holds."""

from __future__ import annotations

from collections.abc import Iterable

LIVE_KEYS = "live/**"  # of an arm
PREFILTER = "prefilter"  # of an arm: the tokens of those that correct its commands, of whom there is one
NO_MODEL = "none"


def live_key(arm: str, replica: str, pose_hash: str, joint_hash: str) -> str:
    """Return the key of a server's token: `<arm>/live/<replica>/<hash of poses>/<hash of joints>`.

    Parameters
    ----------
    arm, replica : str
    pose_hash, joint_hash : str
        SHA-256 of the models; empty for none.
    """
    return f"{arm}/live/{replica}/{pose_hash or NO_MODEL}/{joint_hash or NO_MODEL}"


def differing(keys: Iterable[str]) -> dict[str, list[str]]:
    """Return, of each task in which the servers of an arm hold different models, who holds which.

    Parameters
    ----------
    keys : iterable of str
        Tokens of one arm.
    """
    parts = [key.split("/")[-3:] for key in keys]
    found = {}
    for column, task in ((1, "poses"), (2, "joints")):
        if len({part[column] for part in parts}) > 1:
            found[task] = [f"{part[0]} has {part[column][:12]}" for part in sorted(parts)]
    return found
