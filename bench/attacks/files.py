"""Files of strangers: larger unpacked than memory, linked elsewhere, forged, impossible, a full disk."""

from __future__ import annotations

import json
import resource
import zipfile
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from service_bench import free_endpoint

from attacks.lab import Lab, Scenario, Seen
from attacks.programs import accepted, ran, refused
from gpcorrect.calibration.model_store import ModelStore
from gpcorrect.logs import write_log
from gpcorrect.sim import debridement_log

BOMB = 400_000_000  # bytes that a small file unpacks to
MEMORY = 2 << 30  # bytes that a command may ask for; its libraries take half a GB
ROOM = 20_000  # bytes that a file may have on the full disk
STATES = (
    {"models": [{"id": "m", "hash": "../../secret", "kind": "pose", "added": 0}], "history": {}},
    {"models": {"a": 1}, "history": []},
    {"models": [], "history": {"pose": [[]]}},
)


def bombs(lab: Lab) -> Seen:
    """Give commands small files that unpack to 400 MB, in 2 GB of memory: a model, a table, MATLAB's numbers."""
    model, table, matlab = (lab.folder / f"bomb.{kind}" for kind in ("gpc", "parquet", "mat"))
    with zipfile.ZipFile(lab.model) as whole, zipfile.ZipFile(model, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as out:
        for name in whole.namelist():
            out.writestr(name, whole.read(name))
        with out.open("more.npy", "w") as more:
            np.lib.format.write_array(more, np.zeros(BOMB, dtype=np.uint8))
    rows = BOMB // 16
    parquet.write_table(pa.table({"time": np.zeros(rows), "measured_jp_1": np.zeros(rows)}), table)
    body = zlib.compress(bytes(BOMB), 1)
    tag = (15).to_bytes(4, "little") + len(body).to_bytes(4, "little")
    matlab.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + tag + body)
    tried = [["info", str(model)], ["fit", str(table), "-o", str(lab.folder / "t.gpc")], ["validate", str(matlab)]]
    with ThreadPoolExecutor(2) as pool:
        wrong = sum(not well for well in pool.map(lambda words: refused(words, _in_little_memory), tried))
    return Seen(
        len(tried), wrong, f"{', '.join(f'{file.stat().st_size / 1e6:.1f} MB' for file in (model, table, matlab))}"
    )


def _in_little_memory() -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))


def stores(lab: Lab) -> Seen:
    """Use stores whose state was forged, or whose lock is a link to a precious file."""
    precious, tried = lab.folder / "precious.txt", []
    precious.write_text("kept")
    for k, state in enumerate(STATES):
        folder = lab.folder / f"store{k}"
        folder.mkdir()
        (folder / "store.json").write_text(json.dumps({"schema": 1, **state}))
        tried.append(["models", "list", "--store", str(folder)])
    tried.append(["serve", "--store", str(lab.folder / "store0"), "--endpoint", free_endpoint()])
    linked = ModelStore(lab.folder / "linked").folder
    linked.mkdir(exist_ok=True)
    (linked / ".lock").symlink_to(precious)
    tried.append(["models", "add", str(lab.model), "--store", str(linked)])
    wrong = accepted(tried)
    return Seen(len(tried) + 1, wrong + (precious.read_text() != "kept"))


def full_disk(lab: Lab) -> Seen:
    """Fit where the disk has no room for the model: words, and what was there stays."""
    there = lab.folder / "full.gpc"
    there.write_bytes(b"before")
    log = _recording(lab.folder / "full.csv")
    wrong = not refused(["fit", str(log), "-o", str(there), "--method", "linear"], _with_little_room)
    litter = list(lab.folder.glob(".full*"))
    return Seen(3, wrong + (there.read_bytes() != b"before") + bool(litter))


def _with_little_room() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, ROOM))


def impossible(lab: Lab) -> Seen:
    """Look into recordings with infinite numbers, and numbers that no arm has: each is counted, and said."""
    log = debridement_log(1, reaches=10, faults=False)
    wrong, numbers = 0, (np.inf, -np.inf, 1e304)
    for k, number in enumerate(numbers):
        position = np.array(log.tracker_cp.position)
        position[5, 1] = number
        file = lab.folder / f"impossible{k}.csv"
        write_log(replace(log, tracker_cp=replace(log.tracker_cp, position=position)), file)
        _, text = ran(["validate", str(file)])
        wrong += "1 samples of tracker_cp are infinite or beyond" not in text or "Traceback" in text
    return Seen(len(numbers), wrong)


def _recording(file: Path) -> Path:
    write_log(debridement_log(1, reaches=10, faults=False), file)
    return file


SCENARIOS = (
    Scenario("small files that unpack to much", "believed, killed, or ended by a traceback", bombs),
    Scenario("forged stores, a linked lock", "believed, followed, or ended by a traceback", stores),
    Scenario("fit to a full disk", "tracebacks, litter, or a model destroyed", full_disk),
    Scenario("impossible numbers", "passed without a remark", impossible),
)
