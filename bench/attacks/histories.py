"""What a model file says of its own making, forged under a fresh seal, is shown to people and programs."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from fuzzing.mutations import archive
from service_bench import free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import ran
from gpcorrect.calibration.model_file import read_parts, seal_of
from gpcorrect.calibration.model_store import ModelStore
from gpcorrect.errors import ArtifactError

TERMINAL = "\x1b]0;owned\x07\x1b[2J\x1b[1;31m \u202e [/red] [b]"
FORGED: tuple[dict[str, Any], ...] = (
    {
        "history.0.command": TERMINAL,
        "history.0.date": TERMINAL,
        "history.0.source": TERMINAL,
        "history.0.versions": {TERMINAL: TERMINAL},
        "summary.remarks": [TERMINAL],
        "summary.features": [TERMINAL],
    },
    {"history.0.held_out.errors.0.rmse": float("nan"), "history.0.held_out.errors.0.unit": "[/" + "x" * 100_000},
    {"history.0.held_out.errors": [], "history.0.held_out.samples": 10**30},
    {"history.0.held_out.coverage95": 10**400},
    {"history": [None]},
    {"summary.fit": "x"},
    {"summary.training_region": {"position_min": []}},
)
"""Where in the model, and what is put there."""


def histories(lab: Lab) -> Seen:
    """Show forged models with `info`, `models list` and `models diff`, and list and activate them in a server."""
    store, files, refused = ModelStore(lab.folder / "forged"), [], []
    for k, forged in enumerate(FORGED):
        header, arrays = read_parts(_measured(lab))
        for place, value in forged.items():
            node, *inner = (header["model"], *place.split("."))
            for name in inner[:-1]:
                node = node[int(name) if isinstance(node, list) else name]
            node[int(inner[-1]) if isinstance(node, list) else inner[-1]] = value
        file = lab.folder / f"history{k}.gpc"
        file.write_bytes(archive({**header, "seal": seal_of(header)}, arrays))
        try:
            store.add(file, now=float(k), name=f"{k} {TERMINAL}")
        except ArtifactError:
            refused.append(str(file))
        else:
            files.append(str(file))
    at = ("--store", str(store.folder))
    good, end = str(_measured(lab)), free_endpoint()
    tried = [("info", file) for file in (*files, refused[0])] + [("models", "diff", files[0], good)]
    with lab.program("serve", good, *at, "--endpoint", end, ready="serving") as server:
        tried += [("models", "list", *at), ("models", "list", "--endpoint", end)]
        tried += [("models", "activate", entry.hash, "--endpoint", end) for entry in store.models()[:1]]
        with ThreadPoolExecutor(2) as pool:
            wrong = sum(not well for well in pool.map(_in_words, tried))
        wrong += "Traceback" in server.log
    return Seen(len(tried) + 1, wrong, f"{len(files)} of {len(FORGED)} can be told from no real one")


def _in_words(words: tuple[str, ...]) -> bool:
    """Whether a command ends well or refuses, without a traceback and without steering the terminal."""
    status, said = ran(words)
    return status in (0, 2) and "Traceback" not in said and not set("\x1b\x07\u202e") & set(said)


def _measured(lab: Lab) -> Path:
    """Return a model whose history has held-out errors, as `gpcorrect fit` writes it."""
    path = lab.folder / "measured.gpc"
    if not path.exists():
        from gpcorrect.calibration import FitSettings, run_experiment, save
        from gpcorrect.sim import debridement_log

        settings = FitSettings(method="linear", features=("pose", "velocity"), marker="none", time_offset="none")
        save(run_experiment(debridement_log(reaches=10, faults=False), settings).corrector, path)
    return path


SCENARIOS = (Scenario("forged histories", "tracebacks, terminals steered, servers that stumble", histories),)
