"""`gpcorrect secure` and `gpcorrect doctor`: a site that asks who is there, and why nobody answers."""

from __future__ import annotations

import datetime
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from gpcorrect.cli.console import err, out, print_json, print_result, styled
from gpcorrect.cli.options import SERVICE, ArmName, Config, Json, KeyRoot
from gpcorrect.cli.processes import stop_signal

secure_app = typer.Typer(no_args_is_help=True)


@secure_app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="Where to write; made.")],
    host: Annotated[str, typer.Option(help="The router's machine, as clients write it.")] = "localhost",
    port: Annotated[int, typer.Option(help="Port of the router.", min=1, max=65535)] = 7450,
    namespace: KeyRoot = "gpcorrect",
    days: Annotated[int, typer.Option(help="How long certificates are valid.", min=1, max=36500)] = 365,
    json: Json = False,
) -> None:
    """Make a certificate authority, certificates and passwords, and a configuration for the router and every role.

    Example: gpcorrect secure init site/ --host router.lab; then: gpcorrect router site/router.json5, gpcorrect serve
    MODEL --config site/server.json5 --allow-remote, gpcorrect query correct --config site/planner.json5 ...
    """
    from gpcorrect_service.ops.secure import USERS, Site, secure_site  # zenoh is an extra

    secure_site(folder, Site(host, port, namespace, days), datetime.datetime.now(datetime.UTC))
    names = ["router.json5", *(f"{user}.json5" for user in USERS), "passwords.txt"]
    print_result({"folder": str(folder), "files": names}, f"wrote {folder}: {', '.join(names)}", as_json=json)
    err.print("Hand each user its own .json5, .pem and .key, and ca.pem; keep ca.key away from every network.")


def router(config: Annotated[Path, typer.Argument(help="zenoh configuration (JSON5) with mode router.")]) -> None:
    """Run a zenoh router until stopped, as zenohd does.

    Example: gpcorrect router site/router.json5
    """
    stop = stop_signal()
    from gpcorrect_service.ops.router import route

    route(config, stop, lambda: err.print(f"routing as {config} says; stop with Ctrl-C"))


def doctor(
    endpoint: Annotated[
        list[str] | None, typer.Option(help="Address of a server or router, repeatable.", show_default=SERVICE)
    ] = None,
    arm: ArmName = "arm1",
    namespace: KeyRoot = "gpcorrect",
    config: Config = None,
    json: Json = False,
) -> None:
    """Find out why nobody answers: closed port, missing or foreign certificate, wrong password, denied key, no server.

    Servers of one arm that hold different models are wrong too. Exit status 1 when something is.

    Example: gpcorrect doctor --config site/planner.json5
    """
    from gpcorrect_service import ClientSettings
    from gpcorrect_service.ops.doctor import examine

    settings = ClientSettings(tuple(endpoint or (SERVICE,)), arm, namespace, config_file=config)
    findings = []
    for finding in examine(settings):
        findings.append(finding)
        if not json:
            mark = ("well  ", "green") if finding.well else ("wrong ", "bold red")
            out.print(styled(mark, f" {finding.step:<7} {finding.what}  {finding.cause}"))
            if finding.next_step and not finding.well:
                out.print(styled("       ", ("try:", "bold"), " ", finding.next_step))
    if json:
        print_json([asdict(finding) for finding in findings])
    raise typer.Exit(0 if all(finding.well for finding in findings) else 1)
