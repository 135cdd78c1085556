"""Three ways through the house: which files a recording or a pose passes, in order, and how often the way turns back.

A call from a file of a lower layer into one of a higher (pyproject.toml, import contracts) turns back: a progress
bar, a callback, a registered function. Calls within a layer, and calls while modules are imported, are not counted.

    python bench/walks.py                 # all three
    python bench/walks.py service --calls # with the calls that turn back
"""

from __future__ import annotations

import argparse
import socket
import sys
import tempfile
import threading
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

from discrepancy_example import machine

ROOT = Path(__file__).resolve().parents[1]
HOMES = ((ROOT / "gpcorrect", "gpcorrect"), (ROOT / "service" / "gpcorrect_service", "gpcorrect_service"))
LOADING = "<module>"


class Walk:
    """Files in the order of their first call, and calls from file to file, of everything called while it is on."""

    def __init__(self) -> None:
        self.files: list[str] = []
        self.calls: dict[tuple[str, str], str] = {}
        self._places: dict[CodeType, str | None] = {}

    def clear(self) -> None:
        """Forget what was walked."""
        self.files.clear()
        self.calls.clear()

    def __enter__(self) -> Walk:
        threading.setprofile(self.see)
        sys.setprofile(self.see)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)
        threading.setprofile(None)

    def see(self, frame: FrameType, event: str, _: Any) -> None:
        """Note a call; the function that the interpreter calls (`sys.setprofile`)."""
        if event != "call":
            return
        place = self._place(frame.f_code)
        if place is None or frame.f_code.co_name == LOADING:
            return
        caller = frame.f_back
        while caller is not None and self._place(caller.f_code) is None:
            caller = caller.f_back
        source = None if caller is None else self._place(caller.f_code)
        if source == place or (source, place) in self.calls or _loading(frame):
            return
        if place not in self.files:
            self.files.append(place)
        if source is not None:
            self.calls[source, place] = frame.f_code.co_qualname

    def _place(self, code: CodeType) -> str | None:
        if code not in self._places:
            path = Path(code.co_filename)
            names = [f"{name}/{path.relative_to(home)}" for home, name in HOMES if path.is_relative_to(home)]
            self._places[code] = names[0] if names else None
        return self._places[code]


def _loading(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_name == LOADING and "importlib" in (frame.f_back.f_code.co_filename if frame.f_back else ""):
            return True
        frame = frame.f_back
    return False


def fit(folder: Path) -> Walk:
    """Take a recording of 60 reaches through `gpcorrect fit`."""
    from gpcorrect.cli import main as program

    log = folder / "log.csv"
    command(program, "simulate", "debridement", "--reaches", "60", "--output", log)
    with Walk() as walk:
        command(program, "fit", log, "--output", folder / "model.gpc")
    return walk


def service(folder: Path) -> Walk:
    """Take a pose through client and server, both in this process; the model has answered once before."""
    from gpcorrect.calibration import load
    from gpcorrect_service import CorrectionClient, ServerSettings
    from gpcorrect_service.server.service import serve

    fit(folder)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    pose = load(folder / "model.gpc").check_queries[0][:7]
    stop, ready, walk = threading.Event(), threading.Event(), Walk()
    threading.setprofile(walk.see)  # the server's workers are born with it
    server = threading.Thread(
        target=serve,
        args=(folder / "model.gpc", ServerSettings(endpoint=endpoint), stop, lambda _: ready.set()),
    )
    server.start()
    ready.wait(60)
    with CorrectionClient(endpoint, timeout=10.0, connect_timeout=10.0) as client:
        client.correct(pose)
        walk.clear()
        with walk:
            client.correct(pose)
    stop.set()
    server.join()
    return walk


def discrepancy(folder: Path) -> Walk:
    """Take a recording with two hidden effects through `gpcorrect discrepancy run`."""
    from gpcorrect.cli import main as program
    from gpcorrect.logs import write_log
    from gpcorrect.sim import write_model
    from gpcorrect.sim.joint_motion import joint_motion_log

    nominal, true = machine()
    write_log(joint_motion_log(true, 16, 10.0, 7, payloads=(0.0, 0.3)), folder / "log.csv")
    write_model(nominal, folder / "model.toml")
    with Walk() as walk:
        command(
            program, "discrepancy", "run", "--model", folder / "model.toml", "--log", folder / "log.csv",
            "--output", folder / "out",
        )  # fmt: skip
    return walk


def command(program: Callable[[], None], *words: object) -> None:
    """Run a command of the program in this process."""
    sys.argv = ["gpcorrect", *map(str, words)]
    try:
        program()
    except SystemExit as ended:
        if ended.code:
            raise


def layers() -> list[list[str]]:
    """Return the layers, lowest last: of the packages, and of the rooms inside those that have contracts."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    rows = next(c["layers"] for c in contracts if c["type"] == "layers" and not c["containers"])
    return [[name.strip() for name in row.split("|")] for row in rows]


def depth(file: str, rows: list[list[str]]) -> int:
    """Return how low a file's layer is; a file that no layer names is among the lowest."""
    module = file.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    named = [k for k, row in enumerate(rows) if any(module == name or module.startswith(f"{name}.") for name in row)]
    return named[0] if named else len(rows)


def show(name: str, walk: Walk, calls: bool) -> None:
    """Print a walk."""
    rows = layers()
    back = {pair: what for pair, what in walk.calls.items() if depth(pair[1], rows) < depth(pair[0], rows)}
    packages: dict[str, list[str]] = {}
    for file in walk.files:
        key = "/".join(file.split("/")[:2]) if file.count("/") > 1 else file.split("/")[0]
        packages.setdefault(key, []).append(file.removeprefix(f"{key}/"))
    print(f"\n{name}: {len(walk.files)} files, {len(walk.calls)} ways from file to file, {len(back)} of them turn back")
    for key, files in packages.items():
        print(f"  {key}: {', '.join(files)}")
    if calls:
        for (source, target), what in back.items():
            print(f"  back: {source} -> {target}: {what}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = ["fit", "service", "discrepancy"]
    parser.add_argument("walks", nargs="*", choices=[*names, "all"], default="all", help="which; all without it")
    parser.add_argument("--calls", action="store_true", help="name the calls that turn back")
    arguments = parser.parse_args()
    for walk in (fit, service, discrepancy):
        if "all" in arguments.walks or walk.__name__ in arguments.walks:
            with tempfile.TemporaryDirectory() as folder:
                show(walk.__name__, walk(Path(folder)), arguments.calls)


if __name__ == "__main__":
    main()
