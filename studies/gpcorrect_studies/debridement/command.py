"""`gpcorrect debride`: the debridement task on simulated arms, with a correction that other processes serve."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, get_args

import numpy as np
import typer
from joblib import Parallel, cpu_count, delayed

from gpcorrect.atomic import make_folder
from gpcorrect.cli.console import err, out, plain_table, print_json, progress_bar
from gpcorrect.cli.options import Json, OldConnect, Report, one_of, renamed, report_page
from gpcorrect.cli.processes import free_endpoint, running
from gpcorrect.errors import DataError
from gpcorrect.planning import Margins, Mode
from gpcorrect_studies.debridement.mission import PAPER, Condition, Mission, compare
from gpcorrect_studies.debridement.rehearsal import AFTER_REHEARSAL, learn
from gpcorrect_studies.debridement.scene import Station, stations

if TYPE_CHECKING:
    from gpcorrect_service import CorrectionClient

# Chosen by hand, s for a busy machine.
CONNECT = 120.0  # for a service that is started here to load its model
FOUND = 10.0  # for one that runs


def debride(
    fragments: Annotated[int, typer.Option(help="Fragments of a set, over all arms.", min=1)] = 4,
    sets: Annotated[int, typer.Option(help="Sets of fragments to remove; figures are their means.", min=1)] = 5,
    arms: Annotated[int, typer.Option(help="One arm or two.", min=1, max=2)] = 2,
    speed: Annotated[float, typer.Option(help="Speed in open loop, cm/s.", min=0.5, max=20)] = 6.0,
    slow: Annotated[float, typer.Option(help="Speed without correction, cm/s.", min=0.1, max=20)] = 1.0,
    mode: Annotated[str, typer.Option(help="Correct paths in full, or their endpoints only.")] = "full",
    margin: Annotated[float, typer.Option(help="Widest 95 % interval at a fragment, mm; wider ones replan.")] = 6.0,
    rehearsals: Annotated[int, typer.Option(help="Fragments that each arm rehearses to learn from.", min=8)] = 20,
    models: Annotated[
        Path | None,
        typer.Option(help="Folder that keeps the models; those of the same rehearsal are taken.", show_default=False),
    ] = None,
    endpoint: Annotated[
        list[str] | None,
        typer.Option(help="Address of a running service, one an arm or one for all; none is started then."),
    ] = None,
    report: Report = None,
    old_picture: Annotated[Path | None, renamed("--picture", "--report", "the page draws the paths")] = None,
    old_animation: Annotated[Path | None, renamed("--animation", "--report", "the page draws the paths")] = None,
    seed: Annotated[int, typer.Option(help="Seed of fragments, rehearsals and noise.", min=0)] = 0,
    old_connect: OldConnect = None,
    json: Json = False,
) -> None:
    """Remove fragments with simulated arms: looking often at 1 cm/s, or corrected and in open loop at 6 cm/s.

    Each arm rehearses the task under a tracker and is fitted; its correction is then served over zenoh by another
    process, and the planner asks it for every path. Without --endpoint these services are started here.

    For example:

    gpcorrect debride --fragments 8 --report task.html

    gpcorrect debride --arms 1 --models demo/ --report task.html
    """
    page = report_page(report)
    chosen: Mode = one_of(mode, get_args(Mode), "the mode")
    scene, places = stations(arms)
    given = _one_an_arm(endpoint or [], arms, models)
    with ExitStack() as stack:
        folder = models
        if folder is None and not given:
            folder = Path(stack.enter_context(TemporaryDirectory()))
        if folder is not None:
            make_folder(folder)
        progress = stack.enter_context(progress_bar(quiet=json))
        progress.step("rehearsal and fit", 0.0)
        ends = Parallel(n_jobs=arms)(
            delayed(learn)(scene, place, folder, rehearsals, speed / 100, seed) for place in places
        )
        progress.step("rehearsal and fit", 1.0)
        start = max(ends) + AFTER_REHEARSAL
        endpoints = given if folder is None else stack.enter_context(_services(places, folder))
        with _clients(places, endpoints, FOUND if given else CONNECT) as clients:
            served = [client.model() for client in clients]
        ways = {"fast": speed / 100, "slow": slow / 100, "margins": Margins(position=margin / 1e3), "mode": chosen}
        missions = [
            Mission(scene, places, scene.fragments(fragments, np.random.default_rng([seed, 3, number])), start=start)
            for number in range(sets)
        ]
        done: list[tuple[Condition, ...]] = []
        for found in Parallel(n_jobs=min(sets, cpu_count()), return_as="generator")(
            delayed(_done)(mission, endpoints, seed + number, ways) for number, mission in enumerate(missions)
        ):
            done.append(found)
            progress.step("sets of fragments", len(done) / sets)
        conditions = Condition.joined(done)
    facts = _facts(conditions, [f"{m.id}, SHA-256 {m.hash}, by {m.replica}" for m in served], chosen)
    if page is not None:
        from gpcorrect_studies.debridement.page import write_debride_page  # the report's libraries are an extra

        write_debride_page(scene, conditions, facts, page)
    if json:
        print_json(facts)
    else:
        _show(conditions, facts)


def _done(mission: Mission, endpoints: Sequence[str], seed: int, ways: Mapping[str, Any]) -> tuple[Condition, ...]:
    """Do the task of one set in every way, in a process that asks the services by itself."""
    with _clients(mission.stations, endpoints, FOUND) as clients:
        return compare(mission, clients, seed, **ways)


def _one_an_arm(given: Sequence[str], arms: int, models: Path | None) -> list[str]:
    """Return the address of each arm's running service, none where services are to be started from a folder's models.

    DataError where the number of addresses fits no arms, or a folder was named too.
    """
    if given and models is not None:
        hint = "Leave out --models to ask these services, or --endpoint to have the folder's models served."
        raise DataError("services that run have their models, and a folder of models was named too.", hint=hint)
    if len(given) not in (0, 1, arms):
        raise DataError(f"give one address, or one an arm ({arms}); got {len(given)}.")
    return list(given) * (arms if len(given) == 1 else 1)


@contextmanager
def _services(places: Sequence[Station], folder: Path) -> Iterator[list[str]]:
    """Serve each arm's model from a process that is started here, and give their addresses."""
    endpoints = [free_endpoint() for _ in places]
    with ExitStack() as stack:
        for place, endpoint in zip(places, endpoints, strict=True):
            model = str(folder / f"{place.name}.gpc")
            stack.enter_context(running("serve", model, "--endpoint", endpoint, "--arm", place.name))
        yield endpoints


@contextmanager
def _clients(places: Sequence[Station], endpoints: Sequence[str], patience: float) -> Iterator[list[CorrectionClient]]:
    """Give a client of each arm's service, which waits so many seconds for it to appear."""
    from gpcorrect_service import CorrectionClient  # zenoh is an extra; other commands work without it

    with ExitStack() as stack:
        yield [
            stack.enter_context(CorrectionClient(endpoint, place.name, timeout=5.0, connect_timeout=patience))
            for place, endpoint in zip(places, endpoints, strict=True)
        ]


def _facts(conditions: Sequence[Condition], served: list[str], mode: Mode) -> dict[str, Any]:
    looking, knowing, *_ = found = [condition.to_dict() for condition in conditions]
    return {
        "conditions": found,
        "sets": len(conditions[0].outcomes),
        "times_faster": looking["seconds_per_fragment"] / knowing["seconds_per_fragment"],
        "success_rate_difference": knowing["success_rate"] - looking["success_rate"],
        "paper": PAPER,
        "mode": mode,
        "served": served,
    }


def _show(conditions: Sequence[Condition], facts: dict[str, Any]) -> None:
    title = f"Debridement, simulated: means of {facts['sets']} sets of fragments; retries, re-plans and looks in all"
    columns = ("cm/s", "done", "at\nonce", "retries", "re-\nplans", "looks", "miss\nmm", "s\neach", "s in\nall")
    table = plain_table("", *columns, title=title)
    for condition in conditions:
        table.add_row(*condition.to_words())
    out.print(table)
    out.print(
        f"{facts['times_faster']:.1f} times faster with correction, success rate "
        f"{100 * facts['success_rate_difference']:+.0f} % (paper: {PAPER['times_faster']} times, "
        f"{PAPER['seconds_per_fragment']} s a fragment, at the same success rate)"
    )
    for line in facts["served"]:
        err.print(f"served: {line}")
