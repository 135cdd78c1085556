"""A site with certificates, passwords and access rules: who may do what, and a doctor that tells the faults apart."""

from __future__ import annotations

import datetime
import io
import json
import socket
import stat
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from multiprocessing.synchronize import Event
from pathlib import Path
from typing import Any

import pytest
import zenoh
from crtk_support import SHIFT, ShiftCorrector, model
from service_support import (
    PATIENT,
    POSE,
    ask_bare,
    called,
    child,
    end_with_parent,
    free_port,
    serve_in_child,
    spawn,
    wait_for,
)  # fmt: skip

from gpcorrect.errors import DataError
from gpcorrect_service import ClientSettings, CorrectionClient, ServerSettings, ServiceError
from gpcorrect_service.client.operator import Operator
from gpcorrect_service.crtk import Bus, BusSettings, OperatingState, Pose
from gpcorrect_service.crtk.prefilter import FilterServer, Prefilter
from gpcorrect_service.monitor import Board, Watcher
from gpcorrect_service.ops.doctor import Finding, examine
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.ops.router import DenialReader, route
from gpcorrect_service.ops.secure import HANDSHAKE_MS, ROLES, USERS, Site, secure_site
from gpcorrect_service.protocol.ros import CORRECT, attachment, decode_cdr, rmw_key
from gpcorrect_service.protocol.sessions import open_client

NOW = datetime.datetime.now(datetime.UTC)
Edit = Callable[[dict[str, Any]], None]


def route_in_child(ready: Event, config: str) -> None:
    """Run in the child process: route until killed."""
    end_with_parent()
    with open(Path(config).with_name("router.log"), "a", buffering=1) as log:
        route(Path(config), threading.Event(), ready.set, open_logger(log))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Start a secured router with a server behind it."""
    folder = tmp_path_factory.mktemp("secured") / "site"
    secure_site(folder, Site(port=free_port()), NOW)
    routing, serving = spawn.Event(), spawn.Event()
    settings = ServerSettings(config_file=folder / "server.json5", allow_remote=True, ros_domain=3)
    router = child(route_in_child, routing, (routing, str(folder / "router.json5")))
    with router, child(serve_in_child, serving, ("shift", spawn.Event(), spawn.Event(), serving, settings)):
        settings = ClientSettings(config_file=folder / "planner.json5")
        wait_for(lambda: all(finding.well for finding in examine(settings)))
        yield folder


@pytest.mark.parametrize("role", [role for role in ROLES if role != "server"])
def test_a_role_may_do_what_it_is_for(site: Path, role: str) -> None:
    """Planner and operator are corrected, the monitor is not; all see health, and nobody else changes the state."""
    file = site / f"{role}.json5"
    with CorrectionClient(config_file=file, timeout=4.0, connect_timeout=2.0) as client:
        assert client.health().state == "ENABLED"
        assert corrected(client) == (role in ("planner", "operator"))
    with Operator(ClientSettings(config_file=file, connect_timeout=2.0), patience=PATIENT) as operator:
        try:
            changed = operator.set_state("ENABLED")[0].state == "ENABLED"
        except ServiceError:
            changed = False
    assert changed == (role == "operator")


@pytest.mark.parametrize(("certificate", "password"), [("planner", "operator"), ("operator", "planner")])
def test_a_role_is_a_certificate_and_its_password(site: Path, tmp_path: Path, certificate: str, password: str) -> None:
    """One role's certificate with another's password is nobody: it is not corrected and changes no state."""
    config, other = (json.loads((site / f"{role}.json5").read_text()) for role in (certificate, password))
    config["transport"]["auth"] = other["transport"]["auth"]
    file = tmp_path / "mixed.json5"
    file.write_text(json.dumps(config))
    with CorrectionClient(config_file=file, timeout=1.0, connect_timeout=1.0) as client:
        assert not corrected(client)
    settings = ClientSettings(config_file=file, connect_timeout=1.0)
    with Operator(settings, patience=1.0) as operator, pytest.raises(ServiceError):
        operator.set_state("ENABLED")


def test_a_robot_moves_behind_the_secured_router(site: Path) -> None:
    """Planner, pre-filter, robot and monitor work with the site's files; a planner's corrected/servo_cp is denied."""
    heard: list[Pose] = []
    board = Board("gpcorrect")
    stop = threading.Event()
    places = {role: BusSettings(config_file=site / f"{role}.json5", patience=PATIENT) for role in USERS}
    with (
        Bus(places["robot"]) as robot,
        Bus(places["planner"]) as planner,
        Bus(places["prefilter"]) as bus,
        Watcher(board, [places["monitor"]]),
    ):
        robot.subscribe("corrected/servo_cp", heard.append)
        filtering = threading.Thread(
            target=FilterServer(Prefilter(model(ShiftCorrector())), bus, open_logger()).run, args=(stop,), daemon=True
        )
        filtering.start()
        with Bus(places["prefilter"]) as second, pytest.raises(DataError, match="another prefilter"):
            FilterServer(Prefilter(model(ShiftCorrector())), second, open_logger())

        def moved_and_shown() -> bool:
            now = time.time()
            robot.publish("operating_state", OperatingState(now, "ENABLED", True, False))
            planner.publish("servo_cp", Pose(now, tuple(POSE), "tracker"))
            planner.publish("corrected/servo_cp", Pose(now, (9.0, *POSE[1:]), "base"))
            time.sleep(0.02)
            arms = board.snapshot(time.monotonic())["arms"]
            return bool(heard) and any(arm["correction"] and arm["replicas"] for arm in arms)

        try:
            wait_for(moved_and_shown)
        finally:
            stop.set()
            filtering.join(PATIENT)
    assert {pose.pose[0] for pose in heard} == {POSE[0] + SHIFT[0]}


@pytest.mark.parametrize("role", [user for user in USERS if user != "server"])
def test_a_ros_node_asks_with_the_certificate_of_a_role(site: Path, role: str) -> None:
    """Planner and operator see the ROS 2 service in the graph and are corrected by it; others see and hear nothing."""
    config = zenoh.Config.from_file(site / f"{role}.json5")
    config.insert_json5("namespace", "null")  # as of a node of rmw_zenoh
    with zenoh.open(config) as session:
        key = rmw_key(3, "arm1/correct", CORRECT, "jazzy")
        payload, beside = called(), attachment(7, 1, b"g" * 16)
        if role in ("planner", "operator"):
            (reply,) = ask_bare(session, key, payload, attachment=beside)
            answer = decode_cdr(reply.ok.payload.to_bytes(), f"{CORRECT}_Response")
            assert answer.command.pose.position.x == pytest.approx(POSE[0] + SHIFT[0], abs=1e-15)
            tokens = [str(token.ok.key_expr) for token in session.liveliness().get("@ros2_lv/3/**")]
            assert sum("/SS/" in token for token in tokens) == sum("/NN/" in token for token in tokens) == 1
        else:
            assert not list(session.get(key, payload=payload, attachment=beside, timeout=0.3))
            assert not list(session.liveliness().get("@ros2_lv/3/**", timeout=0.3))


def test_denials_say_who_and_what(site: Path, tmp_path: Path) -> None:
    """The router logs certificate, user and key of what is denied, and logins that fail; not what is allowed."""

    def written(**facts: str) -> bool:
        lines = [json.loads(line) for line in (site / "router.log").read_text().splitlines()]
        return any(facts.items() <= line.items() for line in lines)

    mixed = tmp_path / "mixed.json5"
    config, operator = (json.loads((site / f"{role}.json5").read_text()) for role in ("planner", "operator"))
    config["transport"]["auth"] = operator["transport"]["auth"]
    mixed.write_text(json.dumps(config))
    key = "gpcorrect/arm1/admin/state"
    for file, user in ((site / "planner.json5", "planner"), (mixed, "operator")):
        with open_client(ClientSettings(config_file=file)) as session:

            def tried(session: zenoh.Session = session, user: str = user) -> bool:
                session.get("arm1/admin/state", timeout=0.05)
                return written(event="denied", certificate="planner", user=user, what="Query", key=key)

            wait_for(tried)
    examined(site, tmp_path, other_password)
    wait_for(lambda: written(event="login refused", cause="Invalid password"))
    assert "planner at" in (site / "router.log").read_text()
    with CorrectionClient(config_file=site / "planner.json5", timeout=4.0) as client:
        assert corrected(client)
    time.sleep(0.5)  # in which a denial would be written
    assert not written(event="denied", key="gpcorrect/arm1/correct", user="planner", certificate="planner")


def test_denials_fill_no_disk() -> None:
    """Of a thousand denials in a second twenty are written, and then how many were not; what is allowed is not."""
    text, now = io.StringIO(), [0.0]
    reader = DenialReader(open_logger(text), lambda: now[0])
    line = "TRACE a: 1f on CertCommonName(planner)+Username(planner) is unauthorized to Put (ingress) on k"
    for number in range(1000):
        reader.read(f"{line}{number}")
    now[0] = 0.5
    reader.flush()
    reader.read(line)
    reader.read(line.replace("unauthorized to Put", "authorized to Query"))
    reader.read(f"{line}/other")
    now[0] = 2.0
    reader.flush()
    lines = [json.loads(one) for one in text.getvalue().splitlines()]
    assert [one["event"] for one in lines].count("denied") == 21
    assert lines[20]["unwritten"] == 980
    assert lines[21]["key"] == "k/other"


def test_idle_connections_lock_nobody_out(site: Path) -> None:
    """While five hundred connections to the router say nothing, a planner connects and is corrected."""
    port = int(json.loads((site / "planner.json5").read_text())["connect"]["endpoints"][0].rsplit(":", 1)[1])
    with ExitStack() as silent:
        for _ in range(500):
            one = silent.enter_context(socket.create_connection(("127.0.0.1", port), PATIENT))
            # Reset at their end: zenoh takes 0.1 s over each that closes in order, and the next test would wait.
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        time.sleep(1.5 * HANDSHAKE_MS / 1e3)  # zenoh has given up on those that it knows, one after the other
        with CorrectionClient(config_file=site / "planner.json5", timeout=4.0, connect_timeout=10.0) as client:
            assert corrected(client)


def corrected(client: CorrectionClient) -> bool:
    try:
        return client.correct(POSE).status == "OK"
    except ServiceError as error:
        assert error.status == "NO_SERVICE"  # noqa: PT017 - all that zenoh shows of a denied key
        return False


def other_password(config: dict[str, Any]) -> None:
    config["transport"]["auth"]["usrpwd"]["password"] = "guessed"


def no_certificate(config: dict[str, Any]) -> None:
    del config["transport"]["link"]["tls"]["connect_certificate"]
    del config["transport"]["link"]["tls"]["connect_private_key"]
    config["transport"]["link"]["tls"]["enable_mtls"] = False


def lost_certificate(config: dict[str, Any]) -> None:
    config["transport"]["link"]["tls"]["connect_certificate"] += ".gone"


def closed_port(config: dict[str, Any]) -> None:
    config["connect"]["endpoints"] = [f"tls/localhost:{free_port()}"]


def plain_tcp(config: dict[str, Any]) -> None:
    config["connect"]["endpoints"] = [one.replace("tls/", "tcp/") for one in config["connect"]["endpoints"]]


def unknown_host(config: dict[str, Any]) -> None:
    config["connect"]["endpoints"] = ["tls/nowhere.invalid:7447"]


@pytest.mark.parametrize(
    ("edit", "step", "cause"),
    [
        (other_password, "login", "wrong user or password"),
        (no_certificate, "tls", "missing certificate"),
        (lost_certificate, "tls", "missing certificate"),
        (closed_port, "port", "closed port"),
        (plain_tcp, "login", "plain TCP to a TLS port"),
        (unknown_host, "port", "unknown host"),
    ],
)
def test_the_doctor_tells_faults_apart(site: Path, tmp_path: Path, edit: Edit, step: str, cause: str) -> None:
    """Each fault of a client is named by its own cause, with what to do, at the step where it hides the rest."""
    last = examined(site, tmp_path, edit)[-1]
    assert (last.step, last.cause, last.well) == (step, cause, False)
    assert last.next_step


def test_the_doctor_knows_a_foreign_certificate(site: Path, tmp_path: Path) -> None:
    """A certificate of another site's authority is called foreign, on either side of the link."""
    secure_site(tmp_path / "other", Site(), NOW)
    for parts in (("connect_certificate", "connect_private_key"), ("root_ca_certificate",)):

        def edit(config: dict[str, Any], parts: tuple[str, ...] = parts) -> None:
            for part in parts:
                tls = config["transport"]["link"]["tls"]
                tls[part] = str(tmp_path / "other" / Path(tls[part]).name)

        assert examined(site, tmp_path, edit)[-1].cause == "foreign certificate"


@pytest.mark.parametrize("days", [-400, 400])
def test_an_expired_site_is_called_expired(tmp_path: Path, days: int) -> None:
    """Doctor, router, client, pre-filter and monitor say that certificates expired, or are not valid yet."""
    folder = tmp_path / "site"
    secure_site(folder, Site(port=free_port()), NOW + datetime.timedelta(days=days))
    file = folder / "planner.json5"
    word = "expired on" if days < 0 else "valid from"
    (last,) = examine(ClientSettings(config_file=file))
    assert (last.cause, last.well) == ("expired certificate", False)
    assert word in last.next_step
    with pytest.raises(DataError, match=word):
        route(folder / "router.json5", threading.Event())
    with pytest.raises(DataError, match=word), CorrectionClient(config_file=file) as client:
        client.health()
    with pytest.raises(DataError, match=word):
        Bus(BusSettings(config_file=folder / "prefilter.json5"))
    with (
        pytest.raises(DataError, match=word),
        Watcher(Board("gpcorrect"), [BusSettings(config_file=folder / "monitor.json5")]),
    ):
        pass


@pytest.mark.parametrize("role", USERS)
def test_the_doctor_finds_every_role_of_a_healthy_site_well(site: Path, role: str) -> None:
    """What a role is not for is denied to it, which is not wrong; of who asks nobody the login is the end."""
    findings = list(examine(ClientSettings(config_file=site / f"{role}.json5")))
    assert all(finding.well for finding in findings)
    assert any(finding.step == "key" for finding in findings) == bool(ROLES.get(role))


def test_the_doctor_knows_a_denied_key(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A role that is let in but may not ask what it is for is diagnosed at that key, and well at those it may ask."""
    monkeypatch.setitem(ROLES, "monitor", ROLES["planner"])  # after the router has its rules
    result = {finding.what: finding for finding in examine(ClientSettings(config_file=site / "monitor.json5"))}
    assert result["gpcorrect/arm1/correct"].cause == "denied key"
    assert not result["gpcorrect/arm1/correct"].well
    assert result["gpcorrect/arm1/health"].well
    assert {f"gpcorrect/arm1/admin/{key}" for key in ("activate", "state")} <= result.keys()


def examined(site: Path, tmp_path: Path, edit: Edit) -> list[Finding]:
    config = json.loads((site / "planner.json5").read_text())
    edit(config)
    file = tmp_path / "edited.json5"
    file.write_text(json.dumps(config))
    return list(examine(ClientSettings(config_file=file)))


def test_secrets_are_for_their_owner(site: Path) -> None:
    """Keys, passwords and configurations with passwords are readable by their owner alone; every password differs."""
    for path in (*site.glob("*.key"), *site.glob("*.json5"), site / "passwords.txt"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    listed = [line.split(":") for line in (site / "passwords.txt").read_text().splitlines()]
    assert len({password for _, password in listed}) == len(listed)


def test_a_site_is_not_overwritten(site: Path) -> None:
    """A folder with an authority is left alone: its certificates are in use."""
    with pytest.raises(DataError, match="already"):
        secure_site(site, Site(), NOW)
