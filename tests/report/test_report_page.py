"""The interactive page: in a real browser it draws, reads out, zooms, turns, sorts and chooses, without an error."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from chromium import Page, browser
from support import Once, small_log

from gpcorrect.calibration import CommandCorrector, Evaluation, evaluate_model
from gpcorrect.report import paths, write_evaluation_report
from gpcorrect.report.page import Chart, Mark, Panel, Role, Section, Series, TableData, charts_data, write_page
from gpcorrect.report.page import Page as ReportPage

WIDE = 1280  # px


@pytest.fixture(scope="module")
def written(once: Once, small_corrector: CommandCorrector) -> Path:
    """Return the page of an evaluation in which cleaning rejects a stretch of the first trajectory."""

    def write(path: Path) -> None:
        log = small_log(5, trajectories=6)
        evaluation = evaluate_model(small_corrector, log)
        keep = np.ones(len(log), dtype=bool)
        keep[20:30] = False
        report = evaluation.cleaning
        labels = np.where(keep, report.reason, "manual")
        clean = small_corrector.measure(log, keep)
        evaluation = replace(evaluation, clean=clean, cleaning=replace(report, reason=labels))
        write_evaluation_report(evaluation, log, path, ("a note",), "model.gpc")

    return once.file("page.html", write)


@pytest.fixture
def page(written: Path, tmp_path: Path) -> Iterator[Page]:
    """Return the page, opened from its file."""
    with browser(tmp_path / "profile") as opened:
        opened.open(written.resolve().as_uri(), WIDE, 900)
        opened.wait_for("document.readyState == 'complete' && document.querySelectorAll('.chart svg').length > 5")
        yield opened
        assert opened.complaints == []


def move(page: Page, kind: str, x: float, y: float, *, held: bool = False) -> None:
    """Move or press the mouse at a place of the window."""
    page._call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=int(held), clickCount=1)


def middle(page: Page, selector: str) -> tuple[float, float]:
    """Return the middle of an element, scrolled to the middle of the window."""
    page.run(f"document.querySelector('{selector}').scrollIntoView({{block: 'center', behavior: 'instant'}})")
    box = json.loads(page.run(f"JSON.stringify(document.querySelector('{selector}').getBoundingClientRect())"))
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def drag(page: Page, x: float, y: float, across: float) -> None:
    """Drag the mouse from a place to the right."""
    move(page, "mouseMoved", x, y)
    move(page, "mousePressed", x, y, held=True)
    for part in (0.5, 1.0):
        move(page, "mouseMoved", x + part * across, y + 4, held=True)
    move(page, "mouseReleased", x + across, y + 4)


def test_a_click_on_a_row_shows_that_trajectory(page: Page) -> None:
    """Choosing a row marks it and draws its paths; the arrow keys go on from there."""
    first = page.run("document.querySelector('[data-chart=\"1\"] path.mark').getAttribute('d')")
    page.run("document.querySelector('tr[data-key=\"4\"]').click()")
    assert page.run("document.querySelector('tr[aria-selected=true]').dataset.key") == "4"
    assert page.run("document.querySelector('[data-chart=\"1\"] .which').textContent") == "trajectory 4"
    assert page.run("document.querySelector('[data-chart=\"1\"] path.mark').getAttribute('d')") != first
    page.run(
        "document.querySelector('tr[data-key=\"4\"]')"
        ".dispatchEvent(new KeyboardEvent('keydown', {key: 'ArrowDown', bubbles: true}))"
    )
    assert page.run("document.querySelector('tr[aria-selected=true]').dataset.key") == "5"


def test_columns_sort_up_down_and_back(page: Page) -> None:
    """The rejected column sorts by its numbers, the other way at the second click, and back at the third."""
    column = "[...document.querySelectorAll('tr[data-key]')].map((row) => Number(row.cells[2].textContent))"
    came = page.run(column)
    found = []
    for _ in range(3):
        page.run("document.querySelectorAll('thead button')[2].click()")
        found.append(page.run(column))
    assert found == [sorted(came), sorted(came, reverse=True), came]


def test_the_pointer_reads_values_and_why_samples_are_missing(page: Page) -> None:
    """Over a path stand time and every value; over the gap, the reason of the rejection."""
    page.run("document.querySelector('tr[data-key=\"0\"]').click()")
    x, y = middle(page, '[data-chart="1"] svg')
    move(page, "mouseMoved", x + 150, y)
    words = page.run("document.querySelector('#tip').innerText")
    assert re.search(r"time 0\.\d+ s", words)
    assert all(name in words for name in ("commanded", "reached", "corrected", "mm"))
    x, y = middle(page, '[data-chart="1"] rect.span')
    move(page, "mouseMoved", x, y)
    assert "rejected: a segment dropped by hand" in page.run("document.querySelector('#tip').innerText")
    gaps = page.run("document.querySelector('[data-chart=\"1\"] path.mark').getAttribute('d').match(/M/g).length")
    assert gaps == 2


def test_a_drag_zooms_and_the_button_goes_back(page: Page) -> None:
    """After a drag all panels of the chart show less of the time; after the button what they showed before."""
    ticks = "[...document.querySelectorAll('[data-chart=\"1\"] text')].map((t) => t.textContent).join(' ')"
    before = page.run(ticks)
    drag(page, *middle(page, '[data-chart="1"] svg'), 120.0)
    assert page.run(ticks) != before
    page.run("document.querySelector('[data-chart=\"1\"] .do').click()")
    assert page.run(ticks) == before


def test_space_turns(page: Page) -> None:
    """A drag turns the paths; a point near them reads out all three; the button puts the corner view back."""
    path = "document.querySelector('[data-chart=\"0\"] path.mark').getAttribute('d')"
    before = page.run(path)
    x, y = middle(page, '[data-chart="0"] svg')
    drag(page, x, y, 80.0)
    assert page.run(path) != before
    page.run("[...document.querySelectorAll('[data-chart=\"0\"] .do')].at(-1).click()")
    assert page.run(path) == before
    x, y = middle(page, '[data-chart="0"] circle')
    move(page, "mouseMoved", x, y)
    assert "commanded" in page.run("document.querySelector('#tip').innerText")


def test_the_legend_hides_a_series(page: Page) -> None:
    """A click on a name takes its lines out of the chart; another brings them back."""
    count = "document.querySelectorAll('[data-chart=\"1\"] path.mark').length"
    click = "document.querySelector('[data-chart=\"1\"] .tools button').click()"
    shown = page.run(count)
    page.run(click)
    assert page.run(count) < shown
    page.run(click)
    assert page.run(count) == shown


def test_print_is_light_and_keeps_the_legend(page: Page) -> None:
    """On paper the page is white whatever the reader's setting, and names stay while buttons go."""
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    back = "getComputedStyle(document.body).backgroundColor"
    page._call("Emulation.setEmulatedMedia", features=dark)
    assert page.run(back) != "rgb(255, 255, 255)"
    page._call("Emulation.setEmulatedMedia", media="print", features=dark)
    assert page.run(back) == "rgb(255, 255, 255)"
    assert page.run("document.querySelector('.tools .swatch').offsetWidth") > 0
    assert page.run("[...document.querySelectorAll('.do')].every((button) => button.offsetWidth === 0)")


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_wider_than_the_window(page: Page, written: Path, width: int) -> None:
    """On a screen and on a telephone the page scrolls down only."""
    page.open(written.resolve().as_uri(), width, 900)
    page.wait_for("document.querySelectorAll('.chart svg').length > 5")
    assert page.run("document.documentElement.scrollWidth") <= width


def test_a_long_table_opens_at_the_chosen_row(tmp_path: Path) -> None:
    """The row that the charts show is in sight inside its table, and the page is at its top."""
    keys = [str(number) for number in range(60)]
    table = TableData(["trajectory", "mm"], [[key, "1"] for key in keys], keys=keys)
    write_page(ReportPage("many", "sixty", (), (Section("All", (), (table,)),), chosen="50"), tmp_path / "page.html")
    with browser(tmp_path / "profile") as page:
        page.open((tmp_path / "page.html").as_uri(), WIDE, 900)
        page.wait_for("document.querySelector('tr[aria-selected=true]')?.dataset.key == '50'")
        row, box = (
            page.run(f"(({{top, bottom}}) => [top, bottom])(document.querySelector('{what}').getBoundingClientRect())")
            for what in ("tr[aria-selected=true]", ".scroll")
        )
        assert box[0] < row[0] < row[1] < box[1]
        assert page.run("window.scrollY") == 0


def test_the_page_stands_alone_and_says_how_it_was_made(written: Path) -> None:
    """No address is needed, and the foot has date, command line, versions, and the whole digests of model and data."""
    text = written.read_text()
    assert len(text) < 5e6
    assert re.findall(r"(?:src|href)=", text) == []
    assert "http" not in text
    foot = text[text.index("<footer>") :]
    assert re.search(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", foot)
    assert re.search(r"SHA-256 [0-9a-f]{64}", foot)
    for word in ("command", "gpcorrect 0.", "numpy", "fit"):
        assert word in foot


def test_an_array_of_several_series_is_written_once() -> None:
    """The common times of two series are one column; NaN is a gap, and words of the data cannot end the script."""
    time = np.array([0.0, 1.0])
    series = [Series(n, Mark.LINE, Role.RAW, time, np.array([1.0, np.nan])) for n in ("a", "</script>")]
    data = charts_data([Chart("", [Panel("x", "y", series)])])
    assert data["columns"] == [[0.0, 1.0], [1.0, None], [1.0, None]]


def test_a_page_begins_with_a_trajectory_that_it_lists(
    small_corrector: CommandCorrector, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of more trajectories than a page lists, the first shown was one that has neither row nor charts."""
    monkeypatch.setattr(paths, "MOST_TRAJECTORIES", 1)
    for seed in (5, 7, 8):
        log, page = small_log(seed, trajectories=6), tmp_path / "page.html"
        write_evaluation_report(evaluate_model(small_corrector, log), log, page)
        html = page.read_text()
        assert re.findall('data-key="([^"]*)"', html) == re.findall('"chosen": "([^"]*)"', html) == ["0"]


def test_static_poses_are_dots_and_have_no_table(small_corrector: CommandCorrector, tmp_path: Path) -> None:
    """Nothing joins one measured pose to the next, and none is a trajectory to choose."""
    log = small_log(5, trajectories=2)
    rows = np.arange(len(log))
    still = replace(log, time=rows, trajectory=rows, static=True)
    dirty = replace(small_corrector.measure(log, np.ones(len(log), dtype=bool)), trajectory=rows, time=1.0 * rows)
    evaluation = Evaluation(small_corrector, dirty, dirty, small_corrector.clean(log))
    write_evaluation_report(evaluation, still, tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert "Static poses, in the order of the recording" in page
    assert "data-key=" not in page
    data = json.loads(page.split('id="data">')[1].split("</script>")[0])
    assert {s["mark"] for panel in data["charts"][1]["panels"] for s in panel["series"]} == {"dots"}
