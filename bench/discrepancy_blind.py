"""How often does the discrepancy workflow name the right thing? The whole protocol, on recordings of another simulator.

    python bench/discrepancy_blind.py                     # 2400 cases: days on two cores
    python bench/discrepancy_blind.py --share 0.05        # a twentieth of every set
    python bench/discrepancy_blind.py --short             # minutes: 12 trajectories of 10 s, few cases
    python bench/discrepancy_blind.py --short --share 0.05
    python bench/discrepancy_blind.py --truth mujoco      # recordings of MuJoCo: 280 cases
    python bench/discrepancy_blind.py --truth both

Truth comes from bench/truth or, by MuJoCo, from bench/truth_mujoco; neither shares code with the simulator that the
workflow uses. Seeds of the first start at 930000: those from 900000 to 929999 were used, and what they showed was
mended. Seeds of the second start at 500000 for figures that are published, and 1 to 9999 are for development. Finished
cases are stored line by line in --results, so that a killed run goes on.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

from discrepancy_baselines import BASELINES
from discrepancy_cases import ADVISED, Job, outcome_of, solve
from discrepancy_jobs import NUMBERS, TRUTHS, jobs_of
from support import RESULTS, print_table

from gpcorrect.discrepancy.protocol.outcomes import CaseOutcome
from gpcorrect.discrepancy.protocol.score_reports import Proportion, Score, score_cases, score_text
from gpcorrect.discrepancy.settings import SETTINGS
from gpcorrect.parallel import each_as_done, workers


def run(jobs: list[Job], results: Path) -> list[dict[str, Any]]:
    """Solve what is not solved yet, each result written as soon as it is there."""
    results.parent.mkdir(parents=True, exist_ok=True)
    known = [json.loads(line) for line in results.read_text().splitlines()] if results.exists() else []
    done = {entry["key"]: entry for entry in known}
    left = [job for job in jobs if job.key not in done]
    started = time.monotonic()
    with results.open("a") as file:
        for number, entry in enumerate(each_as_done(solve, left), 1):
            done[entry["key"]] = entry
            file.write(json.dumps(entry) + "\n")
            file.flush()
            spent = time.monotonic() - started
            print(
                f"\r{number}/{len(left)} cases, {spent * (len(left) - number) / number / 60:.0f} min left  ",
                end="",
                flush=True,
            )
    print()
    return [done[job.key] for job in jobs]


def show(entries: list[dict[str, Any]]) -> Score:
    """Print the target table, the confusion matrix, detection limits, and the baselines beside the workflow."""
    outcomes = [outcome_of(e["outcome"]) for e in entries if e["outcome"] is not None]
    refused = [e for e in entries if "refused" in e]
    score = score_cases(outcomes)
    print(score_text(score))
    resolved_by_advice(entries)
    by_effect(outcomes)
    if refused:
        print(f"\n{len(refused)} cases were refused and count as undecided, for example: {refused[0]['refused']}")
    compare(entries)
    return score


def by_effect(outcomes: list[CaseOutcome]) -> None:
    """Print for every effect alone, and every cause outside the catalogue, what became of it."""
    rows = []
    for group, right in (("single", "exact"), ("outside", "UNKNOWN")):
        part = [o for o in outcomes if o.group == group]
        for name in sorted({o.truth[0] for o in part}):
            own = [o for o in part if o.truth[0] == name]
            hits = [
                [o.exact if group == "single" else o.unknown for o in own],
                [o.right_or_set for o in own],
                [o.wrong for o in own],
            ]
            rows.append(
                [f"{name} ({right})", str(len(own)), *(_percent(Proportion(sum(hit), len(own))) for hit in hits)]
            )
    if rows:
        print()
        print_table(["each cause alone", "n", "right (95 %)", "right or in a set", "a wrong name"], rows)


def resolved_by_advice(entries: list[dict[str, Any]]) -> None:
    """Print what became of the cases of the advised set."""
    cases = [e for e in entries if e["suite"] == ADVISED]
    if not cases:
        return
    ambiguous = [e for e in cases if "advice" in e]
    made = [e for e in ambiguous if e["outcome"] is not None]
    equivalent = sum(e["advice"]["expected_nats"] < SETTINGS.advice.enough for e in ambiguous)
    print(
        f"\nadvised set, {len(cases)} cases: {len(ambiguous)} ambiguous at first; of these {equivalent} are called "
        f"equivalent with these sensors, {len(made)} had an advised run that one model file can hold."
    )


def compare(entries: list[dict[str, Any]]) -> None:
    """Print workflow and baselines on the same cases: named exactly, and with a wrong name."""
    both = [e for e in entries if e.get("baselines")]
    rows = []
    for suite in dict.fromkeys(e["suite"] for e in both):
        part = [e for e in both if e["suite"] == suite]
        own = [outcome_of(e["outcome"]) for e in part]
        verdicts = {"workflow": [(o.exact, o.wrong) for o in own]}
        for name in BASELINES:
            verdicts[name] = [(e["baselines"][name]["exact"], e["baselines"][name]["wrong"]) for e in part]
        for name, pairs in verdicts.items():
            exact, wrong = (Proportion(sum(p[i] for p in pairs), len(pairs)) for i in (0, 1))
            rows.append([f"{suite}: {name}", str(len(pairs)), _percent(exact), _percent(wrong)])
    if rows:
        print()
        print_table(["the same cases", "n", "exact (95 %)", "a wrong name (95 %)"], rows)


def _percent(share: Proportion) -> str:
    low, high = share.interval
    return f"{100 * share.value:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="small cases; a few of every set unless --share says more")
    parser.add_argument("--share", type=float, help="of the protocol's numbers")
    parser.add_argument("--truth", choices=[*TRUTHS, "both"], default="numpy", help="which simulator records")
    suites = sorted({suite for numbers in NUMBERS.values() for suite in numbers})
    parser.add_argument("--suite", action="append", choices=suites, help="only this set; repeatable")
    parser.add_argument(
        "--least-ratio", type=float, default=0.0, help="only cases with nothing, or this much over the noise, hidden"
    )
    parser.add_argument("--first-seed", type=int, help="published figures: 930000 and up; of MuJoCo 500000 and up")
    parser.add_argument("--workers", type=int, default=-1, help="processes; all cores by default")
    parser.add_argument("--scheduler", help="address of a Dask scheduler whose workers have bench/ on PYTHONPATH")
    parser.add_argument("--baselines-every", type=int, default=1, help="baselines on every so-manieth case; 0: on none")
    parser.add_argument("--results", type=Path, default=None, help="file that finished cases are stored in")
    arguments = parser.parse_args()
    name = "discrepancy_blind_short" if arguments.short else "discrepancy_blind"
    results = arguments.results or RESULTS / f"{name}.jsonl"
    jobs = list(jobs_of(arguments))
    with workers(arguments.workers, arguments.scheduler):
        entries = run(jobs, results)
    scores = {}
    for name in dict.fromkeys(job.truth for job in jobs):
        print(f"\nrecordings of the {name} truth")
        scores[name] = show([e for e in entries if e.get("truth", "numpy") == name]).to_dict()
    results.with_suffix(".json").write_text(json.dumps(scores, indent=2))


if __name__ == "__main__":
    main()
