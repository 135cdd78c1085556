"""Foreign bytes at every door: payloads to the service, damaged recordings to the readers, altered model files.

Each is to be answered with one of the service's own words, read, or refused in the project's words: no traceback, no
crash, no more than 10 s of processor time, no more than 1 GB. Everything is seeded; what fails is printed, and damaged
recordings that fail are left in the temporary folder.

Compiled code does not look whether it reads or writes beyond an array. With NUMBA_BOUNDSCHECK=1 (and an empty folder in
NUMBA_CACHE_DIR) it does, and a model file that leads it there is a fault.

    python bench/fuzz.py
    python bench/fuzz.py --long
    python bench/fuzz.py --only readers --mutations 1000 --kind mcap
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from support import save_results

PAYLOADS, MUTATIONS, FLIPS = (50_000, 1_000_000), (20, 1_000), (60, 5_000)  # in short, and with --long
FAULTS = ("traceback", "crash", "hang", "memory")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--only", choices=["payloads", "readers", "models"])
    options.add_argument(
        "--kind", default="", help="only kinds of recordings or model files whose name this regular expression finds"
    )
    options.add_argument("--model", type=Path, help="model for the payloads; without it a small one is fitted")
    options.add_argument("--long", action="store_true")
    options.add_argument("--payloads", type=int, help="another number of payloads")
    options.add_argument("--mutations", type=int, help="another number of damaged recordings of each kind")
    options.add_argument("--flips", type=int, help="another number of altered files of each kind of model")
    options.add_argument("--seed", type=int, default=0)
    chosen = options.parse_args()
    wrong = 0
    if chosen.only in (None, "readers"):
        os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # as in the process that reads; before Arrow is loaded
        from fuzzing.readers import fuzz_readers

        wrong += shown("readers", fuzz_readers(chosen.mutations or MUTATIONS[chosen.long], chosen.seed, chosen.kind))
    if chosen.only in (None, "models"):
        from fuzzing.models import fuzz_models

        wrong += shown("models", fuzz_models(chosen.flips or FLIPS[chosen.long], chosen.seed, chosen.kind))
    if chosen.only in (None, "payloads"):  # at the end: it leaves threads behind, and the others fork
        from fuzzing.payloads import fuzz_payloads

        results = fuzz_payloads(chosen.payloads or PAYLOADS[chosen.long], chosen.model)
        save_results("fuzz", results)
        wrong += results["unlawful"]
    raise SystemExit(f"{wrong} faults" if wrong else 0)


def shown(name: str, results: dict[str, Any]) -> int:
    """Save what came of each kind, and return how many trials failed."""
    save_results(f"fuzz_{name}", results)
    faults = sum(counts.get(fault, 0) for counts in results.values() for fault in FAULTS)
    print(f"{name}: {len(results)} kinds, {faults} tracebacks, crashes, hangs or requests for too much memory")
    return faults


if __name__ == "__main__":
    main()
