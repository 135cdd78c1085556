import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from chromium import browser
from command_line import CommandLine
from crtk_support import ShiftCorrector, living_arm, model
from vision_support import path_of, record

from gpcorrect.cli.processes import free_endpoint
from gpcorrect_service.crtk import Bus, BusSettings, Pose
from gpcorrect_service.crtk.messages import Heartbeat, View
from gpcorrect_service.crtk.prefilter import FilterServer, Prefilter
from gpcorrect_service.crtk.robot import Robot
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_studies.rendering import Stage


@contextmanager
def monitor(*endpoints: str) -> Iterator[str]:
    """Run `gpcorrect monitor` in another process and give its address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = [word for endpoint in endpoints for word in ("--endpoint", endpoint)]
    process = subprocess.Popen([sys.executable, "-m", "gpcorrect", "monitor", "--port", str(port), *words])
    try:
        yield f"http://127.0.0.1:{port}/"
    finally:
        process.terminate()
        process.wait(20)


@contextmanager
def drawing(settings: BusSettings) -> Iterator[None]:
    """Correct and command small motions until the block ends."""
    corrector, stop = ShiftCorrector(), threading.Event()
    with Bus(settings) as bus, Robot(settings) as robot:
        server = FilterServer(Prefilter(model(corrector)), bus, open_logger())
        robot.make_ready()
        begin = robot.setpoint_pose
        assert begin is not None

        def draw() -> None:
            angle = 0.0
            while not stop.wait(0.02):
                angle += 0.05
                offset = 0.002 * np.array([np.cos(angle) - 1, np.sin(angle), 0.0])
                robot.servo_cp(np.concatenate([begin[:3] + offset, begin[3:]]), "tracker")

        threads = [threading.Thread(target=server.run, args=(stop,)), threading.Thread(target=draw)]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            stop.set()
            for thread in threads:
                thread.join(10)


def test_the_page_shows_two_living_arms(tmp_path):
    """In a real browser both arms appear, the corrected one with its poses, interval, domain, latency and model."""
    with (
        browser(tmp_path / "profile") as page,
        living_arm(corrected=True, time_scale=1.0) as (first, _),
        living_arm(arm="PSM2", time_scale=1.0) as (second, _),
        drawing(first),
        monitor(first.endpoint, second.endpoint) as address,
    ):
        page.wait_for_server(address)
        page.open(address, 1240, 900)
        page.wait_for("document.querySelectorAll('.card').length == 2")
        page.wait_for("document.querySelector('#arm-arm1 [data-at=latency]').textContent.includes('ms')")
        page.wait_for("document.querySelector('#arm-arm1 [data-at=error]').textContent.includes('mm')")
        page.wait_for("document.querySelector('#arm-arm1').innerText.includes('ENABLED')")
        text = page.run("document.querySelector('#arm-arm1').innerText")
        for words in ("ENABLED", "homed", "desired", "commanded", "measured", "tracked", "± 2.00 mm", "shift", "drift"):
            assert words in text, text
        page.wait_for("document.querySelector('#arm-PSM2').innerText.includes('nothing compared: tracked')")
        assert "0 %" in page.run("document.querySelector('#arm-arm1 [data-at=outside]').textContent")
        page.wait_for("document.querySelector('#arm-PSM2').innerText.includes('DISABLED')")  # the other arm was first
        with Bus(second) as stranger:
            stranger.publish("tracker_cp", Pose(1.0, (float("nan"), 0.0)))
            page.wait_for("document.querySelector('#arm-PSM2').innerText.includes('1 unreadable')")
        assert page.run("document.querySelector('#link').textContent") == "live"
        drawn = (
            "[...document.querySelector('#arm-arm1 canvas').getContext('2d')"
            ".getImageData(0, 0, 200, 150).data].some((v) => v > 0)"
        )
        page.wait_for(drawn)
        assert page.run("document.querySelectorAll('button, input, form, a').length") == 0
        page.open(address, 390, 900)
        page.wait_for("document.querySelectorAll('.poses td').length >= 24")
        assert page.run("[...document.querySelectorAll('td, th')].every((c) => c.getBoundingClientRect().right <= 390)")
        page.picture(tmp_path / "monitor.png")
        assert (tmp_path / "monitor.png").stat().st_size > 20_000
        assert page.complaints == []


def test_the_page_shows_what_the_cameras_see(gpcorrect: CommandLine, tmp_path: Path) -> None:
    """`vision track --live` on a recording: four pictures as one, wide and narrow; what is no picture is counted."""
    views = record(tmp_path, Stage.standard(408, pieces=5), path_of(408, 3))
    words = ["vision", "track", *views, "--cameras", tmp_path / "cameras.json", "--output", tmp_path / "log.csv"]
    endpoint = free_endpoint()
    cameras = "document.querySelector('#arm-arm1 [data-at=cameras]')"
    picture = "document.querySelector('#arm-arm1 [data-at=view]')"
    with (
        Bus(BusSettings(endpoint, role="hub")) as hub,
        browser(tmp_path / "profile") as page,
        monitor(endpoint) as address,
    ):
        page.wait_for_server(address)
        page.open(address, 1240, 900)
        heartbeat = threading.Event()

        def beat() -> None:
            while not heartbeat.wait(0.1):
                hub.publish("heartbeat", Heartbeat(1.0, 30.0, 0))

        thread = threading.Thread(target=beat)
        thread.start()
        try:
            page.wait_for("document.querySelectorAll('.card').length == 1")
        finally:
            heartbeat.set()
            thread.join(10)
        assert page.run(f"{cameras}.hidden")
        outcome = gpcorrect(*words, "--live", "--endpoint", endpoint, "--no-first-look", "--json")
        assert outcome.code == 0, outcome.err
        page.wait_for(f"{picture}.naturalWidth == 960")
        assert page.run(f"{picture}.naturalHeight") == 720
        page.picture(tmp_path / "cameras.png", "document.querySelector('#arm-arm1')")
        hub.publish("view", View(1.0, b"no picture"))
        page.wait_for("document.querySelector('#arm-arm1').innerText.includes('1 unreadable')")
        page.open(address, 390, 900)
        page.wait_for(f"{picture}?.naturalWidth == 960")
        assert page.run(f"{picture}.getBoundingClientRect().right <= 390")
        page.picture(tmp_path / "narrow.png")
        assert page.complaints == []
