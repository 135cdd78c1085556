"""Settings are checked once, and the files in service/deploy say what the built-in defaults say."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from service_support import endpoint_of, free_port

from gpcorrect.errors import DataError, GpCorrectError
from gpcorrect_service import ClientSettings, CorrectionClient, EndpointError, ServerSettings
from gpcorrect_service.crtk import BusSettings, in_namespace
from gpcorrect_service.protocol.sessions import client_config, read_config, server_config
from gpcorrect_service.server.service import Server

DEPLOY = Path(__file__).resolve().parents[2] / "service" / "deploy" / "single_host"


def test_a_missing_library_is_named() -> None:
    """Without zenoh the import says which extra brings it."""
    program = "import sys; sys.modules['zenoh'] = None; import gpcorrect_service"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert "MissingExtraError" in done.stderr
    assert "gpcorrect[service]" in done.stderr


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "[::1]", "127.8.9.1"])
def test_loopback_needs_no_leave(host: str) -> None:
    """An address that only this machine reaches is accepted."""
    assert ServerSettings(endpoint=f"tcp/{host}:7447").endpoint == f"tcp/{host}:7447"


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.5", "[::]", "robot.example"])
def test_remote_needs_leave(host: str) -> None:
    """An address that others reach is refused unless asked for."""
    endpoint = f"tcp/{host}:7447"
    with pytest.raises(EndpointError, match="other machines"):
        ServerSettings(endpoint=endpoint)
    assert ServerSettings(endpoint=endpoint, allow_remote=True).endpoint == endpoint


@pytest.mark.parametrize("endpoint", ["", "7447", "127.0.0.1:7447", "tcp/127.0.0.1", "tcp/127.0.0.1:99999", "tcp/:1"])
def test_malformed_endpoint(endpoint: str) -> None:
    """What is not protocol/host:port is refused by server and client alike, and the form is shown."""
    with pytest.raises(EndpointError, match="protocol/host:port"):
        ServerSettings(endpoint=endpoint)
    with pytest.raises(EndpointError, match="protocol/host:port"):
        CorrectionClient(endpoint)


@given(name=st.text(max_size=8))
def test_names_are_literal_key_chunks(name: str) -> None:
    """A name is accepted exactly when it is made of letters, digits, dot, underscore and hyphen."""
    allowed = bool(name) and all(c.isascii() and (c.isalnum() or c in "._-") for c in name)
    if allowed:
        assert ServerSettings(arm=name).arm == name
    else:
        with pytest.raises(DataError, match="part of a key"):
            ServerSettings(arm=name)


@pytest.mark.parametrize("change", [{"queue_capacity": 0}, {"drain_seconds": -1.0}])
def test_bounds_of_server_settings(change: dict[str, float]) -> None:
    """A server without a worker or a queue is refused."""
    with pytest.raises(DataError, match="at least"):
        replace(ServerSettings(), **change)


@pytest.mark.parametrize("options", [{"timeout": 0.0}, {"encoding": "xml"}, {"on_failure": "ignore"}])
def test_bounds_of_client_settings(options: dict[str, object]) -> None:
    """A client with no time, an unknown encoding or an unknown fallback is refused."""
    with pytest.raises(DataError):
        CorrectionClient(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize("key", ["scouting/multicast/enabled", "scouting/gossip/enabled"])
def test_nobody_is_scouted(key: str) -> None:
    """By default neither side looks for others, and messages are small."""
    for config in (server_config(ServerSettings()), client_config(ClientSettings())):
        assert json.loads(config.get_json(key)) is False
        assert json.loads(config.get_json("transport/link/rx/max_message_size")) <= 4 * 2**20


def test_deploy_files_say_what_the_defaults_say() -> None:
    """The ready configurations equal the built-in ones, value by value."""
    server = server_config(ServerSettings(config_file=DEPLOY / "server.json5"))
    client = client_config(ClientSettings(config_file=DEPLOY / "client.json5"))
    assert json.loads(str(server)) == json.loads(str(server_config(ServerSettings())))
    assert json.loads(str(client)) == json.loads(str(client_config(ClientSettings())))


def test_the_routed_files_say_what_the_defaults_say() -> None:
    """A member behind a router is the built-in client in mode client; the router has the same bounds on messages."""
    folder = DEPLOY.parent / "router"
    member = json.loads(str(client_config(ClientSettings(config_file=folder / "member.json5"))))
    client = json.loads(str(client_config(ClientSettings())))
    assert member == {**client, "mode": "client"}
    router = read_config(folder / "router.json5")
    for key in ("transport/link", "scouting/multicast/enabled", "scouting/gossip/enabled"):
        assert json.loads(router.get_json(key)) == json.loads(client_config(ClientSettings()).get_json(key))


def test_config_file_namespace_wins_and_address_is_checked(tmp_path: Path) -> None:
    """A configuration's own namespace is honoured, and its address is held to the same rule as a setting."""
    path = tmp_path / "mine.json5"
    path.write_text('{mode: "peer", namespace: "lab2", listen: {endpoints: ["tcp/0.0.0.0:7447"]}}')
    with pytest.raises(EndpointError, match="other machines"):
        server_config(ServerSettings(config_file=path))
    config = server_config(ServerSettings(config_file=path, allow_remote=True))
    assert json.loads(config.get_json("namespace")) == "lab2"


def test_two_places_at_once_are_refused(tmp_path: Path) -> None:
    """An address, or a namespace, beside a configuration that names another would be passed over without a word."""
    path, other = tmp_path / "mine.json5", "tcp/127.0.0.1:9999"
    path.write_text('{mode: "client", namespace: "lab2"}')
    for asked in (
        lambda: ServerSettings(endpoint=other, config_file=path),
        lambda: ClientSettings((other,), config_file=path),
        lambda: BusSettings(other, config_file=path),
        lambda: client_config(ClientSettings(namespace="lab1", config_file=path)),
        lambda: in_namespace(BusSettings(namespace="lab1", config_file=path)),
    ):
        with pytest.raises(DataError, match=r"both say where|of namespace 'lab2'"):
            asked()
    assert in_namespace(BusSettings(namespace="lab2", config_file=path)).namespace == "lab2"


def test_a_unix_socket_stays_at_home(tmp_path: Path) -> None:
    """A configuration that listens on a Unix socket needs no leave."""
    path = tmp_path / "socket.json5"
    path.write_text('{mode: "peer", listen: {endpoints: ["unixsock-stream//run/gpcorrect.sock"]}}')
    assert json.loads(server_config(ServerSettings(config_file=path)).get_json("namespace")) == "gpcorrect"


def test_config_file_without_address_is_remote(tmp_path: Path) -> None:
    """A configuration that names no address would listen everywhere, and is refused."""
    path = tmp_path / "empty.json5"
    path.write_text("{}")
    with pytest.raises(EndpointError, match="other machines"):
        server_config(ServerSettings(config_file=path))


def test_unreadable_config_file(tmp_path: Path) -> None:
    """A missing or broken configuration is one clear error."""
    broken = tmp_path / "broken.json5"
    broken.write_text("{mode: ")
    for path in (broken, tmp_path / "missing.json5"):
        with pytest.raises(DataError, match="cannot be read"):
            server_config(ServerSettings(config_file=path))


def test_busy_port_is_a_clear_error() -> None:
    """A second server on the same address is refused with the address and what to do; the first goes on."""
    settings = ServerSettings(endpoint=endpoint_of(free_port()))
    with Server(None, settings), pytest.raises(EndpointError, match="cannot listen here") as caught:
        Server(None, settings).start()
    assert caught.value.endpoint == settings.endpoint
    assert isinstance(caught.value, GpCorrectError)
    assert "another endpoint" in caught.value.hint
