"""What several tests share: real recordings, a small recording with a known miss, and what is made once a run."""

from __future__ import annotations

import fcntl
import json
import os
import pickle
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest

from gpcorrect import gpr, se3
from gpcorrect.calibration.learners import trees
from gpcorrect.calibration.model_file import seal_of
from gpcorrect.types import CalibrationLog, PoseSignal

T = TypeVar("T")
ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Once:
    """Makes files and values once a run, in a folder that all worker processes share."""

    folder: Path

    def file(self, name: str, write: Callable[[Path], object]) -> Path:
        """Return the file of a name, written by the first process that asks; the others wait for it."""
        path = self.folder / name
        with (self.folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not path.exists():
                unfinished = path.with_name(f"unfinished-{name}")
                write(unfinished)
                unfinished.rename(path)
        return path

    def value(self, name: str, make: Callable[[], T]) -> T:
        """Return the value of a name, made by the first process that asks, as it was when made."""
        path = self.file(f"{name}.pickle", lambda path: path.write_bytes(pickle.dumps(make())))
        value: T = pickle.loads(path.read_bytes())  # noqa: S301  # this run wrote it
        return value


@dataclass(frozen=True)
class Fitted:
    """A recording, the model file that `gpcorrect fit` wrote, and its JSON; no test may write to the files."""

    folder: Path

    @property
    def log(self) -> Path:
        return self.folder / "log.csv"

    @property
    def model(self) -> Path:
        return self.folder / "model.gpc"

    @property
    def json(self) -> Any:
        return json.loads((self.folder / "fit.json").read_text())


def sealed_file(path: Path, header: dict[str, Any], arrays: Mapping[str, np.ndarray]) -> Path:
    """Write a model file of these parts under a fresh seal."""
    sealed = json.dumps({**header, "seal": seal_of(header)}, sort_keys=True)
    with path.open("wb") as file:
        np.savez(file, header=np.frombuffer(sealed.encode(), dtype=np.uint8), **arrays)
    return path


def real_data(name: str) -> Path:
    """Return a real recording of $GPCORRECT_DATA, or `shared/data` beside the checkout; skip the test without one."""
    path = Path(os.environ.get("GPCORRECT_DATA", ROOT.parent / "shared" / "data")) / name
    if not path.exists():
        pytest.skip(f"real recording {name} is not at hand: set GPCORRECT_DATA to the folder that holds it")
    return path


@contextmanager
def short_search(samples: int = 150) -> Iterator[None]:
    """Learn hyperparameters from so many samples (usually 500): their search takes most of a fit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gpr, "SparseGPR", partial(gpr.SparseGPR, n_learn=samples))
        yield


@contextmanager
def few_trees(rounds: int = 40) -> Iterator[None]:
    """Grow so many trees a target (usually 200): what they cost is their number."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trees, "ROUNDS", rounds)
        yield


def small_log(seed: int = 0, trajectories: int = 16, samples: int = 60, *, noise: float = 1e-4) -> CalibrationLog:
    """Return a small recording with a known miss: shifted, turned, bent smoothly, and dragged by velocity."""
    rng = np.random.default_rng(seed)
    time, number, position, rotvec = [], [], [], []
    for k in range(trajectories):
        t = np.arange(samples) * 0.02
        phase, rate = rng.uniform(0, 2 * np.pi, (6, 1)), np.array([[2.0], [1.5], [2.5], [1.0], [2.2], [1.8]])
        swing = np.sin(rate * t + phase).T
        time.append(t + 10.0 * k)
        number.append(np.full(samples, k))
        position.append(0.03 * swing[:, :3] + np.array([0.1, 0.0, -0.1]))
        rotvec.append(0.4 * swing[:, 3:])
    p, r = np.concatenate(position), np.concatenate(rotvec)
    velocity = np.concatenate([np.gradient(p[k == np.concatenate(number)], 0.02, axis=0) for k in range(trajectories)])
    seen = p + 0.004 * np.sin(20 * p[:, [1, 2, 0]]) - 0.01 * velocity + np.array([0.01, -0.005, 0.002])
    R = se3.matrix_from_rotvec(0.05 * np.sin(10 * p)) @ se3.matrix_from_rotvec(r)
    return CalibrationLog(
        time=np.concatenate(time),
        trajectory=np.concatenate(number),
        session=np.zeros(len(p)),
        setpoint_cp=PoseSignal(p, se3.quaternion_from_matrix(se3.matrix_from_rotvec(r))),
        tracker_cp=PoseSignal(seen + noise * rng.standard_normal(p.shape), se3.quaternion_from_matrix(R)),
        name="small",
    )
