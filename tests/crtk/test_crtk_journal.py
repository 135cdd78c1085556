"""Laws of a recorder's journal: a torn end is left out, and what was altered is refused wherever it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpcorrect.errors import LogError
from gpcorrect_service.crtk.journal import Journal, read_journal
from gpcorrect_service.crtk.messages import Pose

NUMBER = 40


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    """Poses that a recorder wrote down before it was killed."""
    with Journal(tmp_path / "run.csv", "left") as file:
        for i in range(NUMBER):
            file.write("measured_cp", 0, Pose(1.0 + i, (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0)))
    return file.path


def test_a_torn_end_is_left_out(journal: Path) -> None:
    """Wherever the file ends, all whole messages are there."""
    whole = journal.read_bytes()
    for end in range(len(whole) - 100, len(whole)):
        journal.write_bytes(whole[:end])
        arm, entries = read_journal(journal)
        assert arm == "left"
        assert len(list(entries)) in (NUMBER - 2, NUMBER - 1)


def test_what_was_altered_is_refused_wherever_it_begins(journal: Path) -> None:
    """Also where it takes the length of a message, which then seems to be torn off with all that follows."""
    whole = journal.read_bytes()
    for first in range(400, 500):
        journal.write_bytes(whole[:first] + b"\xff" * 300 + whole[first + 300 :])
        with pytest.raises(LogError, match="altered"):
            list(read_journal(journal)[1])
