"""The position estimator in a paced loop of 1000 Hz, as Peng et al. 2020 run theirs: how long a sample takes.

    python bench/estimator_loop.py [--seconds 10] [--rate 1000]

Each method is fitted to a short simulated recording; how long a sample takes does not hang on how well it was fitted.
A tick is missed where the answer is not there before the next one, whatever held it up: run it on a machine that does
nothing else. The network is the paper's, 600-500-400.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from support import print_table, save_results
from threadpoolctl import threadpool_limits

from gpcorrect.calibration import FitSettings, PositionEstimator, RobotState, fit_model
from gpcorrect.sim import random_reaches_log
from gpcorrect.types import CalibrationLog

SEED, REACHES, EPOCHS = 31, 16, 3
LAYERS = (600, 500, 400)
METHODS = ("linear", "gp", "network")


def states(log: CalibrationLog) -> list[RobotState]:
    """Return the recording sample by sample."""
    joints: Any = [
        [None] * len(log) if signal is None else signal
        for signal in (log.setpoint_jp, log.measured_jv, log.measured_jf)
    ]
    here, there = log.measured_cp, log.setpoint_cp
    turns: Any = [[None] * len(log) if s.quaternion is None else s.quaternion for s in (here, there)]
    columns = (log.measured_jp, here.position, turns[0], *joints, there.position, turns[1])
    return [RobotState(float(t), *row) for t, *row in zip(log.time, *columns, strict=True)]


def paced(stream: Any, samples: Sequence[RobotState], seconds: float, rate: float) -> tuple[list[float], int]:
    """Answer a sample a tick; return the times of the answers, ms, and how many came after the next tick."""
    spent, late, period = [], 0, 1.0 / rate
    tick = time.perf_counter()
    for i in range(round(seconds * rate)):
        sample = samples[i % len(samples)]
        while (left := tick - time.perf_counter()) > 0:
            if left > 2e-4:  # sleep wakes up late by about as much
                time.sleep(left - 2e-4)
        begun = time.perf_counter()
        if i % len(samples) == 0:
            stream.reset()
        stream.correct(sample)
        done = time.perf_counter()
        spent.append(1e3 * (done - begun))
        tick += period
        if done > tick:
            late += 1
            tick = done
    return spent, late


def main() -> None:
    """Print a row a method."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    asked = parser.parse_args()
    log = random_reaches_log("raven2_left", REACHES, SEED, faults=False)
    samples, table = states(log), []
    with threadpool_limits(1):
        for method in METHODS:
            settings = FitSettings(method=method, layers=LAYERS, epochs=EPOCHS, inducing=100, seed=SEED)
            stream = fit_model(log, settings, task=PositionEstimator).corrector.stream()
            spent, late = paced(stream, samples, asked.seconds, asked.rate)
            load = 0.1 * sum(spent) / asked.seconds
            quantiles = np.percentile(spent, [50, 99, 99.9, 100]).tolist()
            table.append([method, *quantiles, 100.0 * late / len(spent), load])
    head = [f"at {asked.rate:g} Hz, ms a sample", "median", "p99", "p99.9", "most", "ticks missed %", "of one core %"]
    print_table(head, table)
    save_results("estimator_loop", {"head": head, "rows": table})


if __name__ == "__main__":
    main()
