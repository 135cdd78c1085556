"""The `gpcorrect` program: its commands, and what an error looks like."""

from __future__ import annotations

import sys
from importlib.metadata import entry_points

import typer

from gpcorrect.cli.collect import collect_app
from gpcorrect.cli.console import bad_input
from gpcorrect.cli.correct import correct
from gpcorrect.cli.discrepancy import discrepancy_app
from gpcorrect.cli.drift import drift
from gpcorrect.cli.evaluate import evaluate
from gpcorrect.cli.explore import explore
from gpcorrect.cli.fit import fit
from gpcorrect.cli.joint import joint_app
from gpcorrect.cli.models import models_app
from gpcorrect.cli.monitor import monitor
from gpcorrect.cli.prefilter import prefilter
from gpcorrect.cli.query import query_app
from gpcorrect.cli.robot import robot_app
from gpcorrect.cli.secure import doctor, router, secure_app
from gpcorrect.cli.serve import serve
from gpcorrect.cli.sim import sim_app
from gpcorrect.cli.simulate import simulate
from gpcorrect.cli.update import update
from gpcorrect.cli.validate import validate
from gpcorrect.cli.vision import vision_app
from gpcorrect.cli.zigzag import zigzag_command
from gpcorrect.errors import GpCorrectError

__all__ = ["app", "main"]

EXAMPLES = """A first try: `gpcorrect simulate debridement --reaches 40 --output log.csv`, then
`gpcorrect fit log.csv --output model.gpc`, then `gpcorrect serve model.gpc`, and in another terminal
`gpcorrect query model`. Each command says more: `gpcorrect fit --help`."""

app = typer.Typer(
    name="gpcorrect",
    help="Learn how a cable-driven robot misses its commanded pose, and what to command instead.",
    epilog=EXAMPLES,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
    pretty_exceptions_enable=False,
)
app.command()(validate)
app.command()(fit)
app.command()(evaluate)
app.command()(correct)
app.command()(update)
app.command()(drift)
app.command()(explore)
app.command()(serve)
app.add_typer(query_app, name="query")
app.command()(prefilter)
app.command()(monitor)
app.add_typer(sim_app, name="sim")
app.add_typer(robot_app, name="robot")
app.add_typer(collect_app, name="collect")
app.add_typer(models_app, name="models")
app.add_typer(secure_app, name="secure")
app.command()(router)
app.command()(doctor)
app.command()(simulate)
app.command(name="zigzag")(zigzag_command)
app.add_typer(joint_app, name="joint")
app.add_typer(vision_app, name="vision")
app.add_typer(discrepancy_app, name="discrepancy")
for plugin in entry_points(
    group="gpcorrect.commands"
):  # commands of packages above this one, as pyproject.toml names them
    part = plugin.load()
    if isinstance(part, typer.Typer):
        app.add_typer(part, name=plugin.name)
    else:
        app.command(name=plugin.name)(part)


def main() -> None:
    """Run the command line; bad input ends with one clear message and exit status 2."""
    try:
        app()
    except GpCorrectError as error:
        sys.exit(bad_input(error).exit_code)
