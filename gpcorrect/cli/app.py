"""The `gpcorrect` program: which command is in which module, and what an error looks like.

A command's module is imported when the command is called; the help of the program needs only the lines below. Other
packages add commands by an entry point of the group `gpcorrect.commands` that names a table like COMMANDS.
"""

from __future__ import annotations

import io
import os
import sys
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from gpcorrect.errors import GpCorrectError

# Name of a command: where it is, and the line that `gpcorrect --help` shows; of a group of commands the only help, else
# a test holds it against the command's own.
COMMANDS = {
    "validate": (
        "gpcorrect.cli.validate:validate",
        "Look at a recording before fitting: rates, gaps, stamps, frozen signals, units, limits, swapped arms.",
    ),
    "topics": (
        "gpcorrect.cli.validate:topics",
        "List what is in a recording, topics, bodies, markers or columns, and propose a mapping file.",
    ),
    "convert": (
        "gpcorrect.cli.validate:convert",
        "Write a recording of any known format as a native log: SI units, one clock, a column a number.",
    ),
    "fit": (
        "gpcorrect.cli.fit:fit",
        "Learn what to command from recordings, and measure it on trajectories that were held out.",
    ),
    "evaluate": (
        "gpcorrect.cli.fit:evaluate",
        "Measure a model on recordings it has not seen: errors before, after the rigid part, and corrected.",
    ),
    "compare": (
        "gpcorrect.cli.fit:compare",
        "Measure two models of one task on the same samples of recordings: errors, intervals, domain, side by side.",
    ),
    "info": (
        "gpcorrect.cli.models:info",
        "Print what a model file remembers: task, data, each step of its making with command, versions, held-out "
        "errors.",
    ),
    "correct": (
        "gpcorrect.cli.correct:correct",
        "Print what to command instead of a desired pose, and how sure that is.",
    ),
    "update": (
        "gpcorrect.cli.update:update",
        "Add the observations of new recordings to a model; its size and the time of a query stay.",
    ),
    "drift": (
        "gpcorrect.cli.update:drift",
        "Tell from recordings, oldest first, whether a model has aged, and estimate its remaining useful time.",
    ),
    "explore": (
        "gpcorrect.cli.update:explore",
        "Propose the poses and velocities that reduce the uncertainty in the task region most, best first.",
    ),
    "joint": ("gpcorrect.cli.joint:joint_app", "Joint-space calibration: reported joints to true ones, or commands."),
    "vision": (
        "gpcorrect.cli.vision:vision_app",
        "Ground truth from ordinary cameras and coloured balls, and a position estimator from it.",
    ),
    "serve": (
        "gpcorrect.cli.serve:serve",
        "Serve models until stopped with Ctrl-C or SIGTERM: keys correct, correct_path, correct_joints, "
        "estimate, health.",
    ),
    "query": ("gpcorrect.cli.correct:query_app", "Ask a running service."),
    "models": (
        "gpcorrect.cli.models:models_app",
        "A folder of models: list, add, compare, activate, go back. With --endpoint the running servers do it.",
    ),
    "monitor": (
        "gpcorrect.cli.serve:monitor",
        "Serve a page that shows every arm of a namespace: poses, correction, interval, domain, latency, "
        "drift, servers.",
    ),
    "prefilter": (
        "gpcorrect.cli.serve:prefilter",
        "Correct a stream of desired poses before the robot sees them, until Ctrl-C or SIGTERM.",
    ),
    "robot": ("gpcorrect.cli.robot:robot_app", "Drive and record a robot that speaks CRTK over zenoh."),
    "collect": ("gpcorrect.cli.collect:collect_app", "Calibrations from end to end: drive, record, fit, measure."),
    "secure": ("gpcorrect.cli.secure:secure_app", "Certificates, passwords and access rules for a site."),
    "router": ("gpcorrect.cli.secure:router", "Run a zenoh router until stopped, as zenohd does."),
    "doctor": (
        "gpcorrect.cli.secure:doctor",
        "Find out why nobody answers: closed port, missing or foreign certificate, wrong password, denied "
        "key, no server.",
    ),
    "sim": ("gpcorrect.cli.sim:sim_app", "Simulated arms that run live."),
    "simulate": (
        "gpcorrect.cli.sim:simulate",
        "Simulate a recording: what was commanded, reported, and seen by an outside tracker, faults included.",
    ),
    "zigzag": (
        "gpcorrect.cli.collect:zigzag_command",
        "Write a zig-zag calibration trajectory for the first three joints, within their speed limits.",
    ),
    "discrepancy": (
        "gpcorrect.cli.discrepancy:discrepancy_app",
        "Find where a simulator and recordings disagree, name what is missing, and measure what the name explains.",
    ),
}

# What the help of the program ends with.
EXAMPLES = """A first try: `gpcorrect simulate debridement --reaches 40 --output log.csv`, then
`gpcorrect fit log.csv --output model.gpc`, then `gpcorrect serve model.gpc`, and in another terminal
`gpcorrect query model`. Each command says more: `gpcorrect fit --help`."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


class _Deferred(TyperCommand):
    """A command's name and line of help, until the command itself is needed."""

    def __init__(self, name: str, target: str, line: str) -> None:
        super().__init__(name, help=line)
        self.target = target

    def load(self) -> Any:
        """Import the command's module and return the command."""
        from gpcorrect.cli.options import takes_groups  # what every command's module reads too

        module, _, attribute = self.target.partition(":")
        found = getattr(import_module(module), attribute)
        one = _program()
        if isinstance(found, typer.Typer):
            for part in found.registered_commands:
                part.callback = part.callback and takes_groups(part.callback)
            one.add_typer(found, name=self.name, help=self.help)
        else:
            one.command(self.name)(takes_groups(found))
        return typer.main.get_group(one).commands[str(self.name)]


class _Commands(TyperGroup):
    """Commands of this package, and of others that are installed beside it."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self._add(COMMANDS)
        self._complete = False

    def list_commands(self, ctx: Any) -> list[str]:
        self._add_plugins()
        return super().list_commands(ctx)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name not in self.commands:
            self._add_plugins()
        return super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        return name, command.load() if isinstance(command, _Deferred) else command, rest

    def _add(self, table: dict[str, tuple[str, str]]) -> None:
        for name, (target, line) in table.items():
            self.commands.setdefault(name, _Deferred(name, target, line))

    def _add_plugins(self) -> None:
        if not self._complete:
            from importlib.metadata import entry_points  # costs as much as all the rest

            for plugin in entry_points(group="gpcorrect.commands"):
                self._add(plugin.load())
            self._complete = True


def _program(*, completion: bool = False, **attributes: Any) -> typer.Typer:
    return typer.Typer(
        add_completion=completion, rich_markup_mode="markdown", pretty_exceptions_enable=False, **attributes
    )


app = _program(
    name="gpcorrect",
    completion=True,
    cls=_Commands,
    help="Learn how a cable-driven robot misses its commanded pose, and what to command instead.",
    epilog=EXAMPLES,
    no_args_is_help=True,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from gpcorrect import __version__

        typer.echo(f"gpcorrect {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Learn how a cable-driven robot misses its commanded pose, and what to command instead."""


def main() -> None:
    """Run the command line; bad input ends with one clear message and exit status 2."""
    # The problems are many and small: pools of threads on busy cores spend their time waiting for each other. Commands
    # that use several cores start processes or threads of their own (`--jobs`). Set before anything imports NumPy.
    for name in THREADS:
        os.environ.setdefault(name, "1")
    if isinstance(sys.stdout, io.TextIOWrapper):  # what a terminal has no sign for comes out as an escape
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        app()
    except GpCorrectError as error:
        from gpcorrect.cli.console import bad_input

        sys.exit(bad_input(error))
    except OSError as error:
        from gpcorrect.atomic import NO_ROOM
        from gpcorrect.cli.console import bad_input

        if error.errno not in NO_ROOM:
            raise
        # Not only outputs are written: what numba compiled as well, in the cache of the first run.
        full = GpCorrectError(f"cannot write {error.filename or 'a file'}: {error.strerror}.", hint="Make room.")
        sys.exit(bad_input(full))
