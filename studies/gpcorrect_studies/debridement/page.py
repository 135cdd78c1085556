"""The page of `gpcorrect debride`: what a correction is worth in a task."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gpcorrect.report.page import Page, Section, TableData, write_page
from gpcorrect_studies.debridement.charts import path_charts, seconds_chart
from gpcorrect_studies.debridement.comparison import Condition
from gpcorrect_studies.debridement.scene import Scene

HEAD = ("", "cm/s", "removed", "at once", "retries", "replanned", "looks", "miss [mm]", "s a fragment", "s in all")


def write_debride_page(scene: Scene, conditions: Sequence[Condition], facts: dict[str, Any], path: Path) -> None:
    """Write the self-contained page.

    Parameters
    ----------
    scene, conditions
    facts : mapping
        As `gpcorrect debride --json` prints them.
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
