"""Cases of the blind protocol one by one: what was hidden, what the workflow names, in one line each.

    python bench/discrepancy_one.py --truth mujoco --short one:17          # one case by its set and seed
    python bench/discrepancy_one.py --truth mujoco --short null:1-20 one:1-40 --append table.txt
    python bench/discrepancy_one.py --truth mujoco --short one:17 --write case/   # its files, labels beside them

For development: it shows the labels. Lines that --append finds in its file are not made again.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from discrepancy_cases import Job, case_of, solve
from discrepancy_jobs import FIRST_SEED, TRUTHS, truth_named, write_files

WIDTHS = (10, 6, 12, 8, 8, 48, 15, 8)
HEAD = (
    "set",
    "seed",
    "arm",
    "sensors",
    "size",
    "hidden",
    "verdict",
    "seconds",
    "named (level, probability, differs between motions, closes) | acts like | how it is scored",
)


def jobs_of(arguments: argparse.Namespace) -> Iterator[Job]:
    """Yield the cases of `set:seed` and `set:first-last`, none of them of a published run."""
    module = truth_named(arguments.truth)
    for text in arguments.cases:
        suite, _, seeds = text.partition(":")
        first, _, last = seeds.partition("-")
        if int(last or first) >= FIRST_SEED[arguments.truth]:
            raise SystemExit(f"seeds from {FIRST_SEED[arguments.truth]} are for the blind run")
        for spec, seed in module.specs(suite, int(last or first) - int(first) + 1, int(first)):
            yield Job(module.short(spec) if arguments.short else spec, seed, baselines=False)


def line_of(job: Job, labels: dict[str, Any], entry: dict[str, Any], seconds: float) -> str:
    """Return one line: the case, what was hidden, what was said."""
    hidden = ", ".join(f"{e['name']} {e['joint']} ({e['ratio']:.2f})" for e in labels["effects"]) or "nothing"
    outcome, refused = entry["outcome"], {"level": "REFUSED", "effects": [entry.get("refused", "")], "alike": []}
    said = entry.get("said", refused)
    scored = "WRONG" if outcome["wrong"] else " + ".join(outcome["answers"])
    named = "; ".join(said["effects"]) or "-"
    like = "; ".join(said["alike"]) or "-"
    spec = job.spec
    cells = (
        spec.suite, str(job.seed), getattr(spec, "arm", "raven2_left"), spec.signals,
        f"{spec.ratio:g}" if spec.hidden else "-", hidden, said["level"], f"{seconds:.0f}",
    )  # fmt: skip
    return " ".join(c.ljust(w) for c, w in zip(cells, WIDTHS, strict=True)) + f" {named} | {like} | {scored}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="+", help="set:seed or set:first-last")
    parser.add_argument("--truth", choices=TRUTHS, default="mujoco")
    parser.add_argument("--short", action="store_true", help="12 trajectories of 10 s")
    parser.add_argument("--append", type=Path, help="file that the lines are added to")
    parser.add_argument("--write", type=Path, help="only write log, model and labels into this folder")
    arguments = parser.parse_args()
    known = arguments.append.read_text().splitlines() if arguments.append and arguments.append.exists() else []
    done = {tuple(line.split()[:2]) for line in known}
    print(" ".join(h.ljust(w) for h, w in zip(HEAD, (*WIDTHS, 0), strict=True)))
    for job in jobs_of(arguments):
        if (job.spec.suite, str(job.seed)) in done:
            continue
        case = case_of(job)
        if arguments.write:
            write_files(job, case, arguments.write / job.key)
            continue
        begun = time.process_time()
        entry = solve(job, case)
        line = line_of(job, dict(case.labels), entry, time.process_time() - begun)
        print(line, flush=True)
        if arguments.append:
            with arguments.append.open("a", encoding="utf-8") as file:
                file.write(line + os.linesep)


if __name__ == "__main__":
    main()
