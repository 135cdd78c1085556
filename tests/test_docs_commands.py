"""Every command that the documentation shows is one that the program takes."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
import typer.main
from support import ROOT

from gpcorrect.cli.app import app

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHOWN = re.compile(r"^(?:    |\$ )?\s*(gpcorrect [a-z].*|python bench/.*)$", re.MULTILINE)


def shown() -> Iterator[tuple[str, str]]:
    """Page and command of each line that a reader may copy."""
    for page in PAGES:
        for match in SHOWN.finditer(re.sub(r"\\\n\s*", "", page.read_text())):  # a line that goes on in the next
            yield page.name, re.split(r"\s{2,}#", match[1])[0].strip()


def commands_of(command: click.Command, path: str = "gpcorrect") -> Iterator[tuple[str, click.Command]]:
    """All commands of the program with their full names."""
    for name, part in getattr(command, "commands", {}).items():
        yield f"{path} {name}", part
        yield from commands_of(part, f"{path} {name}")


def parse(words: list[str]) -> None:
    """Parse a command as the program does, without running it."""
    command: click.Command = typer.main.get_command(app)
    name = words.pop(0)
    while hasattr(command, "commands"):
        name = words.pop(0)
        if name not in command.commands:
            raise click.UsageError(f"there is no command {name}")
        command = command.commands[name]
    command.make_context(name, words)


@pytest.mark.parametrize(("page", "text"), sorted(set(shown())))
def test_a_shown_command_is_taken(page: str, text: str) -> None:
    """Names of commands and options, and the number of arguments, are right; a benchmark has the options shown."""
    words = shlex.split(re.sub(r"\$\([^)]*\)", "x", text).replace("...", "x"))
    if words[0] == "gpcorrect":
        parse(words)
        return
    script = ROOT / words[1]
    assert script.is_file()
    for option in (word for word in words[2:] if word.startswith("--")):
        assert f'"{option}"' in script.read_text()


def test_the_examples_of_the_help_are_taken() -> None:
    """The examples at the end of each command's help are parsed by that command."""
    found = 0
    for name, command in commands_of(typer.main.get_command(app)):
        for line in (command.help or "").splitlines():
            example = re.match(rf"(?:Example: )?({name} [^,]*)$", line.strip())
            if example and "Example" in (command.help or ""):
                parse(shlex.split(example[1].rstrip(".`")))
                found += 1
    assert found > 10


def test_pages_link_to_files_that_exist() -> None:
    """A relative link leads somewhere."""
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:\s]+)\)", page.read_text()):
            assert (Path(page).parent / target).exists(), f"{page.name}: {target}"
