"""Write a simulated debridement recording as ROS 2 bags (MCAP): something to try the bag reader with.

Run it: python examples/make_bag.py bags [--reaches 40]; then, for example: gpcorrect fit bags/* --output model.gpc
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from gpcorrect.sim import debridement_log
from gpcorrect.types import CalibrationLog, PoseSignal
from gpcorrect_service.crtk import JointState, Pose
from gpcorrect_service.crtk.recorder import Came, Recording, write_mcap

EPOCH = 1.8e9  # s since 1970 at the recording's start


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("folder", type=Path, help="where the bags go: run_0, run_1, ...")
    options.add_argument("--bags", type=int, default=8)
    options.add_argument("--reaches", type=int, default=40)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    log = debridement_log(given.seed, reaches=given.reaches)
    given.folder.mkdir(parents=True)
    for k, numbers in enumerate(np.array_split(log.trajectory_ids, given.bags)):
        write_mcap(recording_of(log.select(np.isin(log.trajectory, numbers))), given.folder / f"run_{k}")
    print(f"{len(log)} samples of a simulated RAVEN-II in {given.bags} bags -> {given.folder}")


def recording_of(log: CalibrationLog) -> Recording:
    """Return a log's joints and poses as the messages of an arm; where the tracker saw nothing it sent nothing."""
    stamps = EPOCH + log.time
    assert log.measured_jp is not None
    assert log.setpoint_jp is not None
    messages = {
        "measured_js": joints(stamps, log.measured_jp),
        "setpoint_js": joints(stamps, log.setpoint_jp),
        "setpoint_cp": poses(stamps, log.setpoint_cp, "base"),
        "measured_cp": poses(stamps, log.measured_cp, "base"),
        "tracker_cp": poses(stamps, log.tracker_cp, "tracker"),
    }
    return Recording("arm1", {name: tuple(Came(0, m) for m in sent) for name, sent in messages.items()}, ())


def joints(stamps: np.ndarray, q: np.ndarray) -> tuple[JointState, ...]:
    return tuple(JointState(t, tuple(row)) for t, row in zip(stamps.tolist(), q.tolist(), strict=True))


def poses(stamps: np.ndarray, signal: PoseSignal | None, frame: str) -> tuple[Pose, ...]:
    assert signal is not None
    assert signal.quaternion is not None
    numbers = np.hstack([signal.position, signal.quaternion])
    seen = np.isfinite(numbers).all(axis=1)
    return tuple(
        Pose(t, tuple(row), frame) for t, row in zip(stamps[seen].tolist(), numbers[seen].tolist(), strict=True)
    )


if __name__ == "__main__":
    main()
