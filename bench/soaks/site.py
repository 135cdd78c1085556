"""What is soaked: replicas with one store behind a router, planners, an operator; each a process of its own."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import numpy as np
from attacks.programs import Program, SettableClock, waited
from service_bench import PATIENT, router_site

from gpcorrect.calibration import ModelStore, load
from gpcorrect_service import ClientSettings
from gpcorrect_service.client.operator import Operator
from gpcorrect_service.protocol.sessions import LIVE_KEYS, open_client

DISK_MB = 16  # of the disk that holds store and logs
BENCH = Path(__file__).resolve().parent.parent
GPCORRECT = (sys.executable, "-m", "gpcorrect")


class Site:
    """A running site; :func:`site` makes one.

    Parameters
    ----------
    folder : Path, for configurations, clocks and records
    disk : Path, holds the store and the replicas' logs; a disk of its own where it could be mounted
    models : sequence of Path, model files of one arm; the first is active
    stack : ExitStack, ends the programs
    """

    def __init__(self, folder: Path, disk: Path, models: Sequence[Path], stack: ExitStack) -> None:
        self.folder, self.disk, self._stack = folder, disk, stack
        self.store = ModelStore(disk / "store")
        self.entries = [self.store.add(path, now=float(i), name=path.stem) for i, path in enumerate(models)]
        self.store.activate(self.entries[0])
        self.router_config, self.client_config = router_site(folder)
        self.settings = ClientSettings(config_file=self.client_config, connect_timeout=PATIENT)
        self.router = self._program("router", [*GPCORRECT, "router", str(self.router_config)], folder, "routing")
        self.replicas: list[Program] = []
        self.planners: list[Program] = []

    def add_replicas(self, count: int) -> None:
        """Start replicas, and wait until all are seen."""
        words = ["serve", "--store", str(self.store.folder), "--config", str(self.client_config)]
        for i in range(count):
            self.replicas.append(self._program(f"replica{i}", [*GPCORRECT, *words], self.disk))
        waited(lambda: self.seen() == count)

    def add_planners(self, count: int, rate: float, until: float, seed: int) -> list[Path]:
        """Start planners that ask at `rate` together; return the files of their records."""
        places = np.vstack([load(self.store.path(entry)).check_queries for entry in self.entries]).tolist()
        files = []
        for i in range(count):
            files.append(self.folder / f"planner{i}.records")
            told = {
                "config": str(self.client_config),
                "poses": places,
                "file": str(files[-1]),
                "seed": [seed, i],
                "rate": rate / count,
                "until": until,
                "encoding": ("msgpack", "json")[i % 2],
            }
            command = [sys.executable, "-m", "soaks.planner", json.dumps(told)]
            self.planners.append(self._program(f"planner{i}", command, self.folder))
        return files

    def _program(self, name: str, command: list[str], logs: Path, ready: str = "") -> Program:
        clock = None if SettableClock.missing() else SettableClock(self.folder, name)
        return self._stack.enter_context(Program(command, logs / f"{name}.log", ready, clock, BENCH))

    def seen(self) -> int:
        """Return how many replicas the router knows."""
        with open_client(self.settings) as session:
            return len(list(session.liveliness().get(f"{self.settings.arm}/{LIVE_KEYS}", timeout=2.0)))

    def activate_other(self, patience: float) -> int:
        """Activate the model that is not active; return how many replicas did. Raises as :class:`Operator`."""
        other = next(entry for entry in self.entries if entry != self.store.active())
        with Operator(self.settings, patience=patience) as operator:
            return len(operator.activate(other.hash))

    @contextmanager
    def full_disk(self) -> Iterator[None]:
        """Leave no room for store and logs: fill the disk; where it is not their own, forbid replicas to write."""
        filler = self.disk / "filler"
        if self.disk.is_mount():
            with suppress(OSError), filler.open("wb", buffering=0) as file:
                while True:
                    file.write(bytes(4096))
        else:
            self._limit_files(0)
        try:
            yield
        finally:
            filler.unlink(missing_ok=True)
            self._limit_files(resource.RLIM_INFINITY)

    def _limit_files(self, size: int) -> None:
        for replica in self.replicas:
            with suppress(ProcessLookupError):
                _, hard = resource.prlimit(replica.pid, resource.RLIMIT_FSIZE)
                resource.prlimit(replica.pid, resource.RLIMIT_FSIZE, (size, hard))


@contextmanager
def site(folder: Path, models: Sequence[Path]) -> Iterator[Site]:
    """Run a site's router until the block ends, and whatever is added to it.

    Parameters
    ----------
    folder : Path, empty
    models : sequence of Path, as for :class:`Site`
    """
    disk = folder / "disk"
    disk.mkdir()
    with ExitStack() as stack:
        if os.geteuid() == 0:
            mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "soak", str(disk)]
            if subprocess.run(mount, check=False, capture_output=True).returncode == 0:
                stack.callback(subprocess.run, ["umount", "--lazy", str(disk)], check=False)
        yield Site(folder, disk, models, stack)


def seconds_until_seen(place: Site, count: int, patience: float) -> float:
    """Return after how long the router knows so many replicas; infinite when that was in vain."""
    began = time.monotonic()
    while place.seen() < count:
        if time.monotonic() > began + patience:
            return float("inf")
        time.sleep(0.1)
    return time.monotonic() - began
