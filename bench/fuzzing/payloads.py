"""Foreign bytes against every key: each is to be answered with one of the service's own words, and the server to live.

Two fuzzers: Hypothesis draws requests that are nearly right (numbers at the edges of floating point, wrong lengths,
missing and unknown fields) for the handlers in process, where a million pass in minutes; a byte fuzzer sends random,
cut and flipped payloads to a real server over zenoh.
"""

from __future__ import annotations

import io
import time
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zenoh
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from service_bench import PATIENT, a_model, free_endpoint, process, serve_model, typical_query

from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.protocol.cdr import CDR_ENCODING, StampedPose, write_pose
from gpcorrect_service.protocol.codec import CODECS, JSON, MSGPACK, error_codec
from gpcorrect_service.protocol.messages import CorrectPathRequest, CorrectRequest, ErrorAnswer, Kind
from gpcorrect_service.protocol.sessions import open_client
from gpcorrect_service.server.corrections import Corrections
from gpcorrect_service.server.models import Active, load_model
from gpcorrect_service.server.requests import Clock, Handler, Request, RequestParser

OVER_ZENOH = 0.02  # share of the payloads that a real server gets
KINDS: tuple[Kind, ...] = ("correct", "correct_path", "correct_joints", "admin/activate", "admin/state")
LAWFUL = {"OK", "EXTRAPOLATING", "LIMITED", "BAD_INPUT", "NO_MODEL", "BUSY", "STALE"}

numbers = st.floats(width=64) | st.integers(-(10**20), 10**20)
anything = st.recursive(st.none() | st.booleans() | numbers | st.text(max_size=8), lambda x: st.lists(x, max_size=9))
places = st.lists(st.floats(-0.2, 0.2), min_size=3, max_size=3)
rows = places.map(lambda place: [*place, 1.0, 0.0, 0.0, 0.0]) | places | st.lists(numbers, max_size=9)
table = st.lists(rows, min_size=1, max_size=6)
more = {"unknown": anything}
bodies = st.one_of(
    st.fixed_dictionaries({"pose": rows}, optional={"twist": rows | anything}),
    st.fixed_dictionaries({"pose": rows | anything}, optional=more),
    st.fixed_dictionaries({"poses": table, "times": st.lists(st.floats(-10.0, 10.0), max_size=6).map(sorted)}),
    st.fixed_dictionaries({"poses": table | anything, "times": rows | anything}, optional=more),
    st.fixed_dictionaries({"q": table | anything, "times": rows | anything}, optional={"efforts": table, **more}),
)


def fuzz_payloads(count: int, model: Path | None = None) -> dict[str, Any]:
    """Ask every handler, and a real server, with `count` payloads; return the statuses that came, and print them."""
    results = {}
    with a_model(model) as file:
        nearly = round(count / 4)
        for name, ask, payloads in (
            ("nearly right", nearly_right, nearly),
            ("random, cut and flipped", random_bytes, count - nearly),
            ("over zenoh", over_zenoh, round(count * OVER_ZENOH)),
        ):
            results[name] = dict(ask(file, payloads))
            print(f"{name}: {sum(results[name].values())} payloads: {results[name]}", flush=True)
    unlawful = sum(n for counts in results.values() for status, n in counts.items() if status not in LAWFUL)
    print(f"payloads that were not answered with one of the service's own words, or INTERNAL: {unlawful}")
    return {**results, "unlawful": unlawful}


def answerers(model: Path) -> list[Handler]:
    parser = RequestParser(
        Active(load_model(model)), arm="arm1", replica="r", logger=open_logger(io.StringIO()), clock=Clock()
    )
    handlers = Corrections(parser).handlers()
    return [handlers["correct"], handlers["correct_path"], handlers["correct_joints"]]


def nearly_right(model: Path, count: int) -> Counter[str]:
    counts: Counter[str] = Counter()
    ask = answerers(model)

    @seed(1)
    @settings(
        max_examples=max(1, count // (len(ask) * len(CODECS))),
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(body=bodies)
    def one(body: dict[str, Any]) -> None:
        for codec, encode in ((JSON, msgspec.json.encode), (MSGPACK, msgspec.msgpack.encode)):
            try:
                payload = encode(body)
            except (OverflowError, msgspec.MsgspecError):
                continue
            for handler in ask:
                counts[handler(Request(payload, codec.media_type, b"", time.monotonic())).status] += 1

    one()
    return counts


def random_bytes(model: Path, count: int) -> Counter[str]:
    counts: Counter[str] = Counter()
    ask, rng = answerers(model), np.random.default_rng(2)
    whole = good_payloads(model)
    for i in range(count):
        payload, encoding = mangled(rng, whole)
        attachment = rng.bytes(rng.integers(40)) if rng.random() < 0.1 else b""
        counts[ask[i % len(ask)](Request(payload, encoding, attachment, time.monotonic())).status] += 1
    return counts


def good_payloads(model: Path) -> list[tuple[bytes, str]]:
    pose, twist = typical_query(model)
    body = CorrectRequest(tuple(pose), tuple(twist))
    path = CorrectPathRequest((tuple(pose),) * 5, (0.0, 0.1, 0.2, 0.3, 0.4))
    plain = [(codec.encode(one), codec.media_type) for codec in CODECS.values() for one in (body, path)]
    return [*plain, (write_pose(StampedPose(tuple(pose), 1, 0, "tracker")), CDR_ENCODING)]


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
