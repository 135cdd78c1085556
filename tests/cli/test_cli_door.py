"""The door is light: what `import gpcorrect` and the program's help load, and that the table of commands is true."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import PROGRAM, CommandLine, assert_refused

import gpcorrect as package
import gpcorrect_studies
from gpcorrect.cli.app import COMMANDS, main

LINES = {name: line for name, (_, line) in {**COMMANDS, **gpcorrect_studies.COMMANDS}.items()}
HEAVY = {
    "numpy",
    "scipy",
    "sklearn",
    "numba",
    "joblib",
    "pyarrow",
    "pydantic",
    "filterpy",
    "matplotlib",
    "cv2",
    "zenoh",
}
HELP = "import sys; from gpcorrect.cli import main; sys.argv[1:] = ['--help']"


def loaded_by(code: str) -> set[str]:
    """Return the modules that a Python process has loaded at its end."""
    code = f"{code}\nimport sys; print('loaded', *sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(("given", "expected"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "2"}, "2")])
def test_linear_algebra_has_one_thread_unless_the_user_says_otherwise(given: dict[str, str], expected: str) -> None:
    """The program's door sets the libraries below to one thread, before they are loaded; a user's setting stays."""
    code = """
import os, sys
from gpcorrect.cli import main
sys.argv[1:] = ["--version"]
try:
    main()
except SystemExit:
    print(os.environ["OPENBLAS_NUM_THREADS"])
"""
    clean = {name: value for name, value in os.environ.items() if not name.endswith("_THREADS")}
    done = subprocess.run([sys.executable, "-c", code], env=clean | given, check=True, capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == expected


def test_a_full_disk_beneath_any_file_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not only outputs are written: numba's cache on a full disk ended a first run with a traceback."""

    def _full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("gpcorrect.cli.app.app", _full)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "No space left" in capsys.readouterr().err


def test_importing_the_package_loads_no_library() -> None:
    """`import gpcorrect` loads nothing beyond the standard library."""
    assert not loaded_by("import gpcorrect") & HEAVY


def test_a_model_that_answers_loads_nothing_that_only_learning_needs(small_model: Path) -> None:
    """From file to command, as a server starts: neither scikit-learn nor statistics."""
    answer = f"from gpcorrect import load\nload({str(small_model)!r}).correct([0.1, 0, -0.1, 1, 0, 0, 0], [0.0] * 6)"
    assert not loaded_by(answer) & {"sklearn", "scipy.stats", "matplotlib"}


@pytest.mark.parametrize("absent", ["cv2", "filterpy"])
def test_what_only_vision_needs_is_an_extra(absent: str) -> None:
    """Without it all else is there, and the door to vision says what to install."""
    code = f"""
import sys
sys.modules[{absent!r}] = None
import gpcorrect.calibration, gpcorrect.cleaning, gpcorrect.discrepancy, gpcorrect.planning, gpcorrect.sim
import gpcorrect.vision
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "pip install 'gpcorrect[vision]'" in done.stderr.splitlines()[-1]


def test_the_programs_help_loads_no_library_of_the_commands() -> None:
    """`gpcorrect --help` needs the libraries of the terminal only."""
    assert not loaded_by(f"{HELP}\ntry: main()\nexcept SystemExit: pass") & HEAVY


def test_reading_a_log_needs_no_regression() -> None:
    """The door to recordings does not open the one to models; that to the search for effects opens none."""
    assert not loaded_by("import gpcorrect; gpcorrect.CalibrationLog") & {"sklearn", "numba"}
    assert not loaded_by("import gpcorrect.discrepancy") & HEAVY


@pytest.mark.parametrize("name", LINES)
def test_the_table_shows_the_first_line_of_a_commands_own_help(name: str) -> None:
    """The line of `gpcorrect --help` is the first line of `gpcorrect COMMAND --help`."""
    own = PROGRAM.command(name).help or ""
    assert " ".join(own.split("\n\n")[0].split()) == LINES[name]


def test_the_version_is_that_of_the_installed_package(gpcorrect: CommandLine) -> None:
    """`gpcorrect --version` prints the name and the version."""
    outcome = gpcorrect("--version")
    assert (outcome.code, outcome.out) == (0, f"gpcorrect {package.__version__}\n")


def test_a_command_that_is_not_there_is_refused_with_the_nearest(gpcorrect: CommandLine) -> None:
    """A typing error ends with status 2 and a suggestion."""
    outcome = gpcorrect("evaluat")
    assert outcome.code == 2
    assert "'evaluate'" in outcome.err


INTERRUPTED = """
import os, signal, sys
from gpcorrect.cli import main

class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == wanted:
            os.kill(os.getpid(), signal.SIGINT)

wanted, sys.argv = sys.argv[1], ["gpcorrect", *sys.argv[2:]]
sys.meta_path.insert(0, Interrupts())
main()
"""


@pytest.mark.parametrize(
    ("library", "words"),
    [
        ("typer", ("robot", "state")),
        ("numpy", ("robot", "state")),
        ("numba", ("sim", "serve")),
        ("zenoh", ("serve", "m.gpc")),
    ],
)
def test_ctrl_c_while_libraries_are_read_is_no_traceback(library: str, words: tuple[str, ...]) -> None:
    """An interrupt in the first seconds ends the program as a shell expects, without a traceback."""
    command = [sys.executable, "-c", INTERRUPTED, library, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "stopped\n")


def options() -> dict[str, dict[str, set[tuple[str, ...]]]]:
    """By name of an option: the commands that show it, by what they say of it."""
    found: dict[str, dict[str, set[tuple[str, ...]]]] = {}
    for path in PROGRAM.walk():
        for parameter in PROGRAM.command(*path).params:
            for name in () if getattr(parameter, "hidden", True) else parameter.opts:
                found.setdefault(name, {}).setdefault(parameter.help or "", set()).add(path)
    return found


def test_an_option_means_one_thing_in_every_command() -> None:
    """What a name stands for is the same everywhere; names that had it elsewhere are shown nowhere."""
    found = options()
    assert not {"--connect", "--page"} & set(found)
    assert len(found["--namespace"]) == len(found["--report"]) == 1
    assert all("arm" in text.lower() for text in found["--arm"])
    assert len(found["--arm"]) == 2  # on the network, and in a recording
    assert all("machine" in text.lower() for text in found["--machine"])
    assert all("address" in text.lower() for text in found["--endpoint"])


@pytest.mark.parametrize(
    ("words", "instead"),
    [
        (("fit", "x.bag", "--output", "m.gpc", "--namespace", "PSM1"), "--arm"),
        (("simulate", "reaches", "--arm", "dvrk_psm"), "--machine"),
        (("zigzag", "--output", "z.csv", "--arm", "none"), "--machine"),
        (("monitor", "--connect", "tcp/127.0.0.1:1"), "--endpoint"),
        (("debride", "--connect", "tcp/127.0.0.1:1"), "--endpoint"),
        (("vision", "calibrate", "rig.toml", "--page", "x.html"), "--report"),
    ],
)
def test_an_options_old_name_is_refused_with_the_new_one(
    gpcorrect: CommandLine, words: tuple[str, ...], instead: str
) -> None:
    """Before any work, with status 2."""
    assert_refused(gpcorrect(*words), f"{instead} instead of")
