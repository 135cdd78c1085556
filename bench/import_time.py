"""Processor time of `import gpcorrect` and of the command line's help, beside `import numpy` in the same run.

Run it with: python bench/import_time.py --runs 9
"""

from __future__ import annotations

import argparse
import resource
import statistics
import subprocess
import sys

PROGRAM = "import sys; from gpcorrect.cli import main; sys.argv[1:] = {}; main()"
CASES = {
    "python": "pass",
    "import numpy": "import numpy",
    "import gpcorrect": "import gpcorrect",
    "gpcorrect --version": PROGRAM.format(["--version"]),
    "gpcorrect --help": PROGRAM.format(["--help"]),
    "gpcorrect fit --help": PROGRAM.format(["fit", "--help"]),
    "gpcorrect discrepancy --help": PROGRAM.format(["discrepancy", "--help"]),
    "gpcorrect.read_log": "import gpcorrect; gpcorrect.read_log",
    "gpcorrect.fit_corrector": "import gpcorrect; gpcorrect.fit_corrector",
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=9, help="processes a case; the median is printed")
    runs = parser.parse_args().runs
    times: dict[str, list[float]] = {name: [] for name in CASES}
    for _ in range(runs):  # case after case, so that the machine's other work meets all of them alike
        for name, code in CASES.items():
            times[name].append(processor_seconds(code))
    numpy = statistics.median(times["import numpy"])
    print(f"{'':29} {'ms (user + system)':>18} {'of numpy':>9}")
    for name, seconds in times.items():
        median = statistics.median(seconds)
        print(f"{name:29} {1e3 * median:18.0f} {median / numpy:9.2f}")


def processor_seconds(code: str) -> float:
    """Return the user and system time (s) of a Python process that runs `code`."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
