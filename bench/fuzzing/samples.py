"""Foreign samples on the stream of joints: refused or answered, and a session after them is answered as any other."""

from __future__ import annotations

import sys
from collections import Counter
from random import Random
from typing import Any

import msgspec
import numpy as np
from attacks.lab import Lab

from fuzzing.bodies import anything, number
from fuzzing.mutations import flipped
from gpcorrect_service import ServerSettings
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.ops.metrics import Counters
from gpcorrect_service.protocol.messages import CODECS, MSGPACK
from gpcorrect_service.server.estimator import Estimator
from gpcorrect_service.server.models import Active, JointModel, load_joint_model
from gpcorrect_service.server.requests import Clock, Request, RequestParser

STEP = 0.01  # s between samples
FOREIGN, GOOD = 500, 20  # samples in turn


def foreign_samples(lab: Lab, count: int) -> Counter[str]:
    """Send `count` samples with something wrong; count what came of them, and good ones that got another estimate."""
    draw, rng = Random(4), np.random.default_rng(4)
    arm, counts = _Arm(load_joint_model(lab.joint_model)), Counter[str]()
    for k in range(count):
        counts[arm.ask(*_wrong(draw, rng, arm.sample()))] += 1
        if k % FOREIGN == FOREIGN - 1:
            counts["otherwise"] += not arm.recovers()
    return +counts


class _Arm:
    """An estimator, and the joints of an arm that moves."""

    def __init__(self, model: JointModel) -> None:
        self._model, self._now, self._session = model, 100.0, 0
        self._phases = np.arange(len(model.corrector.types))
        self._counters = Counters()
        self._estimator = self._fresh(self._counters)

    def _fresh(self, counters: Counters) -> Estimator:
        logger = open_logger(sys.stderr)
        active, clock = Active(None, self._model), Clock(lambda: self._now)
        return Estimator(RequestParser(active, ServerSettings(), logger, clock), counters)

    def sample(self) -> dict[str, Any]:
        """Return the next good one."""
        self._now += STEP
        q = 0.1 + 0.05 * np.sin(self._now + self._phases)
        return {"stamp": self._now, "position": q.tolist(), "effort": (0.0 * q).tolist(), "session": self._session}

    def ask(self, payload: bytes, encoding: str) -> str:
        """Return the status of an estimate, or of its refusal."""
        before = self._counters.counts().get("estimate", {})
        self._estimator.estimate(Request(payload, encoding, b"", self._now))
        after = self._counters.counts()["estimate"]
        return next(status for status, number in after.items() if number > before.get(status, 0))

    def recovers(self) -> bool:
        """Whether a new session is answered in the end as by an estimator that heard nothing else."""
        fresh = self._fresh(Counters())
        self._session += 1
        for _ in range(GOOD):
            sample = Request(MSGPACK.encode(self.sample()), MSGPACK.encoding("joint_state"), b"", self._now)
            one, other = self._estimator.estimate(sample), fresh.estimate(sample)
        return one is not None and one == other


def _wrong(draw: Random, rng: np.random.Generator, sample: dict[str, Any]) -> tuple[bytes, str]:
    codec = draw.choice(list(CODECS.values()))
    way, name = draw.randrange(5), draw.choice(list(sample))
    if way == 0:
        sample[name] = anything(draw)
    elif way == 1:
        del sample[name]
    elif way == 2 and isinstance(sample[name], list):
        sample[name][draw.randrange(len(sample[name]))] = number(draw)
    elif way == 2:
        sample[name] = number(draw)
    elif way == 3:
        sample["stamp"] += draw.choice([-1e9, -2.0, -1.0, -0.5, -0.1, 0.1, 1.0, 2.0, 1e3, 1e9, 1e18])
    try:
        payload = codec.encode(sample)
    except (OverflowError, msgspec.MsgspecError):  # what cannot be written
        payload = rng.bytes(rng.integers(100))
    return flipped(rng, payload) if way == 4 else payload, codec.media_type
