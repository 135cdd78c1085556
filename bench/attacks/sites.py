"""A secured site: passwords of others, connections that say nothing, certificates of last year."""

from __future__ import annotations

import datetime
import json
import os
import socket
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from itertools import product
from pathlib import Path

from service_bench import PATIENT, free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import ran
from gpcorrect_service import ClientSettings, CorrectionClient, ServiceError
from gpcorrect_service.client.operator import Operator
from gpcorrect_service.ops.secure import ROLES, Site, secure_site
from gpcorrect_service.protocol.sessions import open_client

SILENT = 500
MAY = ("operator", "operator")  # certificate and password of who may change the state
AT_ONCE = 4  # strangers
ASKED, WAIT = 50, 0.1  # times and s for an answer, until a denial must be written


def strangers(lab: Lab) -> Seen:
    """Change the server's state with every certificate and every password, while connections say nothing."""
    folder = _site(lab, "site", 0)
    router, server = str(folder / "router.json5"), str(folder / "server.json5")
    port = json.loads((folder / "planner.json5").read_text())["connect"]["endpoints"][0].rsplit(":", 1)[1]
    with (
        lab.program("router", router, ready="routing") as routing,
        lab.program("serve", str(lab.model), "--config", server, "--allow-remote", ready="serving"),
        ExitStack() as silent,
    ):
        for _ in range(SILENT):
            silent.enter_context(socket.create_connection(("127.0.0.1", int(port)), PATIENT))

        def _wrong(pair: tuple[str, str]) -> int:
            file = _mixed(folder, *pair)
            if pair == MAY:
                return (not _obeyed(file)) + _logged(routing.log, *pair)
            obeyed, logged = _obeyed(file), _logged(routing.log, *pair)  # not where nobody was to be seen and asked
            return obeyed + (not (logged or _denied_outright(file, lambda: _logged(routing.log, *pair))))

        pairs = list(product(ROLES, ROLES))
        with ThreadPoolExecutor(AT_ONCE) as pool:
            wrong = sum(pool.map(_wrong, pairs))
        with CorrectionClient(config_file=folder / "planner.json5", timeout=4.0, connect_timeout=10.0) as client:
            try:
                wrong += client.health().state == "FAULT"
            except ServiceError:
                wrong += 1
    return Seen(2 * len(pairs) + 1, wrong, f"{SILENT} silent connections meanwhile")


def expired(lab: Lab) -> Seen:
    """Use a site of last year: every program must say that it expired."""
    folder = _site(lab, "old", -400)
    tried = [
        ("router", str(folder / "router.json5")),
        ("serve", str(lab.model), "--config", str(folder / "server.json5"), "--allow-remote"),
        ("prefilter", str(lab.model), "--config", str(folder / "prefilter.json5")),
        ("doctor", "--config", str(folder / "planner.json5")),
        ("robot", "state", "--config", str(folder / "operator.json5")),
        ("monitor", "--config", str(folder / "monitor.json5"), "--port", free_endpoint().rsplit(":", 1)[1]),
    ]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return Seen(len(tried), sum(not said for said in pool.map(_says_expired, tried)))


def _says_expired(words: tuple[str, ...]) -> bool:
    status, text = ran(words)
    return "expired" in text and status != 0 and "Traceback" not in text


def _site(lab: Lab, name: str, days: int) -> Path:
    port = int(free_endpoint().rsplit(":", 1)[1])
    now = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=days)
    secure_site(lab.folder / name, Site(port=port), now)
    return lab.folder / name


def _mixed(folder: Path, certificate: str, password: str) -> Path:
    config, other = (json.loads((folder / f"{role}.json5").read_text()) for role in (certificate, password))
    config["transport"]["auth"] = other["transport"]["auth"]
    file = folder / f"{certificate}_{password}.json5"
    file.write_text(json.dumps(config))
    return file


def _obeyed(file: Path) -> bool:
    with Operator(ClientSettings(config_file=file, connect_timeout=2.0), patience=4.0) as operator:
        try:
            return operator.set_state("ENABLED")[0].state == "ENABLED"
        except ServiceError:
            return False


def _denied_outright(file: Path, logged: Callable[[], bool]) -> bool:
    """Whether a question that is sent though nobody is to be seen is denied, and logged."""
    with open_client(ClientSettings(config_file=file)) as session:
        for _ in range(ASKED):
            if list(session.get("arm1/admin/state", timeout=WAIT)):
                return False
            if logged():
                return True
            time.sleep(WAIT)
    return False


def _logged(log: str, certificate: str, user: str) -> bool:
    """Whether a router's log says that who came with a certificate and a password was denied to change the state."""
    told = {"event": "denied", "certificate": certificate, "user": user, "key": "gpcorrect/arm1/admin/state"}
    lines = [json.loads(line) for line in log.splitlines() if line.startswith("{")]
    return any(told.items() <= line.items() for line in lines)


SCENARIOS = (
    Scenario(
        "certificates and passwords of others", "states changed by strangers, not logged, clients kept out", strangers
    ),
    Scenario("a site that expired", "programs that do not say so", expired),
)
