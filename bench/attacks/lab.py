"""What every scenario works with: a folder, two small models, processes that end with it, and the shape of a result."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from service_bench import free_endpoint

from attacks.programs import Program
from gpcorrect.errors import GpCorrectError


@dataclass(frozen=True)
class Seen:
    """What happened.

    Parameters
    ----------
    tried : int
        How many things could have gone wrong; 0 says that the scenario did not come about, and counts as broken.
    broken : int, how many did
    note : str, further figures
    """

    tried: int
    broken: int
    note: str = ""


@dataclass(frozen=True)
class Scenario:
    """One attack.

    Parameters
    ----------
    name : str, of the attack
    promised : str, what must not happen, in words; the table counts it
    run : callable, from the laboratory to what was seen
    """

    name: str
    promised: str
    run: Callable[[Lab], Seen]


class Lab:
    """A folder, models, and processes of the program itself; a context manager.

    Parameters
    ----------
    folder : Path, empty
    model : Path or None, a model file of poses; one is fitted to simulated reaches without it
    """

    def __init__(self, folder: Path, model: Path | None = None) -> None:
        self.folder = folder
        self._given = model
        self._stack = ExitStack()

    @cached_property
    def model(self) -> Path:
        """A model file of poses."""
        return self._given or fitted(self.folder / "monday.gpc", reaches=4)

    @cached_property
    def other_model(self) -> Path:
        """Another one, of the same arm and frames, that answers differently."""
        return fitted(self.folder / "tuesday.gpc", reaches=5)

    @cached_property
    def joint_model(self) -> Path:
        """A model file of joints."""
        from gpcorrect.calibration import FitSettings, JointCorrector, fit_model, save
        from gpcorrect.sim import joint_motion_log, preset

        path = self.folder / "joints.gpc"
        log = joint_motion_log(preset("raven2_calibration"), 6, 10.0)
        save(fit_model(log, FitSettings(method="linear", time_offset="none"), task=JointCorrector).corrector, path)
        return path

    @cached_property
    def jointed_model(self) -> Path:
        """A model file of poses that are answered through the joints of a simulated dVRK."""
        from gpcorrect.calibration import FitSettings, fit_model, save
        from gpcorrect.sim import random_reaches_log

        path, features = self.folder / "jointed.gpc", ("pose", "velocity", "joints")
        settings = FitSettings(
            features=features, clean=False, inducing=60, marker="none", time_offset="none", search_samples=100
        )
        save(fit_model(random_reaches_log("dvrk_psm", 16, 0, faults=False), settings).corrector, path)
        return path

    def program(self, *words: str, ready: str) -> Program:
        """Run `gpcorrect WORDS` until the block ends, however that process was stopped meanwhile.

        Parameters
        ----------
        *words : str, command and options
        ready : str, text on its standard error by which it is known to answer
        """
        log = self.folder / f"{words[0]}-{time.monotonic_ns()}.log"
        return Program([sys.executable, "-m", "gpcorrect", *words], log, ready)

    @contextmanager
    def server(self, model: Path, *words: str) -> Iterator[tuple[str, int]]:
        """Serve a model; gives its address and process number.

        Parameters
        ----------
        model : Path
        *words : str, further options
        """
        end = free_endpoint()
        with self.program("serve", str(model), "--endpoint", end, *words, ready="serving") as process:
            yield end, process.pid

    @contextmanager
    def arm(self, *words: str) -> Iterator[tuple[str, int]]:
        """Run a simulated arm, enabled and homed; gives its address and process number.

        Parameters
        ----------
        *words : str, further options
        """
        end = free_endpoint()
        with self.program("sim", "serve", "--endpoint", end, "--ready", *words, ready="Ctrl-C") as process:
            yield end, process.pid


def refuses(call: Callable[[], object], kind: type[GpCorrectError] = GpCorrectError) -> bool:
    """Whether a call raises an error of this kind."""
    try:
        call()
    except kind:
        return True
    return False


def fitted(path: Path, reaches: int) -> Path:
    from gpcorrect.calibration import FitSettings, fit_corrector, save
    from gpcorrect.sim import debridement_log

    settings = FitSettings(
        features=("pose", "velocity"), clean=False, inducing=20, marker="none", time_offset="none", search_samples=60
    )
    save(fit_corrector(debridement_log(reaches=reaches), settings), path)
    return path
