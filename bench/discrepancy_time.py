"""Time of `gpcorrect discrepancy run` by stage, page included, on one recording whose truth is another simulator's.

    python bench/discrepancy_time.py                          # 24 x 20 s, 3 joints, closed loop, coulomb friction
    python bench/discrepancy_time.py --hidden cable_stretch --hidden backlash
    python bench/discrepancy_time.py --real dvrk_random.csv   # six bare joints of a real arm

Wall time and processor time, compiled code loaded before (`--cold` leaves that out). `--report` keeps report.json, so
that two versions of the code can be compared: `--against` prints what differs from a stored one.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from support import print_table, real_data, save_results
from truth import Spec, make_case

from gpcorrect.discrepancy.outcome.result import DiscrepancyResult
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.logs import read_log
from gpcorrect.parallel import workers
from gpcorrect.report import write_discrepancy_report
from gpcorrect.sim import Model, model_from_dict
from gpcorrect.types import CalibrationLog, Progress

SEED = 3000  # development; published cases begin at 900000
SIX_JOINTS = {"arm": "joints", "joints": [1, 2, 3, 4, 5, 6], "joint_types": "RRPRRR"}
TARGET, OF_SIX = 20.0, 120.0  # s, of the standard case and of six joints, on two cores


@dataclass
class Clock(Progress):
    """Charges the time between two reports to the stage that the later one speaks of."""

    wall: dict[str, float] = field(default_factory=dict)
    processor: dict[str, float] = field(default_factory=dict)
    _last: tuple[float, float] = field(default_factory=lambda: (time.perf_counter(), time.process_time()))

    def step(self, stage: str, done: float) -> None:
        """Charge what has passed; a stage that begins has used nothing yet."""
        now = time.perf_counter(), time.process_time()
        name = stage if done > 0 else "between"
        self.wall[name] = self.wall.get(name, 0.0) + now[0] - self._last[0]
        self.processor[name] = self.processor.get(name, 0.0) + now[1] - self._last[1]
        self._last = now


def solve(log: CalibrationLog, model: Model, seed: int, clock: Progress, threads: int) -> DiscrepancyResult:
    """Do what the command does."""
    with workers(threads, threads=True):
        found = find_discrepancy(model, log, seed=seed, progress=clock)
    with tempfile.TemporaryDirectory() as folder:
        write_discrepancy_report(found, Path(folder) / "report.html")
    clock.step("page", 1.0)
    return found


def differences(a: Any, b: Any, tolerance: float, path: str = "") -> Iterator[str]:
    """Yield where two reports differ by more than a relative tolerance; what depends on the day is left out."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        for key in sorted({*a, *b} - {"seconds", "versions"}):
            yield from differences(a.get(key), b.get(key), tolerance, f"{path}/{key}")
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from differences(x, y, tolerance, f"{path}/{i}")
    elif isinstance(a, float) and isinstance(b, float):
        if abs(a - b) > tolerance * max(abs(a), abs(b), 1e-6):
            yield f"{path}: {a:.6g} -> {b:.6g}"
    elif a != b:
        yield f"{path}: {a} -> {b}"


def _case(options: argparse.Namespace) -> tuple[CalibrationLog, Model]:
    if options.real:
        return read_log(real_data(options.real)), model_from_dict(SIX_JOINTS)
    hidden = tuple(n for n in options.hidden or ["coulomb_friction"] if n != "nothing")
    spec = Spec("one", hidden, options.ratio, options.signals, trajectories=options.trajectories)
    case = make_case(spec, options.seed)
    return case.log, model_from_dict(case.nominal)


def _warm(options: argparse.Namespace) -> None:
    """Load compiled code: a short run of the same kind."""
    case = make_case(Spec("one", ("coulomb_friction",), 2.0, options.signals, trajectories=8, seconds=4.0), SEED)
    find_discrepancy(model_from_dict(case.nominal), case.log)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hidden", action="append", help="a cause of bench/truth, or nothing; repeatable")
    parser.add_argument("--ratio", type=float, default=1.0, help="of effect to noise")
    parser.add_argument("--signals", choices=["joints", "bare", "tracker"], default="joints")
    parser.add_argument("--trajectories", type=int, default=24)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--real", help="a real recording instead")
    parser.add_argument("--threads", type=int, default=-1, help="-1 for one a core, as the command has them")
    parser.add_argument("--cold", action="store_true", help="count the loading of compiled code")
    parser.add_argument("--report", type=Path, help="keep report.json here")
    parser.add_argument("--against", type=Path, help="print what differs from this report.json")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="relative, of --against")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    log, model = _case(options)
    if not options.cold:
        _warm(options)
    clock, load = Clock(), os.getloadavg()[0]
    found = solve(log, model, options.seed, clock, options.threads)
    report = json.loads(json.dumps(found.to_report()))
    _show(report, clock, load, OF_SIX if options.real else TARGET)
    if options.report:
        options.report.write_text(json.dumps(report, indent=1))
    if options.against:
        before = json.loads(options.against.read_text())
        print("\n".join(differences(before, report, options.tolerance)) or "the same report")


def _show(report: Mapping[str, Any], clock: Clock, load: float, target: float) -> None:
    rows = [[stage, clock.wall[stage], clock.processor[stage]] for stage in clock.wall]
    rows.append(["whole", sum(clock.wall.values()), sum(clock.processor.values())])
    print_table(["stage", "wall, s", "processor, s"], rows)
    print(f"target {target:g} s; {os.cpu_count()} cores, load {load:.1f} before")
    names = [f"{e['level']} {e['name']} {e['joint']}" for e in report["verdict"]["effects"]]
    print(report["verdict"]["level"], *names, sep="; ")
    save_results("discrepancy_time", {"seconds": rows, "load": load, "verdict": report["verdict"]["level"]})


if __name__ == "__main__":
    main()
