import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from chromium import browser
from crtk_support import ShiftCorrector, living_arm, model

from gpcorrect_service.crtk import Bus, BusSettings, Pose
from gpcorrect_service.crtk.prefilter import FilterServer, Prefilter
from gpcorrect_service.crtk.robot import Robot
from gpcorrect_service.ops.logger import open_logger


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
        assert "0 %" in page.run("document.querySelector('#arm-arm1 [data-at=outside]').textContent")
        assert "DISABLED" in page.run("document.querySelector('#arm-PSM2').innerText")
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
