"""Servers that die, hang and come back, as a planner sees them."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from service_support import (
    PATIENT,
    POSE,
    REGISTRATION,
    SHIFT,
    ShiftCorrector,
    child,
    end_with_parent,
    endpoint_of,
    free_port,
    hang,
    serve_in_child,
    server_process,
    spawn,
    stranger,
    wait_for,
)

from gpcorrect.rigid import RigidModel
from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings, ServiceError
from gpcorrect_service.client.connection import Querier
from gpcorrect_service.client.replies import PinnedModels
from gpcorrect_service.client.requests import Question, RequestBuilder
from gpcorrect_service.ops.doctor import examine
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.ops.router import route
from gpcorrect_service.protocol.bounds import CorrectionBound
from gpcorrect_service.protocol.messages import ModelAnswer, ReplyMeta
from gpcorrect_service.server.handlers import Corrections
from gpcorrect_service.server.models import Active, Model
from gpcorrect_service.server.requests import Clock, Request, RequestParser

ROUTED = Path(__file__).resolve().parents[2] / "service" / "deploy" / "router"


def test_nobody_there() -> None:
    """Without a server a client can be made; it says NO_SERVICE, the address and what may be the matter."""
    endpoint = endpoint_of(free_port())
    with CorrectionClient(endpoint, connect_timeout=0.2) as client, pytest.raises(ServiceError) as caught:
        client.correct(POSE)
    assert caught.value.status == "NO_SERVICE"
    assert endpoint in caught.value.message
    assert "running" in caught.value.hint


def test_only_the_first_question_waits_for_a_server(tmp_path: Path) -> None:
    """A planner whose router was away at its first question is told in time at the next, with the router back."""
    endpoint, waits = endpoint_of(free_port()), 100.0
    quiet = {"scouting": {"multicast": {"enabled": False}}}
    to_router = tmp_path / "client.json5"
    to_router.write_text(json.dumps({"mode": "client", "connect": {"endpoints": [endpoint]}} | quiet))
    router = zenoh.Config.from_json5(json.dumps({"mode": "router", "listen": {"endpoints": [endpoint]}} | quiet))
    with CorrectionClient(config_file=to_router, timeout=1.0, connect_timeout=waits) as client:
        with pytest.raises(ServiceError, match="NO_SERVICE"):
            client.correct(POSE)
        begun = time.monotonic()
        with zenoh.open(router), pytest.raises(ServiceError, match="NO_SERVICE"):
            client.correct(POSE)
        assert time.monotonic() - begun < waits / 2


def test_identity_is_the_registered_pose() -> None:
    """A fallback commands what registration alone does: a jump by the learned part, not from frame to frame."""
    with (
        server_process("registered") as server,
        server.client(timeout=1.0, path_timeout=1.0, on_failure="identity") as client,
    ):
        last = client.correct(POSE)
        client.correct_path([POSE, POSE], [0.0, 1.0])
        server.process.kill()
        one = client.correct(POSE)
        path = client.correct_path([POSE, POSE], [0.0, 1.0])
        with pytest.raises(ServiceError, match="BAD_INPUT"):
            client.correct([np.nan, *POSE[1:]])
    np.testing.assert_allclose(one.pose, [*(POSE[:3] + REGISTRATION), *POSE[3:]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(last.position - one.position, SHIFT, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(path.pose, [one.pose] * 2)
    assert (one.fallback, path.fallback) == ("identity", "identity")
    assert (one.status, path.status) == ("NO_SERVICE", ("NO_SERVICE",) * 2)
    assert not one.in_domain
    assert not path.in_domain.any()
    assert np.isnan(one.std).all()


def test_identity_takes_poses_as_far_away_as_the_server_does() -> None:
    """A model trained far from the origin is asked there; while its server is away, so is the registration."""
    pinned, away = PinnedModels(), ServiceError("NO_SERVICE", "nobody is there.")
    build = RequestBuilder(ClientSettings(), "msgpack", "identity", pinned)
    far = [8.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    with pytest.raises(ServiceError, match="NO_SERVICE"):
        build.correct(far, None).rescue(away)
    pinned.check("correct", ReplyMeta("", "m", "h", "r"))
    region = {"position_min": [7.0, -1.0, -1.0], "position_max": [9.0, 1.0, 1.0]}
    told = {"training_region": region}
    pinned.learn(ModelAnswer("m", "h", "arm1", "r", told, RigidModel().to_dict()))
    reply = build.correct(far, None).rescue(away)
    assert reply.fallback == "identity"
    np.testing.assert_allclose(reply.pose, far)
    with pytest.raises(ServiceError, match="looks like millimetres"):
        build.correct([8000.0, *far[1:]], None).rescue(away)


def test_a_good_answer_does_not_wait_for_a_registration_that_nobody_gives() -> None:
    """Where a network lets `correct` pass and `model` not, the first answer waited three seconds, and was too old."""
    parser = RequestParser(Active(Model(ShiftCorrector(), id="m", hash="h")), ServerSettings(), open_logger(), Clock())
    handler = Corrections(parser).handlers()["correct"]

    def _reply(query: zenoh.Query) -> None:
        with query:
            assert query.attachment is not None
            asked = (query.payload.to_bytes(), str(query.encoding), query.attachment.to_bytes())
            answer = handler(Request(*asked, time.monotonic()))
            query.reply(query.key_expr, answer.payload, encoding=answer.encoding, attachment=answer.attachment)

    endpoint = endpoint_of(free_port())
    listens = {"mode": "router", "listen": {"endpoints": [endpoint]}, "scouting": {"multicast": {"enabled": False}}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(listens))) as session:
        session.declare_queryable("gpcorrect/arm1/correct", _reply)
        with CorrectionClient(endpoint, timeout=2.0, on_failure="identity") as client:
            answers = [client.correct(POSE) for _ in range(3)]
    assert [answer.status for answer in answers] == ["OK"] * 3


def test_identity_without_a_good_answer_before_is_an_error() -> None:
    """A client that never heard of a registration has no pose that would be right, and says so."""
    with CorrectionClient(endpoint_of(free_port()), connect_timeout=0.1, on_failure="identity") as client:
        for ask in (lambda: client.correct(POSE), lambda: client.correct_path([POSE], [0.0])):
            with pytest.raises(ServiceError, match="NO_SERVICE"):
                ask()


def test_an_answer_beyond_the_timeout_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """A planner that is held up between its two attempts hears STALE, however quick the second one is."""
    with server_process() as server, server.client(timeout=1.0) as client:
        client.correct(POSE)
        attempt, held_up = client._attempt, []

        async def _held(*arguments: object) -> object:
            if not held_up:
                held_up.append(True)
                time.sleep(1.1)
                return ServiceError("NO_SERVICE", "no reply came")
            return await attempt(*arguments)  # type: ignore[arg-type]

        monkeypatch.setattr(client, "_attempt", _held)
        with pytest.raises(ServiceError, match="STALE"):
            client.correct(POSE)
        assert client.correct(POSE).status == "OK"


def test_an_answer_counts_its_age_from_the_call(monkeypatch: pytest.MonkeyPatch) -> None:
    """A planner that is held up after it asked, before anything is sent, hears STALE."""
    with server_process() as server, server.client(timeout=1.0) as client:
        client.correct(POSE)
        build = client._build.correct

        def _held(*arguments: object) -> object:
            question = build(*arguments)  # type: ignore[arg-type]
            time.sleep(1.1)
            return question

        monkeypatch.setattr(client._build, "correct", _held)
        with pytest.raises(ServiceError, match="STALE"):
            client.correct(POSE)


def test_an_answer_that_waits_for_the_registration_is_as_old_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Registration, for a fallback, is asked for behind the first answer: where it takes long, so did the answer."""
    with server_process() as server, server.client(timeout=1.0, on_failure="identity") as client:
        attempt = client._attempt

        async def _held(querier: Querier, target: zenoh.Querier, question: Question[Any]) -> object:
            if question.kind == "model":
                time.sleep(1.1)
                return ServiceError("NO_SERVICE", "no reply came")
            return await attempt(querier, target, question)

        monkeypatch.setattr(client, "_attempt", _held)
        with pytest.raises(ServiceError, match="STALE"):
            client.correct(POSE)


def test_a_stream_stays_with_its_model() -> None:
    """Two replicas with different models never take turns: the other's answers are refused until the planner agrees."""
    with (
        server_process("registered") as one,
        server_process("faulty") as other,
        CorrectionClient((one.endpoint, other.endpoint), timeout=1.0, connect_timeout=PATIENT) as client,
    ):
        first = client.correct(POSE).meta.model_hash
        assert {client.correct(POSE).meta.model_hash for _ in range(20)} == {first}
        held, left = (one, other) if first == b"registered".hex() else (other, one)
        assert held.process.pid is not None
        hang(held.process.pid)
        with pytest.raises(ServiceError, match="change_model") as refused:
            client.correct(POSE)
        assert refused.value.status == "OTHER_MODEL"
        client.change_model()
        assert answering_pid(client) == left.process.pid


def test_a_stream_stays_within_its_bounds() -> None:
    """A replica of the same model that an operator bounds otherwise takes no turns either: its commands differ too."""
    bound = CorrectionBound(position=1e-3)
    with (
        server_process(bound=bound) as one,
        server_process(strict=True) as other,
        CorrectionClient((one.endpoint, other.endpoint), timeout=1.0, connect_timeout=PATIENT) as client,
    ):
        held = client.correct(POSE).meta.bounds
        assert held in ("1 mm", "strict")
        assert {client.correct(POSE).meta.bounds for _ in range(20)} == {held}
        hung = one if held == "1 mm" else other
        assert hung.process.pid is not None
        hang(hung.process.pid)
        with pytest.raises(ServiceError, match=f"held to answers within {held}") as refused:
            client.correct(POSE)
        assert refused.value.status == "OTHER_MODEL"


def test_the_doctor_says_when_models_differ() -> None:
    """The doctor names who holds which model, and is content where all hold the same; tokens tell it."""
    with server_process(replica="left") as one, server_process(replica="right") as same:
        assert differing_models(one.endpoint, same.endpoint) == (True, "")
        with server_process("faulty", replica="third") as other:
            well, cause = differing_models(one.endpoint, other.endpoint)
    assert not well
    assert f"left has {b'shift'.hex()}" in cause
    assert f"third has {b'faulty'.hex()}" in cause


def differing_models(*endpoints: str) -> tuple[bool, str]:
    (found,) = (one for one in examine(ClientSettings(endpoints)) if one.step == "models")
    return found.well, found.cause


def test_a_planner_names_its_model() -> None:
    """A client that requires a model takes no answer of another one, the first included."""
    with server_process() as server:
        with server.client(model_hash="ab" * 32) as client, pytest.raises(ServiceError, match="abababababab"):
            client.correct(POSE)
        with server.client(model_hash=b"shift".hex()) as client:
            assert client.correct(POSE).status == "OK"
        with server.client(model_hash="ab" * 32, pin=False) as client:
            assert client.correct(POSE).meta.model_hash == b"shift".hex()


def test_a_server_that_comes_back_is_found_again() -> None:
    """A killed server is NO_SERVICE; once another listens there, the same client is answered again."""
    port = free_port()
    with CorrectionClient(endpoint_of(port), timeout=1.0, connect_timeout=PATIENT) as client:
        with server_process(port=port):
            assert client.correct(POSE).status == "OK"
        with pytest.raises(ServiceError, match="NO_SERVICE"):
            client.correct(POSE)
        with server_process(port=port) as successor:
            assert answering_pid(client) == successor.process.pid


def answering_pid(client: CorrectionClient) -> int:
    """Return the process that answers this client, asking until one does."""
    for _ in range(int(PATIENT)):
        try:
            return int(client.correct(POSE).meta.replica.rsplit("-", 1)[1])
        except ServiceError:
            continue
    raise AssertionError("nobody answers")


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hung"])
def test_a_lost_replica_costs_only_what_was_under_way(blow: signal.Signals) -> None:
    """Four planners that ask all the time lose no query to a replica that dies or hangs: each is answered."""
    with server_process() as first, server_process() as second:
        endpoints = (first.endpoint, second.endpoint)
        stop, statuses = threading.Event(), []

        def plan() -> None:
            with CorrectionClient(endpoints, timeout=4.0, connect_timeout=PATIENT, on_failure="identity") as client:
                while not stop.is_set():
                    statuses.append(client.correct(POSE).status)
                    time.sleep(0.005)

        planners = [threading.Thread(target=plan, daemon=True) for _ in range(4)]
        with CorrectionClient(endpoints, timeout=2.0, connect_timeout=PATIENT) as client:
            victim = answering_pid(client)
        for planner in planners:
            planner.start()
        wait_for(lambda: len(statuses) > 100)
        os.kill(victim, blow)
        asked = len(statuses)
        wait_for(lambda: len(statuses) > asked + 200)
        stop.set()
        for planner in planners:
            planner.join(PATIENT)
    assert set(statuses) == {"OK"}


def test_a_hung_replica_is_left_for_a_while() -> None:
    """After one silent answer the nearest server is not asked alone: later questions do not wait for it."""
    with server_process() as first, server_process() as second:
        client = CorrectionClient((first.endpoint, second.endpoint), timeout=8.0, connect_timeout=PATIENT)
        with client:
            hang(answering_pid(client))
            client.correct(POSE)
            began = time.monotonic()
            for _ in range(5):
                client.correct(POSE)
            # Each alone would wait half of a timeout, 4 s, before all servers are asked; one may, which met it first.
            assert time.monotonic() - began < 8.0


def test_a_replica_shows_that_it_lives() -> None:
    """A server's liveliness token is there while it runs, names its models, and is gone when it was killed."""
    with server_process(replica="left-1") as server, stranger(server.endpoint) as session:
        wait_for(lambda: alive(session) == [f"gpcorrect/arm1/live/left-1/{b'shift'.hex()}/none"])
        server.process.kill()
        wait_for(lambda: not alive(session))


def alive(session: zenoh.Session) -> list[str]:
    replies = session.liveliness().get("gpcorrect/*/live/**", timeout=PATIENT)
    return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]


def route_in_child(ready: Event, config: str) -> None:
    """Run in the child process: route until killed."""
    end_with_parent()
    route(Path(config), threading.Event(), ready.set)


def test_a_router_that_comes_back_is_found_again(tmp_path: Path) -> None:
    """When the router between planner and server is killed and started again, both find it by themselves."""
    port = free_port()
    files = {}
    for name in ("router", "member"):
        text = (ROUTED / f"{name}.json5").read_text().replace("127.0.0.1:7449", f"127.0.0.1:{port}")
        files[name] = tmp_path / f"{name}.json5"
        files[name].write_text(text)
    serving, routing, again = spawn.Event(), spawn.Event(), spawn.Event()
    settings = ServerSettings(config_file=files["member"])
    served = ("shift", spawn.Event(), spawn.Event(), serving, settings)
    with (
        child(route_in_child, routing, (routing, str(files["router"]))) as router,
        child(serve_in_child, serving, served) as server,
        CorrectionClient(config_file=files["member"], timeout=1.0, connect_timeout=PATIENT) as client,
    ):
        assert answering_pid(client) == server.pid
        router.kill()
        router.join(PATIENT)
        with pytest.raises(ServiceError, match="NO_SERVICE"):
            client.correct(POSE)
        with child(route_in_child, again, (again, str(files["router"]))):
            assert answering_pid(client) == server.pid
