"""Every command that the documentation shows is one that the program takes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import PROGRAM
from support import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHOWN = re.compile(r"^(?:    |\$ )?\s*(gpcorrect [a-z].*|python bench/.*)$", re.MULTILINE)


def shown() -> Iterator[tuple[str, str]]:
    """Page and command of each line that a reader may copy."""
    for page in PAGES:
        for match in SHOWN.finditer(re.sub(r"\\\n\s*", "", page.read_text())):  # a line that goes on in the next
            yield page.name, re.split(r"\s{2,}#", match[1])[0].strip()


@pytest.mark.parametrize(("page", "text"), sorted(set(shown())))
def test_a_shown_command_is_taken(page: str, text: str) -> None:
    """Names of commands and options, and the number of arguments, are right; a benchmark has the options shown."""
    words = shlex.split(re.sub(r"\$\([^)]*\)", "x", text).replace("...", "x"))
    if words[0] == "gpcorrect":
        PROGRAM.parse(words[1:])
        return
    script = ROOT / words[1]
    assert script.is_file()
    for option in (word for word in words[2:] if word.startswith("--")):
        assert f'"{option}"' in script.read_text()


def test_the_examples_of_the_help_are_taken() -> None:
    """The examples at the end of each command's help are parsed by that command."""
    found = 0
    for path in PROGRAM.walk():
        text = PROGRAM.command(*path).help or ""
        for line in text.splitlines():
            example = re.match(rf"(?:Example: )?gpcorrect ({' '.join(path)} [^,]*)$", line.strip())
            if example and "Example" in text:
                PROGRAM.parse(shlex.split(example[1].rstrip(".`")))
                found += 1
    assert found > 10


def test_pages_link_to_files_that_exist() -> None:
    """A relative link leads somewhere."""
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:\s]+)\)", page.read_text()):
            assert (Path(page).parent / target).exists(), f"{page.name}: {target}"
