"""`gpcorrect info` and `models`: what a model file remembers, the store of models, and which one a server uses."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gpcorrect.cli.console import dropped_words, note, out, plain_table, print_json, print_result
from gpcorrect.cli.options import SERVICE, AnyModel, ArmName, Config, Json, KeyRoot, ServicePlace, one_of
from gpcorrect.errors import ArtifactError, DataError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gpcorrect.calibration import Corrector, Entry, ModelStore, Step
    from gpcorrect_service.client.operator import Operator


DIGITS = 12  # of a digest that are shown to people, as in `gpcorrect models list`, chosen by hand; JSON holds all


def info(model: AnyModel, json: Json = False) -> None:
    """Print what a model file remembers: task, data, each step of its making with command, versions, held-out errors.

    Example: gpcorrect info model.gpc
    """
    from gpcorrect.calibration import load_with_hash

    corrector: Corrector
    corrector, digest = load_with_hash(model)
    if json:
        described = {"file": str(model), "hash": digest, "task": corrector.TASK, "bytes": model.stat().st_size}
        print_json({**described, "history": [asdict(s) for s in corrector.history], "model": corrector.info()})
        return
    show_model(corrector, digest)


def show_model(corrector: Corrector, digest: str) -> None:
    """Print for people what a model remembers.

    Parameters
    ----------
    corrector : Corrector
    digest : str, SHA-256 of its file
    """
    summary: dict[str, Any] = corrector.info()
    fit, data = summary.get("fit", {}), summary.get("data", {})
    facts = {
        "task": corrector.TASK,
        "hash": digest,
        "robot": " ".join(str(part) for part in (summary.get("robot"), summary.get("arm")) if part),
        "method": f"{summary.get('method')} on {', '.join(summary.get('features', ()))}",
        "data": " ".join(str(part) for part in (data.get("source"), data.get("sha256", "")[:DIGITS]) if part),
        "trained on": f"{fit.get('n_train')} samples of {fit.get('n_trajectories')} trajectories",
        "dropped": dropped_words(fit.get("dropped", {})),
        "remarks": "; ".join(summary.get("remarks", ())),
    }
    table = plain_table("", "", left=2)
    table.show_header = False
    for name, value in facts.items():
        if value:
            table.add_row(name, value)
    out.print(table)
    if not corrector.history:
        note("the file is of before models kept their history: nothing is known of date, command and held-out errors")
    for step in corrector.history:
        _show_step(step)


def _rmse_words(parts: Iterable[tuple[str, float]]) -> str:
    """Return errors in a few words, units once where neighbours share them: `0.41 mm 0.22 deg`."""
    words: list[str] = []
    for unit, rmse in parts:
        if words and words[-1] == unit:
            words.pop()
        words += [f"{rmse:.3g}", unit]
    return " ".join(words) or "-"


def _versions_words(step: Step) -> str:
    """Return the versions of a step in a line."""
    return ", ".join(f"{name} {number}" for name, number in step.versions.items())


def _show_step(step: Step) -> None:
    out.print(f"\n{step.what} of {step.date}")
    out.print(f"  $ {step.command}")
    out.print(f"  data {step.source} {step.sha256[:DIGITS]}")
    out.print(f"  with {_versions_words(step)}")
    measured = step.held_out
    if measured is None:
        out.print("  nothing was held out")
        return
    table = plain_table("", "", "mean", "SD", "rmse", "p95", "max", "", left=2)
    for row in measured.errors:
        leaves = (f"{value:.4f}" for value in (row.mean, row.sd, row.rmse, row.p95, row.max))
        table.add_row(f"  {row.part}", row.method, *leaves, row.unit)
    out.print(f"  held out: {measured.samples} samples of {measured.trajectories} trajectories")
    out.print(table)
    covered, inside = 100 * measured.coverage95, 100 * measured.in_domain
    out.print(f"  95 % intervals cover {covered:.1f} %; {inside:.1f} % in domain")


models_app = typer.Typer(no_args_is_help=True)

Store = Annotated[Path | None, typer.Option(help="Folder of the models.")]
Endpoint = Annotated[str | None, typer.Option(help="Address of running servers instead.")]
Kind = Annotated[str, typer.Option(help="pose or joints.")]
Name = Annotated[str, typer.Argument(help="Name of a model, or the beginning of its hash.")]
OneModel = Annotated[
    str, typer.Argument(help="Model file; with --store the name of a model, or the beginning of its hash.")
]


@dataclass(frozen=True)
class Place:
    """Where the models are: in a folder, or in running servers."""

    store: Store = None
    endpoint: Endpoint = None
    arm: ArmName = "arm1"
    namespace: KeyRoot = "gpcorrect"
    config: Config = None


def _stored(place: Place) -> ModelStore | None:
    """Return the folder that was named, None for servers; both at once are refused."""
    if place.store is None:
        return None
    if place.endpoint is not None or place.config is not None:
        hint = "Leave out --store for the servers, or --endpoint and --config for the folder."
        raise DataError("models are either in a folder or in running servers, and both were named.", hint=hint)
    return _folder(place.store)


@models_app.command("list")
def list_models(place: Place, json: Json = False) -> None:
    """List the models, oldest first.

    Example: gpcorrect models list --store models/
    """
    if (folder := _stored(place)) is not None:
        rows = _stored_rows(folder)
    else:
        with _operator(place) as operator:
            import msgspec  # comes with the same extra as zenoh

            rows = [{**msgspec.to_builtins(e), "replica": a.replica} for a in operator.models() for e in a.models]
    if json:
        print_json(rows)
        return
    table = plain_table("", "name", "hash", "kind", "made (UTC)", "held-out RMSE", "added (UTC)", "server", left=8)
    for row in rows:
        when = time.strftime("%Y-%m-%d %H:%M", time.gmtime(row["added"]))
        mark = "active" if row["active"] else ""
        errors = _rmse_words((part["unit"], part["rmse"]) for part in row["held_out"])
        made = row["made"][:16].replace("T", " ") or "-"
        table.add_row(mark, row["id"], row["hash"][:DIGITS], row["kind"], made, errors, when, row.get("replica", ""))
    out.print(table if rows else "no models yet; add one: gpcorrect models add MODEL --store FOLDER")


@models_app.command()
def add(
    model: AnyModel,
    store: Annotated[Path, typer.Option(help="Folder of the models; made where it is not there.")],
    name: Annotated[str, typer.Option(help="What to call it; the file's name by default.")] = "",
    json: Json = False,
) -> None:
    """Copy a model file into the store, verified and tried on its recorded check queries; it is not yet activated.

    Example: gpcorrect models add model.gpc --store models/
    """
    entry = _folder(store).add(model, now=time.time(), name=name)
    print_result(asdict(entry), f"added {entry.id} {entry.hash[:DIGITS]} ({entry.kind})", as_json=json)


@models_app.command()
def activate(model: Name, place: Place, json: Json = False) -> None:
    """Make a model the active one: in a folder, for its servers and the next start, or in every running server at once.

    Example: gpcorrect models activate monday --endpoint tcp/127.0.0.1:7449
    """
    if (folder := _stored(place)) is not None:
        entry = folder.find(model)
        before = folder.active(entry.kind)
        folder.activate(entry)
        _show_stored(folder, before, entry, as_json=json)
        return
    with _operator(place) as operator:
        _show_activated(operator, model, as_json=json)


@models_app.command()
def rollback(place: Place, kind: Kind = "pose", json: Json = False) -> None:
    """Go back to the model that was active before.

    Example: gpcorrect models rollback --store models/
    """
    one_of(kind, ("pose", "joints"), "a kind")
    if (folder := _stored(place)) is not None:
        before = folder.active(kind)
        _show_stored(folder, before, folder.rollback(kind), as_json=json)
        return
    with _operator(place) as operator:
        answer = operator.models()[0]
        history = answer.history.get(kind, [])
        if len(history) < 2:
            raise DataError(f"{answer.replica} has no {kind} model to go back to.")
        _show_activated(operator, history[-2], back=True, as_json=json)


@models_app.command()
def diff(
    one: OneModel,
    other: OneModel,
    store: Annotated[Path | None, typer.Option(help="Folder of the models; without it they are files.")] = None,
    json: Json = False,
) -> None:
    """Compare two models: how each was made, their held-out errors, and how far the commands of pose models lie apart.

    Examples: gpcorrect models diff monday.gpc tuesday.gpc; gpcorrect models diff monday tuesday --store models/
    """
    from gpcorrect.calibration import compare, load_any

    models: list[Corrector]
    if store is None:
        models = [load_any(name) for name in (one, other)]
    else:
        folder = _folder(store)
        models = [folder.verified(folder.find(name)) for name in (one, other)]
    found = compare(*models)
    if json:
        print_json(found)
        return
    table = plain_table("", one, other, left=3)
    first, second = map(_described, models)
    for name, words in first.items():
        if words != second[name]:
            table.add_row(name, words, second[name])
    out.print(table if table.row_count else "both say the same of themselves")
    if "commands" in found:
        apart = found["commands"]
        out.print(
            f"commands apart on {apart['queries']} recorded queries: mean {apart['mean_mm']:.3f} mm, "
            f"max {apart['max_mm']:.3f} mm, max {apart['max_deg']:.3f} deg"
        )


@models_app.command()
def state(
    state: Annotated[str, typer.Argument(help="ENABLED or PAUSED.")], place: ServicePlace, json: Json = False
) -> None:
    """Pause every running server of an arm, or let it go on; ENABLED also ends a FAULT.

    Example: gpcorrect models state PAUSED
    """
    one_of(state, ("ENABLED", "PAUSED"), "a state")
    with _operator(place) as operator:
        answers = operator.set_state(state)  # type: ignore[arg-type]  # checked above
    if json:
        print_json([{"replica": a.replica, "state": a.state, "stays": a.stays} for a in answers])
        return
    for answer in answers:
        forgets = state == "PAUSED" and not answer.stays
        until = " until it is started again: it has no store, or could not write to it" if forgets else ""
        out.print(f"{answer.replica}: {answer.state}{until}")


def _operator(place: Place | ServicePlace) -> Operator:
    from gpcorrect_service import ClientSettings  # zenoh is an extra; folders need none
    from gpcorrect_service.client.operator import Operator

    if place.endpoint is None and place.config is None:
        raise DataError("name the models' place.", hint="--store FOLDER, or --endpoint tcp/127.0.0.1:7449")
    return Operator(ClientSettings((place.endpoint or SERVICE,), place.arm, place.namespace, config_file=place.config))


def _show_activated(operator: Operator, model: str, *, back: bool = False, as_json: bool) -> None:
    answers = operator.activate(model, back=back)
    if as_json:
        import msgspec  # comes with the same extra as zenoh

        print_json(msgspec.to_builtins(answers))
        return
    for answer in answers:
        before = answer.before[:DIGITS] or "-"
        apart = _apart_words(answer.apart_mm, answer.apart_deg)
        out.print(f"{answer.replica}: {answer.kind} {answer.id} {answer.hash[:DIGITS]}, before {before}{apart}")


def _show_stored(folder: ModelStore, before: Entry | None, entry: Entry, *, as_json: bool) -> None:
    """Print which model of a folder is active now, and how far its commands lie from those of the one before."""
    from gpcorrect.calibration import commands_apart

    mm = deg = None
    if before is not None and entry.kind == "pose":
        with suppress(ArtifactError):  # a damaged one may be followed
            found = commands_apart(folder.verified(before), folder.verified(entry))
            mm, deg = found["max_mm"], found["max_deg"]
    words = f"active {entry.kind}: {entry.id} {entry.hash[:DIGITS]}{_apart_words(mm, deg)}"
    told = {**asdict(entry), "apart_mm": mm, "apart_deg": deg}
    print_result(told, f"{words}; servers of this folder take it within seconds", as_json=as_json)


def _apart_words(mm: float | None, deg: float | None) -> str:
    return "" if mm is None else f", whose commands lie up to {mm:.3g} mm and {deg:.3g} deg from the former's"


def _folder(path: Path) -> ModelStore:
    from gpcorrect.calibration import ModelStore

    return ModelStore(path)


def _described(model: Corrector) -> dict[str, str]:
    """Return what `models diff` compares, a line each."""
    from gpcorrect.calibration import last_measured

    summary: dict[str, Any] = model.info()
    fit, data, step = summary.get("fit", {}), summary.get("data", {}), model.history[-1] if model.history else None
    measured = last_measured(model.history)
    dropped = sum(fit.get("dropped", {}).values())
    return {
        "made": f"{step.what} {step.date}" if step else "-",
        "with": _versions_words(step) if step else "-",
        "data": f"{data.get('source')} {data.get('sha256', '')[:DIGITS]}",
        "updates": str(len(summary.get("updates", ()))),
        "learned": f"{fit.get('n_train')} samples, {fit.get('n_trajectories')} trajectories, {dropped} dropped",
        "method": f"{summary.get('method')} on {', '.join(summary.get('features', ()))}",
        "seed": str(fit.get("seed")),
        "held-out RMSE": _rmse_words((row.unit, row.rmse) for row in measured.corrected) if measured else "-",
        "measured on": f"{measured.samples} samples, {measured.trajectories} trajectories" if measured else "-",
        "95 % cover": f"{100 * measured.coverage95:.1f} %" if measured else "-",
    }


def _stored_rows(folder: ModelStore) -> list[dict[str, Any]]:
    from gpcorrect.calibration import last_measured

    rows = []
    for entry in folder.models():
        active, history = folder.active(entry.kind), folder.made(entry)
        measured = last_measured(history)
        parts = [{"part": r.part, "unit": r.unit, "rmse": r.rmse} for r in (measured.corrected if measured else ())]
        row = {"id": entry.id, "hash": entry.hash, "kind": entry.kind, "added": entry.added}
        row |= {"active": active is not None and active.hash == entry.hash}
        rows.append(row | {"made": history[-1].date if history else "", "held_out": parts})
    return rows
