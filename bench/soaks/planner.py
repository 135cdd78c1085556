"""A planner in a process of its own: asks at a steady rate, and writes down every question and its answer.

python -m soaks.planner '{"config": ..., "poses": ..., "file": ..., "seed": 0, "rate": 100, "until": ...}'
"""

from __future__ import annotations

import json
import os
import pickle
import sys
import time
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from gpcorrect_service import CorrectionClient, ServiceError
from soaks.records import Record, answer_of

TIMEOUT, PATH_TIMEOUT, CONNECT = 0.5, 1.0, 2.0  # s
LATE = 0.1  # s: a question that is due for longer is skipped
RECONNECT = 2000  # questions after which the clients are closed and opened again
KINDS = {"stream": 0.5, "pose": 0.4, "path": 0.05, "nonsense": 0.03, "health": 0.02}  # shares of the questions
ROWS = 20  # of a path
STEP = 0.02  # s between them
SPEED = 0.02  # m/s of a stream
OUTSIDE = 0.05  # share of poses that lie outside the training region
FAR = 0.1  # m that they are outside


class Planner:
    """Asks with two clients: one that is held to a model, and one that takes every answer.

    Parameters
    ----------
    given : dict, configuration, check queries to ask around, seed, rate (1/s), when to end (s, monotonic)
    file : binary file, takes the records
    """

    def __init__(self, given: dict[str, Any], file: BinaryIO) -> None:
        self._given, self._file = given, file
        self._rng = np.random.default_rng(given["seed"])
        self._places = np.array(given["poses"])  # (n, 13) poses and twists
        self._corners = np.vstack([self._places[:, :7], self._places[:1, :7]])
        ways = np.diff(self._corners[:, :3], axis=0)
        self._lengths = np.linalg.norm(ways, axis=1)
        self._ends = np.cumsum(self._lengths)
        self._twists = np.hstack([SPEED * ways / self._lengths[:, None], np.zeros_like(ways)])
        self._schedule = os.open("/proc/thread-self/schedstat", os.O_RDONLY)
        self._streams = count()
        self._clients: dict[bool, CorrectionClient] = {}

    def run(self) -> None:
        """Ask until the time is over, or the parent process gone."""
        rate, until, parent = self._given["rate"], self._given["until"], os.getppid()
        began, slot, asked = time.monotonic(), 0, 0
        kinds = self._rng.choice(list(KINDS), p=list(KINDS.values()), size=10_000)
        while (now := time.monotonic()) < until and os.getppid() == parent:
            due = began + slot / rate
            if now < due:
                time.sleep(due - now)
            elif now > due + LATE:
                behind = int((now - due) * rate)
                for _ in range(behind):
                    self._write(Record("skipped", now, now, 0.0, 0))
                slot += behind
            if asked % RECONNECT == 0:
                self._connect()
            self._ask(str(kinds[slot % len(kinds)]), slot / rate)
            slot, asked = slot + 1, asked + 1
        self._close()

    def _connect(self) -> None:
        self._close()
        for pin in (True, False):
            self._clients[pin] = CorrectionClient(
                config_file=Path(self._given["config"]),
                encoding=self._given["encoding"],
                timeout=TIMEOUT,
                path_timeout=PATH_TIMEOUT,
                connect_timeout=CONNECT,
                pin=pin,
            )
        self._stream, self._asked_before = next(self._streams), set[str]()

    def _close(self) -> None:
        for client in self._clients.values():
            client.close()

    def _ask(self, kind: str, at: float) -> None:
        """Ask one question of a kind, `at` seconds after the beginning."""
        client = self._clients[kind == "stream"]
        question = self._question(kind, at)
        allowed = PATH_TIMEOUT if kind == "path" else TIMEOUT
        key = {"nonsense": "pose"}.get(kind, kind)
        if key not in self._asked_before:  # the first question may wait for a server to appear
            allowed += CONNECT
            self._asked_before.add(key)
        code, reply = "", None
        starved, asked = self._starved(), time.monotonic()
        try:
            if kind == "health":
                client.health()
            else:
                reply = (client.correct_path if kind == "path" else client.correct)(*question)
        except ServiceError as error:
            code = error.status
        came = time.monotonic()
        record = Record(kind, asked, came, allowed, self._stream, question, code, starved=self._starved() - starved)
        if reply is not None:
            meta, answer = reply.meta, answer_of(reply.answer)
            record = record._replace(model_hash=meta.model_hash, replica=meta.replica, answer=answer)
        self._write(record)
        if code == "OTHER_MODEL":  # here the robot would come to rest
            client.change_model()
            self._stream = next(self._streams)

    def _starved(self) -> float:
        """Return for how long this thread has waited for a core since it began, s."""
        return int(os.pread(self._schedule, 64, 0).split()[1]) / 1e9

    def _question(self, kind: str, at: float) -> tuple[np.ndarray, ...]:
        rng, places = self._rng, self._places
        if kind == "health":
            return ()
        if kind == "path":
            times = STEP * np.arange(ROWS)
            return self._along(at + times)[0], times
        if kind == "stream":
            poses, twists = self._along(np.array([at]))
            return poses[0], twists[0]
        one, other = places[rng.integers(len(places), size=2)]
        pose = _between(one[:7], other[:7], rng.random())
        if kind == "nonsense":
            pose[:3] *= 1e3 if rng.random() < 0.5 else np.nan  # millimetres, or nothing
            return pose, other[7:]
        if rng.random() < OUTSIDE:
            pose[:3] += rng.choice([-FAR, FAR], size=3)
        return pose, other[7:]

    def _along(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return poses (n, 7) and twists (n, 6) on the way through the places, (n,) seconds after the beginning."""
        gone = (SPEED * at) % self._ends[-1]
        leg = np.searchsorted(self._ends, gone, side="right")
        share = 1.0 - (self._ends[leg] - gone) / self._lengths[leg]
        return _between(self._corners[leg], self._corners[leg + 1], share[:, None]), self._twists[leg]

    def _write(self, record: Record) -> None:
        pickle.dump(tuple(record), self._file, protocol=pickle.HIGHEST_PROTOCOL)


def _between(one: np.ndarray, other: np.ndarray, share: Any) -> np.ndarray:
    """Return poses (..., 7) on the straight way between two."""
    side = np.where((one[..., 3:] * other[..., 3:]).sum(axis=-1, keepdims=True) >= 0, 1.0, -1.0)
    pose = (1 - share) * one + share * other
    pose[..., 3:] = (1 - share) * one[..., 3:] + share * side * other[..., 3:]
    pose[..., 3:] /= np.linalg.norm(pose[..., 3:], axis=-1, keepdims=True)
    return pose


if __name__ == "__main__":
    told = json.loads(sys.argv[1])
    with Path(told["file"]).open("wb") as record_file:
        Planner(told, record_file).run()
