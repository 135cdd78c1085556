"""The page of `gpcorrect debride`: what a correction is worth in a task, with paths of the tools in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gpcorrect.report.page import Chart, Mark, Page, Panel, Role, Section, Series, TableData, write_page
from gpcorrect_studies.debridement.mission import Condition
from gpcorrect_studies.debridement.scene import Scene

MOST_POINTS = 1500  # of one tool's path; chosen by hand
ARM_ROLES = (Role.CORRECTED, Role.RIGID)
AXES = ("x [mm]", "y [mm]", "z [mm]")
HEAD = ("", "cm/s", "removed", "at once", "retries", "replanned", "looks", "miss [mm]", "s a fragment", "s in all")


def write_debride_page(scene: Scene, conditions: Sequence[Condition], facts: dict[str, Any], path: Path) -> None:
    """Write the self-contained page.

    Parameters
    ----------
    scene, conditions
    facts : mapping, as `gpcorrect debride --json` prints them
    path : Path
    """
    knowing = facts["conditions"][1]
    page = Page(
        title="gpcorrect debride: fragments removed by simulated arms",
        verdict=(
            f"{facts['times_faster']:.1f} times faster with correction: {knowing['seconds_per_fragment']:.1f} s a "
            f"fragment, {100 * knowing['success_rate']:.0f} % removed, means of {facts['sets']} sets"
        ),
        facts=[
            ("paper", f"{facts['paper']['times_faster']} times, {facts['paper']['seconds_per_fragment']} s a fragment"),
            ("corrected", "in full" if facts["mode"] == "full" else "at the endpoints"),
        ],
        sections=[
            Section(
                f"The same fragments, once for each way: means of {facts['sets']} sets; the first one drawn",
                words=["Choose a row to see its paths; column names sort."],
                tables=[TableData(HEAD, [c.to_words() for c in conditions], keys=[c.name for c in conditions])],
                figures=[seconds_chart([c.to_dict() for c in conditions]), *path_charts(scene, conditions)],
            ),
            Section(
                "What this is and is not",
                words=[
                    "The robot is simulated, and its correction knows nothing of the simulator: it was learned from a "
                    "rehearsal under a simulated tracker, saved to a file, and served by another process over zenoh, "
                    "which the planner asked for every path.",
                    "Seconds for finding, looking and grasping, the size of the fragments and the bowls are ours; so "
                    "the seconds compare within this table, and with the paper's only in kind.",
                ],
            ),
        ],
        sources=[("model", served) for served in facts["served"]],
        chosen=conditions[1].name,
        chooses="way:",
    )
    write_page(page, path)


def path_charts(scene: Scene, conditions: Sequence[Condition]) -> list[Chart]:
    """Return the paths of the chosen condition in space, and from above with what became of the fragments.

    Parameters
    ----------
    scene : Scene
    conditions : sequence of Condition, their names are the keys
    """
    space, above = {}, {}
    for condition in conditions:
        paths, flat = [], []
        for role, arm in zip(ARM_ROLES, condition.outcome.arms, strict=False):
            shown = np.unique(np.linspace(0, len(arm.trace) - 1, min(MOST_POINTS, len(arm.trace))).astype(int))
            x, y, z = (1e3 * scene.along(arm.trace[shown, 1:])).T
            paths.append(Series(f"tool of {arm.name}", Mark.LINE, role, x, y, z=z, value=arm.trace[shown, 0]))
            flat.append(Series(f"tool of {arm.name}", Mark.LINE, role, x, y))
        for name, mark, role, wanted in (
            ("removed", Mark.DOTS, Role.GOOD, True),
            ("left", Mark.CROSSES, Role.RAW, False),
        ):
            found = [f for f in condition.outcome.fetched if f.removed == wanted]
            if found:
                x, y, _ = np.array([1e3 * scene.along(f.fragment) for f in found]).T
                words = [f"fragment {name} after {f.clock:.0f} s" for f in found]
                flat.append(Series(name, mark, role, x, y, size=8.0, text=words))
        space[condition.name] = [Panel(*AXES[:2], paths, z_label=AXES[2], equal=True, legend=True)]
        above[condition.name] = [Panel(*AXES[:2], flat, equal=True, height=420)]
    return [
        Chart("Paths of the tools in space. Drag to turn; dots mark the start.", choices=space, space=True),
        Chart("From above, with the fragments that were removed and those that were left.", choices=above),
    ]


def seconds_chart(rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Return seconds a fragment of each condition; what removes nothing never ends, and has no bar.

    Parameters
    ----------
    rows : sequence of mapping, of each condition, as :meth:`Condition.to_dict` gives them
    """
    done = [row["success_rate"] > 0 for row in rows]
    seconds = [row["seconds_per_fragment"] if ends else 0.0 for row, ends in zip(rows, done, strict=True)]
    words = [f"{s:.1f} s" if ends else "never done" for s, ends in zip(seconds, done, strict=True)]
    places = np.arange(len(rows))
    bars = Series("seconds", Mark.BARS, Role.CORRECTED, np.zeros(len(rows)), places, x2=seconds, labels=words)
    limits = (0.0, 1.25 * max(*seconds, 1.0))
    panel = Panel("seconds a fragment", "", [bars], rows=[row["name"] for row in rows], x_range=limits)
    return Chart("Seconds a fragment, means over the sets.", [panel])
