"""Metrics over HTTP, as Prometheus reads them: of a server that `gpcorrect serve` runs in a process of its own."""

from __future__ import annotations

import json
import re
import shutil
import socket
import struct
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from prometheus_client.openmetrics.parser import text_string_to_metric_families as openmetrics_families
from prometheus_client.parser import text_string_to_metric_families
from service_support import PATIENT, ShiftCorrector, endpoint_of, free_port, wait_for
from support import ROOT

from gpcorrect.calibration import load
from gpcorrect_service import CorrectionClient, ServerSettings, ServiceError
from gpcorrect_service.ops.metrics import SILENT_SECONDS
from gpcorrect_service.server.queues import WorkerQueue
from gpcorrect_service.server.service import Server

pytestmark = pytest.mark.slow
EXAMPLES = ROOT / "examples" / "monitoring"
PROMETHEUS = "text/plain;version=0.0.4"  # what Prometheus asks for where OpenMetrics is not known


def scraped(port: int, *, path: str = "/metrics", **headers: str) -> tuple[str, str]:
    """Content type and text of the page."""
    request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", headers=headers)  # http, by hand
    with urllib.request.urlopen(request, timeout=PATIENT) as answer:
        return answer.headers["Content-Type"], answer.read().decode()


def samples_of(text: str) -> dict[Any, float]:
    families = text_string_to_metric_families(text)
    return {(s.name, *sorted(s.labels.items())): s.value for family in families for s in family.samples}


@contextmanager
def serving(model: Path, *options: object) -> Iterator[tuple[int, str, subprocess.Popen[str]]]:
    """Run `gpcorrect serve` with a metrics port, and give port, address and process once it is there."""
    port, endpoint = free_port(), endpoint_of(free_port())
    words = ["serve", model, "--endpoint", endpoint, "--metrics-port", port, *options]
    command = [sys.executable, "-m", "gpcorrect", *map(str, words)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            wait_for(lambda: process.poll() is not None or _answers(port))
            yield port, endpoint, process
        finally:
            process.terminate()
            process.communicate(timeout=PATIENT)


def _answers(port: int, path: str = "/metrics") -> bool:
    try:
        return bool(scraped(port, path=path))
    except (urllib.error.URLError, ConnectionError):
        return False


@pytest.fixture(scope="module")
def page(small_model: Path) -> str:
    """Prometheus' page after one correction."""
    query = load(small_model).check_queries[0]
    with (
        serving(small_model) as (port, endpoint, _),
        CorrectionClient(endpoint, timeout=PATIENT, connect_timeout=PATIENT) as client,
    ):
        client.correct(query[:7], query[7:])
        kind, text = scraped(port, Accept=PROMETHEUS)
        again, open_text = scraped(port, Accept="application/openmetrics-text")
    assert kind.startswith("text/plain")
    assert again.startswith("application/openmetrics-text")
    assert {f.name for f in openmetrics_families(open_text)} >= {"gpcorrect_answers", "gpcorrect_latency_seconds"}
    return text


def test_a_scrape_counts_what_was_answered(page: str) -> None:
    """Another process reads state, counts, buckets and model over HTTP; the counts are of what was asked."""
    samples = samples_of(page)
    assert samples["gpcorrect_answers_total", ("key", "correct"), ("status", "OK")] == 1
    assert samples["gpcorrect_latency_seconds_bucket", ("key", "correct"), ("le", "+Inf")] >= 1
    assert samples["gpcorrect_state", ("state", "ENABLED")] == 1
    assert any(key[0] == "gpcorrect_model" and ("arm", "arm1") in key for key in samples)


def test_other_names_paths_and_methods_are_turned_away(small_model: Path) -> None:
    """No page of another site can read it by a name of its own; there is nothing but /metrics; a port taken is said."""
    with serving(small_model) as (port, _, _):
        for path, headers in (("/metrics", {"Host": "lab.example:80"}), ("/", {})):
            with pytest.raises(urllib.error.HTTPError):
                scraped(port, path=path, **headers)
        assert "gpcorrect_state" in scraped(port, Host=f"localhost:{port}")[1]
        words = ["serve", small_model, "--endpoint", endpoint_of(free_port()), "--metrics-port", port]
        command = [sys.executable, "-m", "gpcorrect", *map(str, words)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENT, check=False)
    assert done.returncode == 2
    assert "--metrics-port" in done.stderr
    assert "Traceback" not in done.stderr


def test_silent_broken_and_foreign_connections_keep_no_scrape_out(small_model: Path) -> None:
    """With 300 connections open that say nothing, after garbage and resets, it answers, and writes no traceback."""
    garbage = (
        b"\x00" * 64 + b"\r\n\r\n",
        b"GET " + b"a" * 70_000 + b"\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01",
        b"GET / HTTP/9.9\r\n\r\n",
    )
    with serving(small_model) as (port, _, process), ExitStack() as silent:
        for _ in range(300):
            silent.enter_context(socket.create_connection(("127.0.0.1", port), PATIENT))
        files = len(list(Path(f"/proc/{process.pid}/fd").iterdir()))
        for payload in garbage:
            with socket.create_connection(("127.0.0.1", port), PATIENT) as link:
                link.sendall(payload)
                link.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # ends with a reset
        assert "gpcorrect_state" in scraped(port)[1]
        time.sleep(SILENT_SECONDS + 1.0)  # those that say nothing are closed by then
        assert "gpcorrect_state" in scraped(port)[1]
        process.terminate()
        assert "Traceback" not in process.communicate(timeout=PATIENT)[1]
    assert files < 200


def test_a_server_that_is_starting_is_not_in_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """Scrapes while keys are declared, one after the other, never find the state of a server whose worker died."""
    port, start, texts = free_port(), WorkerQueue.start, []

    def _slow_start(queue: WorkerQueue[Any]) -> None:
        texts.append(scraped(port)[1])
        start(queue)
        texts.append(scraped(port)[1])

    settings = ServerSettings(endpoint=endpoint_of(free_port()), metrics_port=port)
    server = Server(ShiftCorrector(), settings)
    monkeypatch.setattr(WorkerQueue, "start", _slow_start)
    with server:
        pass
    assert len(texts) > 4
    assert {samples_of(text)["gpcorrect_state", ("state", "FAULT")] for text in texts[1:]} == {0.0}


def expressions() -> list[str]:
    """PromQL of the dashboard, Grafana's variables filled in."""
    board = json.loads((EXAMPLES / "grafana.json").read_text())
    asked = [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    return [one.replace("$__rate_interval", "1m").replace("$instance", ".*") for one in asked]


def test_the_dashboard_asks_for_what_the_server_shows(page: str) -> None:
    """Every metric that a panel or variable of the dashboard names is on the page, with the labels it names."""
    samples = samples_of(page)
    shown = {key[0]: {label for label, _ in key[1:]} for key in samples}
    for expression in expressions():
        names = re.findall(r"gpcorrect_\w+", expression)
        assert set(names) <= set(shown), expression
        for labels in re.findall(r"by \(([\w, ]+)\)", expression):
            assert set(labels.split(", ")) <= set.union(*(shown[name] for name in names)), expression
    board = json.loads((EXAMPLES / "grafana.json").read_text())
    assert len({panel["id"] for panel in board["panels"]}) == len(board["panels"])


def promtool(*words: object, given: str | None = None) -> str:
    """Run Prometheus' own checker, or skip where it is not installed."""
    tool = shutil.which("promtool")
    if tool is None:
        pytest.skip("promtool is not installed (Debian: prometheus)")
    done = subprocess.run([tool, *map(str, words)], input=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_promtool_finds_nothing(page: str) -> None:
    """`promtool check metrics` has no remark about the page."""
    assert promtool("check", "metrics", given=page).strip() == ""


def test_promtool_takes_configuration_and_queries(tmp_path: Path) -> None:
    """The example's configuration is valid, and every panel's query is PromQL."""
    assert "SUCCESS" in promtool("check", "config", EXAMPLES / "prometheus.yml")
    rules = [{"record": f"panel:{number}", "expr": one} for number, one in enumerate(expressions())]
    (tmp_path / "rules.yml").write_text(json.dumps({"groups": [{"name": "dashboard", "rules": rules}]}))
    assert f"{len(rules)} rules found" in promtool("check", "rules", tmp_path / "rules.yml")


@contextmanager
def prometheus(port: int, folder: Path) -> Iterator[int]:
    """Run Prometheus as the example configures it, but at a metrics port, each second; give its own port."""
    program = shutil.which("prometheus")
    if program is None:
        pytest.skip("Prometheus is not installed (Debian: prometheus)")
    text = (EXAMPLES / "prometheus.yml").read_text()
    (folder / "prometheus.yml").write_text(text.replace(":9464", f":{port}").replace("interval: 10s", "interval: 1s"))
    own = free_port()
    words = ["--config.file", "prometheus.yml", "--storage.tsdb.path", "data", "--web.listen-address"]
    command = [program, *words, f"127.0.0.1:{own}"]
    with (folder / "said").open("w") as said, subprocess.Popen(command, cwd=folder, stderr=said) as process:
        try:
            wait_for(lambda: _answers(own, "/-/ready"))  # its pages answer before its queries do
            yield own
        finally:
            process.terminate()


def found(port: int, expression: str) -> list[dict[str, Any]]:
    """Series that Prometheus answers a query with; NaN, a quantile of nothing, is none."""
    _, text = scraped(port, path=f"/api/v1/query?{urllib.parse.urlencode({'query': expression})}")
    answer = json.loads(text)
    assert answer["status"] == "success", text
    return [series for series in answer["data"]["result"] if series["value"][1] != "NaN"]


def test_prometheus_scrapes_a_server(small_model: Path, tmp_path: Path) -> None:
    """Prometheus itself counts what was asked, and has an answer to the query of every panel of the dashboard."""
    query = load(small_model).check_queries[0]
    with (
        serving(small_model) as (port, endpoint, _),
        prometheus(port, tmp_path) as own,
        CorrectionClient(endpoint, timeout=PATIENT, connect_timeout=PATIENT) as client,
    ):
        asked = 'gpcorrect_answers_total{key="correct",status="%s"}'
        for status, pose in (("OK", query[:7]), ("BAD_INPUT", query[:7] * 1e3)):
            with suppress(ServiceError):
                client.correct(pose, query[7:])
            wait_for(lambda: bool(found(own, asked % status)))  # noqa: B023 - waited for here
        with suppress(ServiceError):
            client.correct(query[:7] * 1e3, query[7:])
        client.correct(query[:7], query[7:])
        wait_for(lambda: [s["value"][1] for s in found(own, asked % "OK")] == ["2"])
        wait_for(lambda: all(found(own, expression) for expression in expressions()))
        (series,) = found(own, "gpcorrect_model")
    assert series["metric"]["arm"] == "arm1"
    assert series["metric"]["instance"] == f"127.0.0.1:{port}"
