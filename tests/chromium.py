"""A real browser without a window, driven over its debugging pipe."""

from __future__ import annotations

import base64
import fcntl
import json
import os
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
PATIENT = 60.0  # s


class Page:
    """One page of a browser."""

    def __init__(self, write: int, read: int) -> None:
        self._write, self._read = write, os.fdopen(read, "rb")
        self._number = 0
        self._session: str | None = None
        self.complaints: list[str] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._call(f"{domain}.enable")

    @staticmethod
    def wait_for_server(address: str) -> None:
        """Wait until something answers HTTP at an address."""
        until = time.monotonic() + PATIENT
        while True:
            try:
                with urllib.request.urlopen(address, timeout=5):
                    return
            except (urllib.error.URLError, ConnectionError):
                assert time.monotonic() < until, f"nothing at {address}"
                time.sleep(0.1)

    def open(self, url: str, width: int, height: int) -> None:
        """Go to a page with a window of that size."""
        self._call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self._call("Page.navigate", url=url)

    def run(self, script: str) -> Any:
        """Return the value of an expression on the page."""
        answer = self._call("Runtime.evaluate", expression=script, returnByValue=True)
        return answer["result"].get("value")

    def wait_for(self, script: str) -> None:
        """Wait until an expression is true on the page."""
        until = time.monotonic() + PATIENT
        while not self.run(script):
            assert time.monotonic() < until, f"never true: {script}"
            time.sleep(0.1)

    def picture(self, path: Path, element: str = "") -> None:
        """Write what the page looks like, or the element that an expression gives."""
        clip: dict[str, Any] = {}
        if element:
            place = f"(({{x, y, width, height}}) => ({{x, y: y + scrollY, width, height}}))({element}"
            box = self.run(f"{place}.getBoundingClientRect())")
            clip = {"clip": {**box, "scale": 1}}
        data = self._call("Page.captureScreenshot", format="png", captureBeyondViewport=True, **clip)["data"]
        path.write_bytes(base64.b64decode(data))

    def _call(self, method: str, **parameters: Any) -> Any:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]
            entry = answer.get("params", {}).get("entry", {})
            if answer.get("method") == "Runtime.exceptionThrown" or entry.get("level") == "error":
                self.complaints.append(json.dumps(answer["params"]))

    def _next(self) -> Any:
        data = bytearray()
        while (byte := self._read.read(1)) not in (b"\0", b""):
            data += byte
        assert data, "the browser has gone"
        return json.loads(data)


@contextmanager
def browser(profile: Path) -> Iterator[Page]:
    """Run Chromium; skip the test where there is none."""
    program = next((p for p in map(shutil.which, NAMES) if p), None)
    if program is None:
        pytest.skip("no Chromium here to look at the page with")
    ours_in, theirs_in = os.pipe()
    theirs_out, ours_out = os.pipe()
    command = [
        program, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-extensions",
        "--hide-scrollbars", "--remote-debugging-pipe", f"--user-data-dir={profile}", "about:blank",
    ]  # fmt: skip

    # The browser reads orders from descriptor 3 and answers on 4; high numbers cannot be in the way of these.
    orders, answers = (fcntl.fcntl(fd, fcntl.F_DUPFD, 50) for fd in (theirs_out, theirs_in))
    plumb = f"import os, sys; os.dup2({orders}, 3); os.dup2({answers}, 4); os.execv(sys.argv[1], sys.argv[1:])"
    process = subprocess.Popen(
        [sys.executable, "-c", plumb, *command],
        pass_fds=(orders, answers),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    for fd in (orders, answers):
        os.close(fd)
    os.close(theirs_out)
    os.close(theirs_in)
    try:
        yield Page(ours_out, ours_in)
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
