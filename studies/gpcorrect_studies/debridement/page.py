"""The page of `gpcorrect debride`: what the correction is worth in a task, picture first."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gpcorrect.plots.style import png
from gpcorrect.report.page import FigureImage, Page, Section, TableData, write_page
from gpcorrect_studies.debridement import Condition, Scene, Station
from gpcorrect_studies.debridement.plots import debridement_gif, debridement_paths

__all__ = ["write_debride_page"]

HEAD = ("", "cm/s", "removed", "at once", "retries", "replanned", "looks", "miss [mm]", "s a fragment", "s in all")
WAYS = "Paths of the tools from above: removed fragments are green dots, those that were left are red crosses."


def write_debride_page(
    scene: Scene, stations: Sequence[Station], conditions: Sequence[Condition], facts: dict[str, Any], path: Path
) -> None:
    """Write the page with its pictures in it.

    Parameters
    ----------
    scene, stations, conditions
        What was done.
    facts : mapping
        As `gpcorrect debride --json` prints them.
    path : Path
        HTML file.
    """
    knowing = conditions[1].outcome
    page = Page(
        title="gpcorrect debride: fragments removed by simulated arms",
        verdict=(
            f"{facts['times_faster']:.1f} times faster with correction: {knowing.seconds_per_fragment:.1f} s a "
            f"fragment, {100 * knowing.success_rate:.0f} % removed"
        ),
        facts=[
            ("paper", f"{facts['paper']['times_faster']} times, {facts['paper']['seconds_per_fragment']} s a fragment"),
            ("corrected", "in full" if facts["mode"] == "full" else "at the endpoints"),
            *(("served by", served) for served in facts["served"]),
        ],
        sections=[
            Section(
                "The same fragments, three times",
                tables=[TableData(HEAD, [c.to_words() for c in conditions])],
                figures=[
                    FigureImage(png(debridement_paths(scene, stations, conditions)), WAYS),
                    FigureImage(_film(scene, stations, conditions[:2]), "Side by side on one clock.", "gif"),
                ],
            ),
            Section(
                "What this is and is not",
                words=[
                    "The robot is simulated; its correction is not told of it: it was learned from a rehearsal under a "
                    "simulated tracker, saved to a file, and served by another process over zenoh, which the planner "
                    "asked for every path.",
                    "Seconds for finding, looking and grasping, the size of the fragments and the bowls are ours; so "
                    "the seconds compare within this table, and with the paper's only in kind.",
                ],
            ),
        ],
    )
    write_page(page, path)


def _film(scene: Scene, stations: Sequence[Station], conditions: Sequence[Condition]) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "film.gif"
        debridement_gif(scene, stations, conditions, path)
        return path.read_bytes()
