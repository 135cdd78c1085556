"""Foreign bytes against every key: each is to be answered with one of the service's own words, and the server to live.

Requests that are nearly right, random, cut and flipped ones, and samples of the stream, for the handlers in process,
where a million pass in minutes; and mangled ones for a real server over zenoh.
"""

from __future__ import annotations

import resource
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np
import zenoh
from attacks.lab import Lab
from msgspec import structs
from service_bench import PATIENT, free_endpoint, process, serve_model, typical_query

from fuzzing.bodies import nearly_right
from fuzzing.samples import foreign_samples
from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.protocol.messages import (
    CODECS,
    JSON,
    MSGPACK,
    CorrectJointsRequest,
    CorrectPathRequest,
    CorrectRequest,
    ErrorAnswer,
    Kind,
    error_codec,
)
from gpcorrect_service.protocol.ros import CDR_ENCODING, StampedPose, write_pose
from gpcorrect_service.protocol.sessions import open_client
from gpcorrect_service.server.handlers import Corrections
from gpcorrect_service.server.models import Active, load_joint_model, load_model
from gpcorrect_service.server.requests import Clock, Handler, Request, RequestParser

OVER_ZENOH = 0.02  # share of the payloads that a real server gets
KINDS: tuple[Kind, ...] = ("correct", "correct_path", "correct_joints", "admin/activate", "admin/state")
MOST_SECONDS = 1.0  # of processor time for one answer
LAWFUL = {"OK", "EXTRAPOLATING", "LIMITED", "BAD_INPUT", "NO_MODEL", "BUSY", "STALE", "MISSING"}


def fuzz_payloads(count: int, model: Path | None = None) -> dict[str, Any]:
    """Ask every handler, and a real server, with `count` payloads; return what came, and print it."""
    results = {}
    with TemporaryDirectory() as folder:
        lab = Lab(Path(folder), model)
        handlers, nearly = answerers(lab), round(count / 4)
        for name, statuses, payloads in (
            ("nearly right", lambda n: asked(handlers, nearly_right_payloads(lab), n), nearly),
            ("random, cut and flipped", lambda n: asked(handlers, mangled_payloads(lab), n), count - 2 * nearly),
            ("samples of joints", lambda n: foreign_samples(lab, n), nearly),
            ("over zenoh", lambda n: over_zenoh(lab.model, n), round(count * OVER_ZENOH)),
        ):
            results[name] = dict(statuses(payloads))
            print(f"{name}: {payloads} payloads: {results[name]}; {resident_mb():.0f} MB at most", flush=True)
    unlawful = sum(n for counts in results.values() for status, n in counts.items() if status not in LAWFUL)
    print(f"payloads that were not answered with one of the service's own words, or INTERNAL, or late: {unlawful}")
    return {**results, "unlawful": unlawful, "most MB": resident_mb()}


def answerers(lab: Lab) -> list[Handler]:
    active = Active(load_model(lab.model), load_joint_model(lab.joint_model))
    parser = RequestParser(active, ServerSettings(), open_logger(sys.stderr), Clock())
    handlers = Corrections(parser).handlers()
    return [handlers["correct"], handlers["correct_path"], handlers["correct_joints"]]


def asked(handlers: list[Handler], payloads: Iterator[Request], count: int) -> Counter[str]:
    """Ask each of the handlers with every payload; count statuses, and answers that took more than a second."""
    counts: Counter[str] = Counter()
    for request in islice(payloads, count // len(handlers)):
        for handler in handlers:
            began = time.process_time()
            counts[handler(structs.replace(request, arrived=time.monotonic())).status] += 1
            counts["late"] += time.process_time() - began > MOST_SECONDS
    return +counts


def nearly_right_payloads(lab: Lab) -> Iterator[Request]:
    draw, joints = Random(1), len(load_joint_model(lab.joint_model).corrector.types)
    while True:
        body = nearly_right(draw, joints)
        for codec, encode in ((JSON, msgspec.json.encode), (MSGPACK, msgspec.msgpack.encode)):
            with suppress(OverflowError, msgspec.MsgspecError):  # what cannot be written
                yield Request(encode(body), codec.media_type, b"", 0.0)


def mangled_payloads(lab: Lab) -> Iterator[Request]:
    rng, whole = np.random.default_rng(2), [*good_payloads(lab.model), *good_joints(lab.joint_model)]
    while True:
        payload, encoding = mangled(rng, whole)
        yield Request(payload, encoding, rng.bytes(rng.integers(40)) if rng.random() < 0.1 else b"", 0.0)


def good_payloads(model: Path) -> list[tuple[bytes, str]]:
    pose, twist = typical_query(model)
    body = CorrectRequest(tuple(pose), tuple(twist))
    path = CorrectPathRequest((tuple(pose),) * 5, (0.0, 0.1, 0.2, 0.3, 0.4))
    plain = [(codec.encode(one), codec.media_type) for codec in CODECS.values() for one in (body, path)]
    return [*plain, (write_pose(StampedPose(tuple(pose), 1, 0, "tracker")), CDR_ENCODING)]


def good_joints(model: Path) -> list[tuple[bytes, str]]:
    joints = len(load_joint_model(model).corrector.types)
    body = CorrectJointsRequest(((0.1,) * joints, (0.11,) * joints), (0.0, 0.1), ((0.0,) * joints,) * 2, (0, 0))
    return [(codec.encode(body), codec.media_type) for codec in CODECS.values()]


def mangled(rng: np.random.Generator, whole: list[tuple[bytes, str]]) -> tuple[bytes, str]:
    """Return random bytes, or a good payload that was cut or of which some bits were flipped."""
    payload, encoding = whole[rng.integers(len(whole))]
    way = rng.integers(4)
    if way == 0:
        return rng.bytes(rng.integers(400)), encoding
    if way == 1:
        return payload[: rng.integers(len(payload))], encoding
    changed = bytearray(payload)
    for place in rng.integers(len(changed), size=1 + rng.integers(4)):
        changed[place] ^= 1 << rng.integers(8)
    return bytes(changed), encoding


def over_zenoh(model: Path, count: int) -> Counter[str]:
    """Send mangled payloads to a real server; it must answer each, and a good one after them all."""
    counts: Counter[str] = Counter()
    rng, whole, end = np.random.default_rng(3), good_payloads(model), free_endpoint()
    with (
        process(serve_model, str(model), ServerSettings(endpoint=end)),
        CorrectionClient(end, connect_timeout=PATIENT, timeout=PATIENT) as client,
        open_client(ClientSettings((end,))) as session,
    ):
        queriers = [session.declare_querier(f"arm1/{kind}", timeout=PATIENT) for kind in KINDS]
        while not all(q.matching_status.matching for q in queriers):
            time.sleep(0.01)
        for i in range(count):
            payload, encoding = mangled(rng, whole)
            counts[status_of(queriers[i % len(queriers)], payload, encoding)] += 1
        counts[client.correct(*typical_query(model)).status] += 1
    return counts


def status_of(querier: zenoh.Querier, payload: bytes, encoding: str) -> str:
    replies = list(querier.get(payload=payload, encoding=encoding))
    if len(replies) != 1:
        return f"{len(replies)} replies"
    if replies[0].ok is not None:
        return "OK"
    codec = error_codec(str(replies[0].err.encoding))
    return "zenoh's error" if codec is None else codec.decode(ErrorAnswer, replies[0].err.payload.to_bytes()).status


def resident_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
