"""A site under traffic and faults for long: what is wrong, stale or mixed, what is lost, and what grows.

Replicas with one store behind a router, planners in processes of their own, and every `--every` seconds a fault drawn
from the whole list (`--faults WORD ...` takes those with a word in their name, `--faults none` none at all). Every
answer is computed again afterwards from the model file that it names; its age is the planner's own monotonic clock's;
a client that is held to a model must not see another one unless it was told. Exit status 1 where one of these is
broken, or a replica did not come back after all. Growth is what the last third of the run has over the second third,
of every process that lived throughout: the first third warms up allocators and caches.

    python bench/soak.py --minutes 30 --rate 500 --seed 1
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from attacks.lab import Lab
from soaks.answers import Tally, checked
from soaks.faults import FAULTS, impossible
from soaks.site import Site, seconds_until_seen, site
from support import print_load, print_table, save_results

SETTLED = 5.0  # s of traffic before the first fault
RETURN = 60.0  # s after the last fault in which every replica must be there: a busy machine starts one in twenty
SAMPLE_SECONDS = 1.0
HEAD = (
    "during",
    "times",
    "asked",
    "answered",
    "not OK",
    "lost",
    "skipped",
    "refused",
    "back s",
    "wrong",
    "stale",
    "mixed",
)
GROWTH = ("process", "what", "second third", "last third", "growth %")


class Span(NamedTuple):
    """A fault: when it began (s, monotonic), its name, and after how long all replicas were seen again, s."""

    began: float
    name: str
    back: float


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--models", type=Path, nargs=2, help="two model files of one arm; small ones are fitted else")
    options.add_argument("--minutes", type=float, default=30.0)
    options.add_argument("--rate", type=float, default=500.0, help="questions a second in all")
    options.add_argument("--every", type=float, default=20.0, help="seconds from fault to fault")
    options.add_argument("--replicas", type=int, default=2)
    options.add_argument("--planners", type=int, default=5)
    options.add_argument("--faults", nargs="+", default=[""], help="words in the names of faults; none for none")
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args()
    missing = impossible()
    faults = [name for name in FAULTS if any(word in name for word in given.faults) and name not in missing]
    for name, reason in missing.items():
        print(f"skipped: {name}: {reason}")
    with tempfile.TemporaryDirectory(prefix="soak") as folder:
        lab = Lab(Path(folder))
        models = given.models or (lab.model, lab.other_model)
        place_folder = Path(folder) / "site"
        place_folder.mkdir()
        with site(place_folder, models) as place:
            place.add_replicas(given.replicas)
            began = time.monotonic()
            until = began + 60.0 * given.minutes
            files = place.add_planners(given.planners, given.rate, until, given.seed)
            samples: dict[str, list[dict[str, float]]] = defaultdict(list)
            spans = soak(place, faults, given, until, samples)
            for planner in place.planners:
                if planner.process.wait(60.0):
                    raise RuntimeError(f"a planner ended: {planner.log}")
        print("computing every answer again ...", flush=True)
        tallies = checked(files, models, [span.began for span in spans])
    sys.exit(shown(spans, tallies, grown(samples), given))


def soak(
    place: Site, faults: list[str], given: Any, until: float, samples: dict[str, list[dict[str, float]]]
) -> list[Span]:
    """Let faults befall the site until the time is over, and look at its processes meanwhile."""
    rng = np.random.default_rng(given.seed)
    spans = [Span(time.monotonic(), "before", 0.0)]
    drawn: list[str] = []
    due = time.monotonic() + SETTLED
    while time.monotonic() < until:
        look(place, samples)
        if not faults or time.monotonic() < due or due + given.every > until:
            time.sleep(SAMPLE_SECONDS)
            continue
        drawn = drawn or list(rng.permutation(faults))
        name, began = drawn.pop(), time.monotonic()
        happened = FAULTS[name](place, rng)
        due += given.every
        back = seconds_until_seen(place, given.replicas, due - time.monotonic())
        spans.append(Span(began, name, back))
        print(f"{until - began:7.0f} s left: {name}: {happened}; all there {_after(back)}", flush=True)
    if not np.isfinite(seconds_until_seen(place, given.replicas, RETURN)):
        print("BROKEN: a replica did not come back:", *(replica.log[-1000:] for replica in place.replicas), sep="\n")
        spans.append(Span(time.monotonic(), "end", np.inf))
    return spans


def shown(spans: Sequence[Span], tallies: Sequence[Tally], growth: list[list[Any]], given: Any) -> bool:
    """Print what was promised and seen, by fault; return whether anything was broken."""
    by_fault: dict[str, list[tuple[Span, Tally]]] = defaultdict(list)
    for span, tally in zip(spans, tallies, strict=True):
        by_fault[span.name].append((span, tally))
        by_fault["all"].append((span, tally))
    rows = [_row(name, by_fault[name]) for name in ["before", *FAULTS, "end", "all"] if name in by_fault]
    promised = ["promised", *[""] * (len(HEAD) - 4), "0", "0", "0"]
    print()
    print_load()
    print_table(HEAD, [promised, *rows])
    print()
    print_table(GROWTH, growth)
    examples = [example for tally in tallies for example in tally.examples]
    for example in examples[:20]:
        print(example)
    save_results(
        "soak", {"given": vars(given), "spans": spans, "rows": rows, "growth": growth, "examples": examples[:1000]}
    )
    return any(tally.broken for tally in tallies) or spans[-1].name == "end"


def _row(name: str, parts: list[tuple[Span, Tally]]) -> list[str]:
    def total(what: str) -> str:
        return str(sum(tally.counts[what] for _, tally in parts))

    refused = sum((tally.refused for _, tally in parts), start=type(parts[0][1].refused)())
    said = ", ".join(f"{number} {status}" for status, number in refused.most_common())
    back = _after(max(span.back for span, _ in parts))
    first = [name, str(len(parts)), *(total(what) for what in ("asked", "answered", "not OK", "lost", "skipped"))]
    return [*first, said, back, *(total(what) for what in ("wrong", "stale", "mixed"))]


def _after(seconds: float) -> str:
    return f"after {seconds:.1f} s" if np.isfinite(seconds) else "in a later span"


def look(place: Site, samples: dict[str, list[dict[str, float]]]) -> None:
    """Note the state of every process; one that was started anew begins anew."""
    named = {"router": [place.router], "replica": place.replicas, "planner": place.planners}
    for name, programs in named.items():
        for i, program in enumerate(programs):
            if (state := state_of(program.pid)) is not None:
                samples[f"{name} {i} ({program.pid})"].append({"at": time.monotonic(), **state})


def state_of(pid: int) -> dict[str, float] | None:
    """Resident memory (MB), threads and open files of a process; None when it is gone."""
    try:
        fields = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
        return {
            "memory_mb": float(fields["VmRSS"].split()[0]) / 1024,
            "threads": float(fields["Threads"]),
            "open_files": float(len(os.listdir(f"/proc/{pid}/fd"))),
        }
    except (OSError, KeyError):
        return None


def grown(samples: dict[str, list[dict[str, float]]]) -> list[list[Any]]:
    """Compare the last two thirds of what was seen of every process that lived throughout."""
    rows = []
    longest = max(map(len, samples.values()))
    for process, states in samples.items():
        if len(states) < 0.95 * longest or longest < 9:
            continue
        third = len(states) // 3
        for name in ("memory_mb", "threads", "open_files"):
            middle, last = (
                float(np.median([s[name] for s in part])) for part in (states[third : 2 * third], states[2 * third :])
            )
            rows.append([process, name, middle, last, 100.0 * (last / middle - 1)])
    return rows


if __name__ == "__main__":
    main()
