"""Time of the simulator: the whole closed loop without effects and with each effect of the catalogue, on one thread.

24 trajectories of 20 s at 100 Hz, three joints of a RAVEN-II with masses, servo loop at 1000 Hz (48,000 samples,
480,000 servo steps a joint). Processor time, the best of several runs, compiled code loaded before. "start" is what a
new process pays for a short recording, once with an empty cache of compiled code and once with a full one.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from support import print_table, save_results

from gpcorrect.sim import Machine, Plan, machine_of, model_from_dict, run, simulate
from gpcorrect.sim.effects import Scope, candidates
from gpcorrect.sim.joint_motion import joint_motion_plan, joint_ranges

SHORT_RUN = """
from gpcorrect.sim import joint_motion_log, preset
joint_motion_log(preset("raven2_left"), 2, 1.0)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trajectories", type=int, default=24)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--no-start", action="store_true", help="leave the start of new processes out")
    options = parser.parse_args()
    model = model_from_dict({"arm": "raven2_left", "joints": [1, 2, 3], "payload": 0.1})
    machine, ranges = machine_of(model), joint_ranges(model)
    plan = joint_motion_plan(ranges, options.trajectories, options.seconds, 100.0, np.random.default_rng(0))
    scope = Scope((1, 2, 3), "RRP", ranges, 300.0)
    rows = _effect_rows(machine, plan, scope, options.repeats)
    print_table(["effect", "motion, s", "recording, s"], rows)
    starts = {} if options.no_start else _starts()
    for name, seconds in starts.items():
        print(f"start, {name}: {seconds:.1f} s")
    save_results("sim_speed", {"seconds": rows, "start": starts})


def _effect_rows(machine: Machine, plan: Plan, scope: Scope, repeats: int) -> list[list[Any]]:
    first = {c.kind.about.name: (c.typical(),) for c in reversed(tuple(candidates(scope)))}
    rows = []
    for name, effects in [("none", ()), *reversed(first.items())]:
        with_it = machine.with_effects(*effects)
        rows.append([name, _best(run, with_it, plan, repeats), _best(simulate, with_it, plan, repeats)])
    return rows


def _best(call: Callable[[Machine, Plan], Any], machine: Machine, plan: Plan, repeats: int) -> float:
    call(machine, plan)
    times = []
    for _ in range(repeats):
        before = time.process_time()
        call(machine, plan)
        times.append(time.process_time() - before)
    return min(times)


def _starts() -> dict[str, float]:
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        times = []
        for _ in range(2):
            before = time.perf_counter()
            subprocess.run([sys.executable, "-c", SHORT_RUN], env=environment, check=True)
            times.append(time.perf_counter() - before)
    return {"compiling": times[0], "compiled": times[1]}


if __name__ == "__main__":
    main()
