"""Picture, animation and page of `gpcorrect debride`: what a correction is worth in a task."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle

from gpcorrect.plots.style import COLOURS, new_figure, tidy
from gpcorrect.report.page import FigureImage, Page, Section, TableData, write_page
from gpcorrect_studies.debridement.charts import path_charts, seconds_chart
from gpcorrect_studies.debridement.comparison import Condition
from gpcorrect_studies.debridement.scene import Gripper, Scene, Station

HEAD = ("", "cm/s", "removed", "at once", "retries", "replanned", "looks", "miss [mm]", "s a fragment", "s in all")
ARM_COLOURS = (COLOURS["corrected"], COLOURS["rigid"])
CAUGHT, LOST, WAITING = "#009e73", COLOURS["raw"], COLOURS["quiet"]
FAILED: dict[str, Any] = {"fill": False, "hatch": "//", "edgecolor": LOST}
LABEL_WIDTH = 14  # characters of a bar's name on one line; chosen by hand
FRAMES, FRAMES_A_SECOND, GIF_DPI = 60, 8, 70  # chosen by hand: eight seconds in about a megabyte


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
    knowing = facts["conditions"][1]
    with TemporaryDirectory() as folder:
        debridement_gif(scene, stations, conditions[:2], Path(folder) / "film.gif")
        film = (Path(folder) / "film.gif").read_bytes()
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
                figures=[
                    seconds_chart([c.to_dict() for c in conditions]),
                    *path_charts(scene, conditions),
                    FigureImage(film, "Side by side on one clock.", "gif"),
                ],
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


def debridement_paths(scene: Scene, stations: Sequence[Station], conditions: Sequence[Condition]) -> Figure:
    """Draw the paths of the tools seen from above, and the seconds and successes beside them.

    Parameters
    ----------
    scene : Scene
    stations : sequence of Station
    conditions : sequence of Condition
        A panel each.
    """
    figure, axes = new_figure(3.3 * len(conditions) + 3.2, 4.0, 1, len(conditions) + 1)
    for ax, condition in zip(axes, conditions, strict=False):
        _floor(ax, scene, stations, condition)
        for colour, arm in zip(ARM_COLOURS, condition.outcome.arms, strict=False):
            place = 1e3 * scene.along(arm.trace[:, 1:])
            ax.plot(place[:, 0], place[:, 1], color=colour, linewidth=0.7, alpha=0.8, label=f"tool of {arm.name}")
        _fragments(ax, scene, condition, np.inf)
    axes[0].legend(frameon=False, fontsize=7, loc="lower left")
    rows = [condition.to_dict() for condition in conditions]
    bars, seconds = axes[-1], [row["seconds_per_fragment"] for row in rows]
    for i, row in enumerate(rows):
        removed = row["success_rate"]
        # What removes nothing never ends: as tall as the tallest, and empty.
        height, how = (seconds[i], {"color": COLOURS["quiet"]}) if removed > 0 else (max(seconds), FAILED)
        bars.bar(i, height, width=0.6, **how)
        text = f"{height:.1f} s\n{100 * removed:.0f} %" if removed > 0 else "never done:\nnothing removed"
        bars.annotate(text, (i, height), (0, 3), textcoords="offset points", ha="center", fontsize=8)
    bars.set_xticks(range(len(seconds)), [fill(c.name, LABEL_WIDTH) for c in conditions], fontsize=7)
    bars.set_ylabel(f"s a fragment, mean of {len(conditions[0].outcomes)}")
    bars.margins(y=0.18)
    return figure


def debridement_gif(scene: Scene, stations: Sequence[Station], conditions: Sequence[Condition], path: Path) -> None:
    """Write the conditions side by side on one clock, as an animated GIF.

    Parameters
    ----------
    scene : Scene
    stations : sequence of Station
    conditions : sequence of Condition
        A panel each.
    path : Path
        GIF file.
    """
    figure = Figure(figsize=(3.4 * len(conditions), 3.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, len(conditions))).tolist()
    for ax in axes:
        tidy(ax)
    end = max(arm.seconds for condition in conditions for arm in condition.outcome.arms)
    films = [_Film(ax, scene, stations, condition) for ax, condition in zip(axes, conditions, strict=True)]

    def draw(frame: int) -> list[Artist]:
        return [artist for film in films for artist in film.draw(end * frame / (FRAMES - 1))]

    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # places stay from frame to frame; finding them again takes most of a frame's time
    film = FuncAnimation(figure, draw, frames=FRAMES, blit=False)
    film.save(str(path), writer=PillowWriter(fps=FRAMES_A_SECOND), dpi=GIF_DPI)


class _Film:
    """One condition as it goes on."""

    def __init__(self, ax: Axes, scene: Scene, stations: Sequence[Station], condition: Condition) -> None:
        self._ax, self._scene, self._condition = ax, scene, condition
        _floor(ax, scene, stations, condition)
        arms = condition.outcome.arms
        self._trails = [ax.plot([], [], color=c, linewidth=0.8)[0] for c, _ in zip(ARM_COLOURS, arms, strict=False)]
        self._tools = [ax.plot([], [], "o", color=c, markersize=7)[0] for c, _ in zip(ARM_COLOURS, arms, strict=False)]
        self._marks: list[Artist] = []
        self._clock = ax.text(0.02, 0.02, "", transform=ax.transAxes, fontsize=8, color=COLOURS["ink"])

    def draw(self, clock: float) -> list[Artist]:
        """Show the moment `clock` seconds after the start."""
        arms = self._condition.outcome.arms
        for trail, tool, arm in zip(self._trails, self._tools, arms, strict=True):
            place = 1e3 * self._scene.along(arm.trace[arm.trace[:, 0] <= clock, 1:])
            trail.set_data(place[-250:, 0], place[-250:, 1])
            tool.set_data(place[-1:, 0], place[-1:, 1])
        for mark in self._marks:
            mark.remove()
        self._marks = _fragments(self._ax, self._scene, self._condition, clock)
        done = max(arm.seconds for arm in arms)
        self._clock.set_text(f"{min(clock, done):.0f} s" + (", done" if clock >= done else ""))
        return [*self._trails, *self._tools, *self._marks, self._clock]


def _floor(ax: Axes, scene: Scene, stations: Sequence[Station], condition: Condition) -> None:
    width, depth = 1e3 * scene.size[:2]
    ax.add_patch(Rectangle((-width / 2, -depth / 2), width, depth, fill=False, edgecolor=COLOURS["ink"], linewidth=0.8))
    for station in stations:
        bowl = 1e3 * scene.along(scene.bowl(station))
        ax.add_patch(Circle((bowl[0], bowl[1]), 1e3 * Gripper().bowl, color="#eef1f4", zorder=0))
    outcome = condition.outcome
    ax.set_title(
        f"{condition.name}, {100 * condition.speed:.0f} cm/s\n"
        f"{100 * outcome.success_rate:.0f} % removed, {outcome.seconds_per_fragment:.1f} s a fragment",
        fontsize=8,
    )
    ax.set(xlabel="x [mm]", xlim=(-72, 72), ylim=(-60, 60), aspect="equal")
    ax.grid(visible=False)


def _fragments(ax: Axes, scene: Scene, condition: Condition, clock: float) -> list[Artist]:
    """Mark fragments as they are at a time: lying, fetched, or given up."""
    marks: list[Artist] = []
    for fetched in condition.outcome.fetched:
        place = 1e3 * scene.along(fetched.fragment)
        over = fetched.clock <= clock
        colour = (CAUGHT if fetched.removed else LOST) if over else WAITING
        shape = "o" if not over or fetched.removed else "x"
        marks += ax.plot(place[0], place[1], shape, color=colour, markersize=4)
    return marks
