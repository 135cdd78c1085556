"""The whole job on simulated data: record, look, fit, serve, ask, and two arms that work with the corrections.

Every step is a command that you could type yourself.

Run it with `make demo`, or: python examples/demo.py --output demo_output
"""

from __future__ import annotations

import argparse
import os
import shlex
import socket
import subprocess
import sys
import tempfile
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

GPCORRECT = [sys.executable, "-m", "gpcorrect"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="folder for everything the demo makes")
    parser.add_argument("--reaches", type=int, default=60, help="simulated debridement reaches (the paper has 303)")
    parser.add_argument("--fragments", type=int, default=2, help="fragments of each of the five sets at the end")
    arguments = parser.parse_args()
    demo(arguments.output, arguments.reaches, arguments.fragments)


def demo(folder: Path, reaches: int, fragments: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    log, model, report = folder / "reaches.csv", folder / "model.gpc", folder / "report"
    task = folder / "task.html"
    say("1. A simulated RAVEN-II reaches for foam fragments; motion capture watches, with occlusions.")
    run("simulate", "debridement", "--reaches", str(reaches), "--output", log)
    say("2. Look at the recording before using it.")
    run("validate", log)
    say("3. Clean it, register the frames, learn the rest; measure on the last fifth of the reaches.")
    run("fit", log, "--output", model, "--report", report)
    say("4. Serve the model and ask it, as a planner in another process would.")
    ask(model)
    say("5. Close the loop: two arms rehearse, learn, are served, and remove fragments, with and without correction.")
    run("debride", "--fragments", str(fragments), "--report", task)
    print(f"\nThe fit, with pictures:  {report / 'report.html'}")
    print(f"The task, with pictures: {task}")
    show(task)


def show(page: Path) -> None:
    """Open the page where there is a screen to see it on."""
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY") or sys.platform in ("darwin", "win32"):
        webbrowser.open(page.resolve().as_uri())


def ask(model: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with service(model, endpoint):
        answer = run(
            "query",
            "correct",
            "--endpoint",
            endpoint,
            *example_pose(model),
            "--twist",
            *["0.05", "0", "0", "0", "0", "0"],
        )
    assert answer


def example_pose(model: Path) -> list[str]:
    """Return a pose in the middle of the training region, from the model file itself."""
    from gpcorrect.calibration import load

    corrector = load(model)
    query = corrector.check_queries[len(corrector.check_queries) // 2]
    return ["--pose", *(f"{v:.5f}" for v in query[:7])]


@contextmanager
def service(model: Path, endpoint: str) -> Iterator[None]:
    command = [*GPCORRECT, "serve", str(model), "--endpoint", endpoint]
    print("$ " + shlex.join(["gpcorrect", *command[3:]]) + " &")
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(command, stderr=said)
        try:
            wait_for_service(process, said)
            yield
        finally:
            process.terminate()
            process.wait(timeout=10)


def wait_for_service(process: subprocess.Popen[bytes], said: TextIO) -> None:
    """Wait until the service says that it answers."""
    until = time.monotonic() + 60.0
    while "serving" not in os.pread(said.fileno(), 10_000, 0).decode():
        if process.poll() is not None or time.monotonic() > until:
            raise SystemExit("the service did not start")
        time.sleep(0.1)


def run(*words: object) -> str:
    command = [str(word) for word in words]
    print("$ " + shlex.join(["gpcorrect", *command]), flush=True)
    done = subprocess.run([*GPCORRECT, *command], check=True, stdout=subprocess.PIPE, text=True)
    print(done.stdout, flush=True)
    return done.stdout


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def say(sentence: str) -> None:
    print(f"\n{sentence}", flush=True)


if __name__ == "__main__":
    main()
