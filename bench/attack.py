"""An attack on the running system: every scenario with what is promised and what was seen, which must be zero.

`--only WORD` runs the scenarios with that word in their name or group; `--list` names them. Exit status 1 where
anything promised was broken.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

from attacks import GROUPS
from attacks.lab import Lab, Scenario, Seen
from support import print_load, print_table, save_results

HEAD = ("scenario", "must not happen", "promised", "seen", "of", "s", "of a processor")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path, help="model file of poses; a small one is fitted without it")
    options.add_argument("--only", default="", help="word in the name or group of a scenario")
    options.add_argument("--list", action="store_true", help="name the scenarios")
    given = options.parse_args()
    scenarios = ((group, s) for group in GROUPS for s in import_module(f"attacks.{group}").SCENARIOS)
    chosen = [(group, s) for group, s in scenarios if given.only in group or given.only in s.name]
    if given.list:
        print_table(("scenario", "group", "must not happen"), [[s.name, group, s.promised] for group, s in chosen])
        return
    rows, notes = [], []
    with tempfile.TemporaryDirectory() as folder:
        lab = Lab(Path(folder), given.model)
        for _, scenario in chosen:
            began, worked = time.monotonic(), _worked()
            seen = _tried(lab, scenario)
            seconds = f"{time.monotonic() - began:.0f}", f"{_worked() - worked:.0f}"
            rows.append([scenario.name, scenario.promised, "0", str(int(seen.broken)), str(seen.tried), *seconds])
            notes.append(f"{scenario.name}: {seen.note}")
            print(f"{'ok    ' if seen.tried and not seen.broken else 'BROKEN'} {notes[-1]}", flush=True)
    print()
    print_load()
    print_table(HEAD, rows)
    whole, busy = (sum(int(row[column]) for row in rows) / 60 for column in (-2, -1))
    print(f"\n{len(rows)} scenarios in {whole:.1f} minutes, {busy:.1f} of them a processor's")
    save_results("attack", {"rows": rows, "notes": notes})
    sys.exit(any(row[3] != "0" or row[4] == "0" for row in rows))


def _worked() -> float:
    """Seconds that processors worked for this process and those that it waited for."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def _tried(lab: Lab, scenario: Scenario) -> Seen:
    """Run a scenario; one that fails by itself is broken."""
    try:
        return scenario.run(lab)
    except Exception as error:  # noqa: BLE001  # whatever it is, the others are run
        return Seen(0, 1, f"did not come about: {type(error).__name__}: {error}")


if __name__ == "__main__":
    main()
