"""What benchmarks share: where real recordings are, where results go, and how a table is printed."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "bench" / "results"


def real_data(name: str) -> Path:
    """Path of a real recording; ends the benchmark with the reason where it is missing."""
    path = Path(os.environ.get("GPCORRECT_DATA", ROOT.parent / "shared" / "data")) / name
    if not path.exists():
        print(f"skipped: the real recording {name} is not at hand (set GPCORRECT_DATA to the folder that holds it)")
        sys.exit(0)
    return path


def print_table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    """Print rows in columns: the first left, numbers right with four digits."""
    text = [list(head), *([cell if isinstance(cell, str) else f"{cell:.4g}" for cell in row] for row in rows)]
    widths = [max(len(row[i]) for row in text) for i in range(len(head))]
    for row in text:
        first, *others = (
            cell.rjust(w) if i else cell.ljust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        print("  ".join([first, *others]))


def print_load() -> None:
    """Print how busy the machine is, which times depend on."""
    print(f"load of the machine (1 minute): {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")


def save_results(name: str, results: Any) -> None:
    """Write the results as JSON beside the others."""
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.json").write_text(json.dumps(results, indent=2, default=str))
