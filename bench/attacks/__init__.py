"""Scenarios of an attacker and of an unlucky laboratory, on real processes; `bench/attack.py` runs them.

A scenario is a function that takes a :class:`attacks.lab.Lab` and returns a :class:`attacks.lab.Seen`; a group is a
module with its scenarios in a tuple `SCENARIOS`. A new group is one module and one name in `GROUPS` below.
"""

GROUPS = (
    "commands",
    "replicas",
    "planners",
    "processes",
    "watching",
    "operators",
    "recordings",
    "files",
    "laboratory",
    "sites",
    "metrics",
    "histories",
    "reaching",
    "mixups",
    "overlaps",
)
