"""One estimate of a live stream of joints in process, every method, beside a 1000 Hz servo's millisecond.

The model is fitted to a simulated zig-zag; the stream is a simulated test run laid out at 1000 Hz. Blocks of all
methods take turns, so that whatever else the machine does falls on all.
"""

from __future__ import annotations

import time

import numpy as np
from support import print_table, save_results
from threadpoolctl import threadpool_limits

from gpcorrect.calibration import LEARNERS, FitSettings, JointCorrector, JointStream, fit_model
from gpcorrect.types import FloatArray
from gpcorrect_studies.peng2024 import RavenStudy

SEED = 31
BLOCKS = 20
SAMPLES = 1000  # a block: one second of a 1000 Hz servo loop


def main() -> None:
    study = RavenStudy(SEED)
    train, test = study.zigzags("J1-J2-J3", 4), study.random_run(1.0)
    fine = np.arange(test.time[0], test.time[-1], 1e-3)
    q, effort = (_finer(test.time, signal, fine) for signal in (test.measured_jp, test.measured_jf))
    streams = {
        method: fit_model(train, FitSettings(method=method, time_offset="none"), task=JointCorrector).corrector.stream()
        for method in LEARNERS
    }
    spent: dict[str, list[float]] = {method: [] for method in LEARNERS}
    with threadpool_limits(1):
        for block in range(BLOCKS + 1):
            rows = range(block * SAMPLES, (block + 1) * SAMPLES)
            for method, stream in streams.items():
                times = [_timed(stream, fine[i], q[i], effort[i]) for i in rows]
                spent[method] += times if block else []  # the first block warms up
    head = ["milliseconds a sample", "median", "p99", "p99.9", "most", "samples a second"]
    table: list[list[str | float]] = []
    for method, times in spent.items():
        quantiles = np.percentile(times, [50, 99, 99.9, 100])
        table.append([method, *quantiles.tolist(), 1e3 / float(np.mean(times))])
    print_table(head, table)
    save_results("joint_stream", {"head": head, "rows": table})


def _finer(time_s: FloatArray, signal: FloatArray, fine: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(fine, time_s, column) for column in signal.T])


def _timed(stream: JointStream, at: float, q: FloatArray, effort: FloatArray) -> float:
    start = time.perf_counter_ns()
    stream.correct(at, q, effort)
    return (time.perf_counter_ns() - start) / 1e6


if __name__ == "__main__":
    main()
