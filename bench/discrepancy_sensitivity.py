"""What half and twice of every number in `gpcorrect/discrepancy/settings.py` do to the workflow's verdicts.

    python bench/discrepancy_sensitivity.py one:237 one:261 null:10            # cases as in discrepancy_one.py
    python bench/discrepancy_sensitivity.py one:237 --only naming search --results found.jsonl
    python bench/discrepancy_sensitivity.py one:237 null:12 --marker 20 -10 50 --only noise.mounted
    python bench/discrepancy_sensitivity.py null:16 --order 2 1 3 --only noise.perhaps_mixed

One number at a time. Numbers a little above one, or between a half and one, are taken by their distance from one (0.95
becomes 0.975 and 0.9); of the split's parts, the two small ones are halved and doubled. A row is printed where any case
has another headline or other names. Finished cases are stored line by line, so that a killed run goes on.

A stage that has not read a number, and whose inputs are those of the usual settings, is not run again; nor what comes
after one whose result is the usual one to the last bit.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from discrepancy_cases import Job, case_of, label_of
from discrepancy_jobs import TRUTHS
from discrepancy_one import jobs_of
from support import RESULTS, print_table
from threadpoolctl import threadpool_limits
from truth.spec import Case

import gpcorrect.discrepancy.run as workflow
from gpcorrect import se3
from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.discrepancy.protocol.outcomes import case_outcome
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.errors import GpCorrectError
from gpcorrect.sim import model_from_dict
from gpcorrect.types import Progress

STAGES = (
    "prepare_data", "estimate_noises", "localise_residual", "start_search", "search", "name_effects",
    "estimate_numbers", "_effects_of", "noise_effects", "gaps_of", "advise",
)  # fmt: skip
FACTORS = (0.5, 2.0)
NEAR_ONE = 1.3  # numbers from a half to it are taken by their distance from one
Field = tuple[str, str]


def fields_of(groups: list[str] | None) -> Iterator[Field]:
    """Yield every number that decides, as group and name."""
    for group in dataclasses.fields(SETTINGS):
        names = [f.name for f in dataclasses.fields(getattr(SETTINGS, group.name))]
        yield from ((group.name, n) for n in names if groups is None or {group.name, f"{group.name}.{n}"} & {*groups})


def scaled(value: Any, factor: float) -> Any:
    """Return half or twice a number, in the sense that its place near one gives it."""
    if isinstance(value, tuple):
        small = tuple(factor * v for v in value[1:])
        return (1.0 - sum(small), *small)
    if isinstance(value, int):
        return max(round(factor * value), 1)
    if 0.5 < value < 1.0:
        return 1.0 - factor * (1.0 - value)
    if 1.0 < value < NEAR_ONE:
        return 1.0 + factor * (value - 1.0)
    return factor * value


@contextmanager
def changed(field: Field, factor: float) -> Iterator[None]:
    """Set one number of the settings to half or twice for a while."""
    section = getattr(SETTINGS, field[0])
    usual = getattr(section, field[1])
    object.__setattr__(section, field[1], scaled(usual, factor))
    try:
        yield
    finally:
        object.__setattr__(section, field[1], usual)


class Reads:
    """Which numbers have been read since the last look."""

    def __init__(self) -> None:
        self.seen: set[Field] = set()
        for group in dataclasses.fields(SETTINGS):
            self._watch(group.name, type(getattr(SETTINGS, group.name)))

    def _watch(self, group: str, kind: type) -> None:
        numbers = {f.name for f in dataclasses.fields(kind)}

        def read(section: object, name: str) -> Any:
            if name in numbers:
                self.seen.add((group, name))
            return object.__getattribute__(section, name)

        kind.__getattribute__ = read


@dataclass(frozen=True, eq=False)
class Call:
    """A stage's call with the usual settings: its arguments, what it drew from, what it read, and its result."""

    name: str
    arguments: tuple[Any, ...]
    drawn: tuple[dict[str, Any], ...]
    drawn_after: tuple[dict[str, Any], ...]
    reads: frozenset[Field]
    value: Any
    digest: str
    seconds: float


class Memory:
    """What the stages came to with the usual settings, for runs with one number changed."""

    def __init__(self, reads: Reads) -> None:
        self._reads, self._stages = reads, {name: getattr(workflow, name) for name in STAGES}
        self._calls: list[Call] = []
        self._field: Field | None = None
        self.saved = 0.0

    @contextmanager
    def used(self, field: Field | None) -> Iterator[None]:
        """Let the workflow take what it can from memory while a number is changed; with None, remember everything."""
        self._field, self.saved = field, 0.0
        for name in STAGES:
            setattr(workflow, name, partial(self._run, name))
        try:
            yield
        finally:
            for name, stage in self._stages.items():
                setattr(workflow, name, stage)

    def _run(self, name: str, *arguments: Any, **named: Any) -> Any:
        every = (*arguments, *named.values())
        rngs = [a for a in every if isinstance(a, np.random.Generator)]
        drawn = tuple(r.bit_generator.state for r in rngs)
        calls = [c for c in self._calls if c.name == name and c.drawn == drawn and _is_same(c.arguments, every)]
        if (call := next((c for c in calls if self._field not in c.reads), None)) is not None:
            for rng, state in zip(rngs, call.drawn_after, strict=True):
                rng.bit_generator.state = state
            self.saved += call.seconds
            return call.value
        outer, self._reads.seen, begun = self._reads.seen, set(), time.process_time()
        value = self._stages[name](*arguments, **named)
        if name == "prepare_data":
            value.dataset.resolution  # noqa: B018 - kept on first use, and read from the settings
        spent, after = time.process_time() - begun, tuple(r.bit_generator.state for r in rngs)
        digest = joblib.hash(value)
        if self._field is None:
            self._calls.append(Call(name, every, drawn, after, frozenset(self._reads.seen), value, digest, spent))
        self._reads.seen |= outer
        return next((c.value for c in calls if c.digest == digest), value)


def _is_same(a: Any, b: Any) -> bool:
    """Whether arguments are the same objects, or equal plain ones; generators are compared by their states."""
    if a is b or isinstance(a, np.random.Generator | Progress):
        return True
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(map(_is_same, a, b))
    return bool(a == b)


def answer(job: Job, case: Case) -> dict[str, Any]:
    """Run the workflow on a case; its level, its names, and whether they are right."""
    try:
        report = find_discrepancy(model_from_dict(case.nominal), case.log, seed=job.seed).to_report()
    except GpCorrectError as error:
        return {"level": "REFUSED", "names": [str(error)], "exact": False, "wrong": False}
    outcome = case_outcome(job.key, label_of(dict(case.labels)), report)
    names = sorted(f"{e['level']} {e['name']} {e['joint']}" for e in report["verdict"]["effects"])
    return {"level": report["verdict"]["level"], "names": names, "exact": outcome.exact, "wrong": outcome.wrong}


@dataclass(frozen=True)
class Handling:
    """What a lab does to a recording: it mounts the marker away from the tip (mm), or logs joints in another order."""

    marker: tuple[float, ...] = ()
    order: tuple[int, ...] = ()

    def of(self, case: Case) -> Case:
        """Return the case so handled."""
        log, seen = case.log, case.log.tracker_cp
        if self.marker and seen is not None and seen.quaternion is not None:
            mount = se3.pose(np.eye(3), 1e-3 * np.array(self.marker))
            T = se3.from_parts(seen.position, seen.quaternion) @ mount
            log = dataclasses.replace(log, tracker_cp=dataclasses.replace(seen, position=T[:, :3, 3]))
        if self.order:
            columns = [number - 1 for number in self.order]
            joints = {s: getattr(log, s)[:, columns] for s in log.JOINTS if getattr(log, s) is not None}
            log = dataclasses.replace(log, **joints)
        return dataclasses.replace(case, log=log)

    @property
    def words(self) -> str:
        """Part of a case's name."""
        return "".join(f"@{','.join(f'{v:g}' for v in part)}" for part in (self.marker, self.order) if part)


def tried(
    job: Job, fields: list[Field], known: set[tuple[str, str, str]], handling: Handling
) -> Iterator[dict[str, Any]]:
    """Yield what a case comes to with the usual settings, and with each number changed."""
    key = job.key + handling.words
    todo = [(f, x) for f in fields for x in FACTORS if (key, ".".join(f), str(x)) not in known]
    if not todo:
        return
    case, memory = handling.of(case_of(job)), Memory(READS)
    for field, factor in [(None, 1.0), *todo]:
        begun = time.process_time()
        with memory.used(field):
            if field is None:
                found = answer(job, case)
            else:
                with changed(field, factor):
                    found = answer(job, case)
        seconds = time.process_time() - begun + memory.saved
        name = "usual" if field is None else ".".join(field)
        yield {"case": key, "field": name, "factor": factor, "seconds": seconds} | found


def show(entries: list[dict[str, Any]]) -> None:
    """Print every number that changes a verdict."""
    usual = {e["case"]: e for e in entries if e["field"] == "usual"}
    rows, idle = [], []
    for group, name in fields_of(None):
        field, value = f"{group}.{name}", getattr(getattr(SETTINGS, group), name)
        sides = [[e for e in entries if e["field"] == field and e["factor"] == x] for x in FACTORS]
        if not any(sides):
            continue
        cells = [_cell(side, usual) for side in sides]
        shown = value if isinstance(value, tuple) else f"{value:.4g}"
        if all(cell[0] == cell[1] == "." for cell in cells):
            idle.append(field)
        else:
            rows.append([field, str(shown), *cells[0], *cells[1]])
    right, wrong = (sum(e[k] for e in usual.values()) for k in ("exact", "wrong"))
    print(f"\n{len(usual)} cases; with the usual settings {right} exact, {wrong} with a wrong name")
    what = ("level", "names", "exact", "wrong", "time")
    head = ["number", "value", *(f"{x}: {w}" for x in ("half", "twice") for w in what)]
    print_table(head, rows)
    print(f"\nno case has another level or other names with half or twice of: {', '.join(idle) or 'none'}")


def _cell(side: list[dict[str, Any]], usual: dict[str, dict[str, Any]]) -> list[str]:
    pairs = [(e, usual[e["case"]]) for e in side if e["case"] in usual]
    level, names = (sum(a[k] != b[k] for a, b in pairs) for k in ("level", "names"))
    gained = [sum(int(a[k]) - int(b[k]) for a, b in pairs) for k in ("exact", "wrong")]
    time_ratio = sum(a["seconds"] for a, _ in pairs) / max(sum(b["seconds"] for _, b in pairs), 1e-9)
    return [str(level or "."), str(names or "."), *(f"{g:+d}" if g else "." for g in gained), f"{time_ratio:.2f}"]


def main() -> None:
    """Try all numbers on all cases, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="+", help="set:seed or set:first-last")
    parser.add_argument("--truth", choices=TRUTHS, default="mujoco")
    parser.add_argument("--full", dest="short", action="store_false", help="24 trajectories of 20 s, not 12 of 10 s")
    parser.add_argument("--marker", nargs=3, type=float, default=(), help="mm from the tip, along its axes")
    parser.add_argument("--order", nargs="+", type=int, default=(), help="numbers of the joints, as they are logged")
    parser.add_argument("--only", nargs="+", metavar="NUMBER", help="groups, or group.number")
    parser.add_argument("--results", type=Path, default=RESULTS / "discrepancy_sensitivity.jsonl")
    arguments = parser.parse_args()
    handling, path = Handling(tuple(arguments.marker), tuple(arguments.order)), arguments.results
    path.parent.mkdir(parents=True, exist_ok=True)
    entries = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    known = {(e["case"], e["field"], str(e["factor"])) for e in entries}
    with path.open("a", encoding="utf-8") as file, threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for job in jobs_of(arguments):
            for entry in tried(job, list(fields_of(arguments.only)), known, handling):
                entries.append(entry)
                file.write(json.dumps(entry) + "\n")
                file.flush()
    show(list({(e["case"], e["field"], e["factor"]): e for e in entries}.values()))


READS = Reads()

if __name__ == "__main__":
    main()
