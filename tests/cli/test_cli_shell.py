"""The program in a shell: completion, JSON from every command, and tables that are never cut."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import PROGRAM, CommandLine
from rich.table import Table

from gpcorrect.cli.console import out, plain_table

WITHOUT_JSON = {
    ("serve",): "runs until stopped",
    ("monitor",): "runs until stopped",
    ("prefilter",): "runs until stopped",
    ("router",): "runs until stopped",
    ("sim", "serve"): "runs until stopped",
    ("query", "metrics"): "prints OpenMetrics text, a format of its own",
}
COMPLETED = """
eval "$(_GPCORRECT_COMPLETE=source_bash gpcorrect)"
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
_gpcorrect_completion gpcorrect
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (("mo",), {"models", "monitor"}),
        (("models", "di"), {"diff"}),
        (("fit", "--hold"), {"--holdout", "--hold-out-by"}),
        (("reprod",), {"reproduce"}),
        (("joint", "fit", "log.csv", "--end"), {"--end-to-end"}),
    ],
)
def test_bash_completes_commands_and_options(words: tuple[str, ...], offered: set[str]) -> None:
    """What bash offers after the first letters: commands, those of plugins too, subcommands and options."""
    if shutil.which("bash") is None:
        pytest.skip("bash is not installed")
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-c", COMPLETED, "bash", "gpcorrect", *words],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert set(done.stdout.split()) == offered, done.stderr


def test_completion_can_be_installed(gpcorrect: CommandLine) -> None:
    """The program's help names the option that teaches the shell."""
    assert "--install-completion" in gpcorrect("--help").out


def test_every_command_that_prints_results_prints_json() -> None:
    """Each command takes --json, but those that run until they are stopped, and one that prints another format."""
    commands = {path: PROGRAM.command(*path) for path in PROGRAM.walk()}
    leaves = {path: command for path, command in commands.items() if not hasattr(command, "commands")}
    without = {path for path, c in leaves.items() if not any("--json" in p.opts for p in c.params)}
    assert without == set(WITHOUT_JSON)


def test_simulate_and_models_say_in_json_what_they_did(
    gpcorrect: CommandLine, small_model: Path, tmp_path: Path
) -> None:
    """Standard output is JSON alone, of what was written and what is active."""
    log, store = tmp_path / "log.csv", tmp_path / "store"
    simulated = gpcorrect("simulate", "debridement", "--reaches", 2, "--output", log, "--json")
    assert simulated.json["output"] == str(log)
    assert simulated.json["trajectories"] == 2
    added = gpcorrect("models", "add", small_model, "--store", store, "--json").json
    assert gpcorrect("models", "activate", added["id"], "--store", store, "--json").json["hash"] == added["hash"]
    made = gpcorrect("secure", "init", tmp_path / "site", "--json").json
    assert all((tmp_path / "site" / name).exists() for name in made["files"])


def test_a_terminal_of_few_signs_shows_escapes(log_file: Path, tmp_path: Path) -> None:
    """A name that cannot be encoded ended in a traceback and status 1, after the work was done."""
    words = ("robot", "extract", str(log_file), "--every", "9", "-o", str(tmp_path / "März.csv"))
    plain = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-m", "gpcorrect", *words], env=plain, capture_output=True, check=True)
    assert b"M\\xe4rz.csv" in done.stdout


def test_models_are_listed_in_one_time(
    gpcorrect: CommandLine, small_model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When a model was made and when it was added stood in UTC and in local time side by side."""
    store = tmp_path / "store"
    added = gpcorrect("models", "add", small_model, "--store", store, "--json").json["added"]
    monkeypatch.setenv("TZ", "Asia/Kolkata")
    time.tzset()
    try:
        listed = gpcorrect("models", "list", "--store", store).out
        local = time.strftime("%Y-%m-%d %H:%M", time.localtime(added))
    finally:
        monkeypatch.undo()
        time.tzset()
    assert local not in listed
    assert time.strftime("%Y-%m-%d %H:%M", time.gmtime(added)) in listed


def test_no_terminal_cuts_a_number(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A row of forty numbers is whole, however narrow the terminal."""
    monkeypatch.setenv("COLUMNS", "20")
    numbers = [f"{1000.123456 + number:.6f}" for number in range(40)]
    table: Table = plain_table(*numbers)
    table.add_row(*numbers)
    out.print(table)
    assert capfd.readouterr().out.splitlines()[1].split() == numbers
