"""Parts of a study in a file: what was done is not done again."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpcorrect.types import Progress
from gpcorrect_studies.parts import Parts

RUN = {"study": "one", "seed": 0}


def refuse() -> None:
    raise AssertionError("made again")


def test_what_was_written_down_is_not_made_again(tmp_path: Path) -> None:
    """A second run of the same gets what the first one got, keys and tuples alike, and its seconds."""
    path = tmp_path / "parts.jsonl"
    first = Parts(path, RUN).done("a", lambda: {1: (2.0, float("nan"))})
    again = Parts(path, RUN)
    assert again.done("a", refuse) == first == {"1": [2.0, None]}
    assert again.count == 1
    assert again.seconds_before >= 0.0


@pytest.mark.parametrize("cut", [2, 5, 12])
def test_a_part_that_was_cut_is_made_again(tmp_path: Path, cut: int) -> None:
    """A run that was killed while it wrote loses that part alone, and the next one is written whole."""
    path = tmp_path / "parts.jsonl"
    parts = Parts(path, RUN)
    parts.done("a", lambda: 1)
    parts.done("b", lambda: 2)
    path.write_text(path.read_text()[:-cut])
    again = Parts(path, RUN)
    assert (again.done("a", refuse), again.done("b", lambda: 3)) == (1, 3)
    assert Parts(path, RUN).done("b", refuse) == 3


def test_another_run_begins_anew(tmp_path: Path) -> None:
    """Another seed is another study."""
    path = tmp_path / "parts.jsonl"
    Parts(path, RUN).done("a", lambda: 1)
    assert Parts(path, RUN | {"seed": 1}).done("a", lambda: 2) == 2
    assert Parts(path, RUN).done("a", lambda: 3) == 3


def test_only_missing_items_are_done(tmp_path: Path) -> None:
    """Of several items those that are there are not done again; the order is that of the items."""
    path, asked = tmp_path / "parts.jsonl", []

    def twice(x: int) -> int:
        asked.append(x)
        return 2 * x

    Parts(path, RUN).each("t", twice, {"b": 2}, Progress())
    assert list(Parts(path, RUN).each("t", twice, {"a": 1, "b": 2, "c": 3}, Progress()).items()) == [
        ("a", 2),
        ("b", 4),
        ("c", 6),
    ]
    assert asked == [2, 1, 3]


def test_nothing_is_written_without_a_file() -> None:
    """Without a path parts are remembered, and no file is needed to remove."""
    parts = Parts()
    assert parts.done("a", lambda: 1) == parts.done("a", refuse) == 1
    parts.remove()
