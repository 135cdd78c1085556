"""A stopwatch for docs/newcomer.md: its commands, run as they stand, from a bag to a served correction.

`serve` counts until it says that it answers. Each command starts a Python of its own, as a reader's shell does; imports
and numba's compiled code come from where the last command left them.

Run it with: python bench/newcomer.py [--section "From an unknown robot"]
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests"))
from shown import run_shown  # noqa: E402 - of the tests

PAGE = ROOT / "docs" / "newcomer.md"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--section", default="From a ROS bag", help="how the title of a section begins")
    title = parser.parse_args().section
    chosen = [text for text in re.split(r"^## ", PAGE.read_text(), flags=re.MULTILINE)[1:] if text.startswith(title)]
    if len(chosen) != 1:
        parser.error(f"{len(chosen)} sections of {PAGE.name} begin with {title!r}")
    with tempfile.TemporaryDirectory() as folder:
        ran = run_shown(chosen[0], Path(folder))
    for step in ran:
        print(f"{step.seconds:7.1f} s  {step.command.partition('  ')[0].strip()}")
    print(f"{sum(step.seconds for step in ran):7.1f} s  in all")
    return 0


if __name__ == "__main__":
    sys.exit(main())
