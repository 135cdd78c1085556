"""How fast a simulated arm lives on CRTK, and how long a pose spends in the pre-filter.

Run it: python bench/crtk_rates.py [--model model.gpc] [--seconds 5]. Rates depend on what else the machine does: the
script prints the load.
"""

from __future__ import annotations

import argparse
import json
import os
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gpcorrect.calibration import FitSettings, fit_corrector, load, save
from gpcorrect.cli.processes import free_endpoint
from gpcorrect.sim import debridement_log, machine_of, preset
from gpcorrect.sim.live_robot import LiveRobot
from gpcorrect_service.crtk import ArmServer, ArmServerSettings, Bus, BusSettings, OperatingState, Pose
from gpcorrect_service.crtk.prefilter import Prefilter
from gpcorrect_service.server.models import load_model

RATES = (100.0, 500.0, 1000.0)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path)
    options.add_argument("--seconds", type=float, default=5.0)
    given = options.parse_args()
    rows = [arm_rate(rate, given.seconds) for rate in RATES]
    with TemporaryDirectory() as folder:
        path = given.model or small_model(Path(folder) / "model.gpc")
        result = {"load": os.getloadavg()[0], "arm": rows, "prefilter": prefilter_times(path)}
    print(f"load average {result['load']:.1f}")
    print("asked Hz  received Hz  CPU of one core")
    for row in rows:
        print(f"{row['asked']:8.0f}  {row['received']:11.0f}  {100 * row['cpu']:14.0f} %")
    times = result["prefilter"]
    print(f"pre-filter, in process: median {times['median_ms']:.3f} ms, p99 {times['p99_ms']:.3f} ms a pose")
    Path("bench/results").mkdir(exist_ok=True)
    Path("bench/results/crtk_rates.json").write_text(json.dumps(result, indent=2))


def arm_rate(rate: float, seconds: float) -> dict[str, float]:
    """Let an arm live, and count what a listener in the same process hears of it."""
    robot = LiveRobot(
        machine_of(preset("raven2_debridement")), np.random.default_rng(0), block=max(1, int(1000 / rate))
    )
    robot.advance(0.01)
    endpoint, stop, heard = free_endpoint(), threading.Event(), []
    with Bus(BusSettings(endpoint, role="hub")) as hub, Bus(BusSettings(endpoint)) as listener:
        listener.subscribe("measured_js", lambda message: heard.append(time.monotonic()))
        server = ArmServer(robot, hub, ArmServerSettings(rate), time.time())
        thread = threading.Thread(target=server.run, args=(stop,))
        before = time.process_time()
        thread.start()
        time.sleep(seconds)
        stop.set()
        thread.join()
        cpu = (time.process_time() - before) / seconds
    return {"asked": rate, "received": (len(heard) - 1) / (heard[-1] - heard[0]), "cpu": cpu}


def prefilter_times(model: Path) -> dict[str, float]:
    """Correct a stream of 2000 poses around the middle of the training."""
    answering = Prefilter(load_model(model))
    pose, seconds = load(model).check_queries[0][:7], []
    for k in range(2000):
        stamp = 1.0 + 0.01 * k
        answering.robot_is(OperatingState(stamp, "ENABLED", True, False))
        moved = pose + np.array([0.002 * np.sin(0.05 * k), 0, 0, 0, 0, 0, 0])
        began = time.perf_counter()
        answering.servo(Pose(stamp, tuple(moved.tolist())))
        seconds.append(time.perf_counter() - began)
    median, high = np.percentile(seconds[100:], [50, 99])
    return {"median_ms": 1e3 * float(median), "p99_ms": 1e3 * float(high)}


def small_model(path: Path) -> Path:
    save(fit_corrector(debridement_log(3, reaches=25), FitSettings(inducing=200, marker="none")), path)
    return path


if __name__ == "__main__":
    main()
