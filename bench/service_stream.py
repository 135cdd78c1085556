"""The live stream of joints at 1000 Hz: samples in, estimates out, how many and how late, from a joint model on disk.

Without --model a Gaussian process is fitted to a simulated RAVEN-II, efforts included. In process the same samples show
what the model alone takes.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
import zenoh
from service_bench import LATENCIES, PATIENT, free_endpoint, latencies, process, serve_joints, summary
from support import print_load, print_table, save_results

from gpcorrect.calibration import FitSettings, JointCorrector, JointStream, fit_model, load, save
from gpcorrect.types import FloatArray
from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings
from gpcorrect_service.protocol.answer import EstimateAnswer
from gpcorrect_service.protocol.messages import MSGPACK, JointState
from gpcorrect_service.protocol.sessions import open_client

RATE = 1000.0


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--model", type=Path, help="joint model file")
    options.add_argument("--seconds", type=float, default=60.0)
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        model = given.model or fitted(Path(folder) / "joints.gpc")
        corrector = load(model, JointCorrector)
        q, effort = swing(corrector, round(RATE * given.seconds))
        results = {"model alone, no network": summary(alone(corrector, q, effort))}
        endpoint = free_endpoint()
        with process(serve_joints, str(model), ServerSettings(endpoint=endpoint)):
            late, lost = streamed(endpoint, q, effort)
            with CorrectionClient(endpoint, timeout=PATIENT, connect_timeout=PATIENT) as client:
                counts = client.health().counts.get("estimate", {})
        results[f"stream at {RATE:g} Hz"] = summary(late)
    print_load()
    rows = [[name, *latencies(row), row["max_ms"]] for name, row in results.items()]
    print_table(("", *LATENCIES, "max ms"), rows)
    print(f"\n{len(q)} samples in, {len(late)} estimates out, {lost} lost; the server says {counts}")
    save_results("service_stream", {**results, "sent": len(q), "lost": lost})


def fitted(path: Path) -> Path:
    from gpcorrect.sim import joint_motion_log, preset

    print("fitting joints of a simulated RAVEN-II ...")
    log = joint_motion_log(preset("raven2_calibration"), trajectories=6)
    save(fit_model(log, FitSettings(inducing=200), task=JointCorrector).corrector, path)
    return path


def swing(corrector: JointCorrector, n: int) -> tuple[FloatArray, FloatArray]:
    """Joints `(n, d)` that swing through half of the training range at their own rates, and efforts of nothing."""
    features = corrector.view.features
    t = np.arange(n) / RATE
    rates = 0.3 + 0.1 * np.arange(len(features.half))
    q: FloatArray = features.centre + 0.5 * features.half * np.sin(2 * np.pi * rates * t[:, None])
    return q, np.zeros(q.shape)


def alone(corrector: JointCorrector, q: FloatArray, effort: FloatArray) -> list[float]:
    stream, seconds = JointStream(corrector), []
    for i in range(min(len(q), 3000)):
        began = time.perf_counter()
        stream.correct(1.0 + i / RATE, q[i], effort[i])
        seconds.append(time.perf_counter() - began)
    return seconds[300:]


def streamed(endpoint: str, q: FloatArray, effort: FloatArray) -> tuple[list[float], int]:
    """Seconds from each sample's due time to its estimate, and how many never came."""
    heard: SimpleQueue[tuple[float, zenoh.Sample]] = SimpleQueue()
    with open_client(ClientSettings((endpoint,), connect_timeout=PATIENT)) as session:
        callback = zenoh.handlers.Callback(lambda s: heard.put((time.perf_counter(), s)), indirect=False)
        publisher = session.declare_publisher("arm1/measured_js")
        with session.declare_subscriber("arm1/estimate", callback), publisher:
            while not publisher.matching_status.matching:
                time.sleep(0.01)
            time.sleep(0.5)
            due = send(publisher, q, effort)
            arrived = collect(heard, len(q))
    late = [arrived[stamp] - when for stamp, when in due.items() if stamp in arrived]
    return late, len(due) - len(late)


def send(publisher: Any, q: FloatArray, effort: FloatArray) -> dict[float, float]:
    due, began = {}, time.perf_counter()
    encoding = MSGPACK.encoding("joint_state")
    for i, (row, force) in enumerate(zip(q.tolist(), effort.tolist(), strict=True)):
        when, stamp = began + i / RATE, 1.0 + i / RATE
        while (now := time.perf_counter()) < when:
            time.sleep(when - now)
        publisher.put(MSGPACK.encode(JointState(stamp, tuple(row), effort=tuple(force))), encoding=encoding)
        due[stamp] = when
    return due


def collect(heard: SimpleQueue[tuple[float, zenoh.Sample]], count: int) -> dict[float, float]:
    arrived: dict[float, float] = {}
    while len(arrived) < count:
        try:
            when, sample = heard.get(timeout=2.0)
        except Empty:
            break
        arrived[MSGPACK.decode(EstimateAnswer, sample.payload.to_bytes()).stamp] = when
    return arrived


if __name__ == "__main__":
    main()
