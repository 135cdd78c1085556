"""What a foreign client reads: raw bytes under the names of docs/service.md, without any class of ours."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import msgspec
import pytest
import zenoh
from service_support import PATIENT, POSE, ServerProcess, ask_bare, server_process, store_process, stranger, wait_for

from gpcorrect.calibration import ModelStore

DOCS = (Path(__file__).parents[2] / "docs" / "service.md").read_text()
NAME = re.compile(r"`(\w+)`")
ROWS = {"times": [0.0, 0.1]}
QUESTIONS: dict[str, dict[str, Any]] = {
    "correct": {"pose": POSE, "twist": [0.0] * 6},
    "correct_path": {"poses": [POSE, POSE], **ROWS},
    "correct_joints": {"q": [[0.1] * 3] * 2, "efforts": [[0.0] * 3] * 2, "sessions": [0, 0], **ROWS},
    "model": {},
    "health": {},
    "model/list": {},
    "admin/activate": {"model": "monday", "back": False},
    "admin/state": {"state": "ENABLED"},
}
WRITERS = {"json": msgspec.json, "msgpack": msgspec.msgpack}


def documented() -> dict[str, tuple[list[str], list[str]]]:
    """Return the names of question and answer of each key, as the table of messages has them."""
    table = DOCS.partition("| key | question | answer |\n|---|---|---|\n")[2].partition("\n\n")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:4]] for line in table.splitlines()]
    # What stands in parentheses are the names inside an answer's own.
    return {
        key.strip("`"): (NAME.findall(asked), NAME.findall(re.sub(r"\(.*?\)", "", answered)))
        for key, asked, answered in rows
    }


def examples(after: str) -> list[set[str]]:
    """Return the names in the two JSON blocks behind some words of the documentation."""
    blocks = re.findall(r"```json\n(.*?)```", DOCS.partition(after)[2], re.DOTALL)
    return [set(json.loads(block)) for block in blocks[:2]]


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory, model_files: tuple[Path, Path]) -> Iterator[list[zenoh.Session]]:
    """Sessions to a server of poses and joints, and to one of a store."""
    folder = tmp_path_factory.mktemp("store")
    store = ModelStore(folder)
    store.activate(store.add(model_files[0], now=0.0, name="monday"))
    with ExitStack() as stack:
        servers: list[ServerProcess] = [
            stack.enter_context(server_process("joints")),
            stack.enter_context(store_process(folder)),
        ]
        yield [stack.enter_context(stranger(one.endpoint)) for one in servers]


def test_every_key_is_in_the_table() -> None:
    """The table of messages leaves out none of the keys but `metrics`, which is text."""
    assert documented().keys() == QUESTIONS.keys()


@pytest.mark.parametrize("codec", WRITERS)
@pytest.mark.parametrize("key", QUESTIONS)
def test_names_on_the_wire_are_the_documented(sessions: list[zenoh.Session], key: str, codec: str) -> None:
    """A question with every documented name is taken, and its answer has the documented names and no others."""
    asked, answered = documented()[key]
    question = QUESTIONS[key]
    assert question.keys() == set(asked)
    session = sessions[1 if key in ("model/list", "admin/activate") else 0]
    write, read = WRITERS[codec].encode, json.loads if codec == "json" else msgspec.msgpack.decode
    encoding = f"application/{codec};gpcorrect.{key.replace('/', '_')}/1"
    reply = ask_bare(session, f"gpcorrect/arm1/{key}", write(question), encoding, write({"request_id": "a1"}))[0]
    assert reply.ok is not None, reply.err
    assert str(reply.ok.encoding) == encoding
    assert sorted(read(reply.ok.payload.to_bytes())) == sorted(answered)
    if key.startswith("correct"):
        assert reply.ok.attachment is not None
        beside = re.findall(r'"(\w+)"', re.findall(r"Beside a correction: `\{(.*?)\}`", DOCS)[0])
        assert sorted(read(reply.ok.attachment.to_bytes())) == sorted(beside)


@pytest.mark.parametrize("key", ["correct", "correct_joints"])
def test_examples_agree_with_the_table(key: str) -> None:
    """The examples in JSON have the names of the table."""
    asked, answered = documented()[key]
    assert examples(f"`{key}`, question and answer") == [set(asked), set(answered)]


def test_a_refusal_has_the_documented_names(sessions: list[zenoh.Session]) -> None:
    """A refusal can be read by its documented names."""
    reply = ask_bare(sessions[0], "gpcorrect/arm1/correct", b"{}")[0]
    assert reply.err is not None
    names = re.findall(r'"(\w+)"', DOCS.partition("A refusal is a zenoh error reply")[2].partition("}`")[0])
    assert sorted(json.loads(reply.err.payload.to_bytes())) == sorted(names)


def test_estimates_have_the_documented_names(sessions: list[zenoh.Session]) -> None:
    """A sample with the documented names gives an estimate with the documented names, where joints are `position`."""
    heard: SimpleQueue[zenoh.Sample] = SimpleQueue()
    sample, estimate = examples("The stream, sample by sample")
    stamps = iter(range(1, 1_000_000))

    def answered() -> bool:
        body = {"stamp": float(next(stamps)), "position": [0.1] * 3, "effort": [0.0] * 3, "session": 0}
        assert body.keys() == sample
        sessions[0].put(
            "gpcorrect/arm1/measured_js", json.dumps(body), encoding="application/json;gpcorrect.joint_state/1"
        )
        return not heard.empty()

    callback = zenoh.handlers.Callback(heard.put, indirect=False)
    with sessions[0].declare_subscriber("gpcorrect/arm1/estimate", callback):
        wait_for(answered)
    got = heard.get(timeout=PATIENT)
    assert str(got.encoding) == "application/json;gpcorrect.estimate/1"
    read = json.loads(got.payload.to_bytes())
    assert read.keys() == estimate
    assert read["position"] == [0.1] * 3
