"""The discrepancy workflow on all six joints of a real wrist and its arm, in one run: a verdict for each joint.

    python bench/discrepancy_real.py [--seed 0] [--page page.html]

Needs dvrk_random.csv ($GPCORRECT_DATA, or shared/data beside the checkout). Sizes are root mean squares of
the test set, in degrees and millimetres; seconds are of the processor.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from support import print_table, real_data

from gpcorrect.discrepancy import find_discrepancy
from gpcorrect.discrepancy.outcome.sentences import verdict_sentences
from gpcorrect.discrepancy.outcome.words import in_reader_units, number
from gpcorrect.logs import read_log
from gpcorrect.report.discrepancy_page import write_discrepancy_report
from gpcorrect.sim import model_from_dict


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of the split and of everything drawn")
    parser.add_argument("--page", type=Path, help="write the page here")
    arguments = parser.parse_args()
    model = model_from_dict({"arm": "joints", "joints": [1, 2, 3, 4, 5, 6], "joint_types": "RRPRRR"})
    start = time.process_time()
    found = find_discrepancy(model, read_log(real_data("dvrk_random.csv")), seed=arguments.seed)
    seconds = time.process_time() - start
    rows = []
    for v in found.verdict.places:
        gap, unit = v.gap, v.gap.channel.unit
        sizes = [number(in_reader_units(value, unit)[0]) for value in (gap.before, gap.after, gap.noise)]
        rows.append(
            [
                v.place,
                str(v.level),
                *sizes,
                in_reader_units(1.0, unit)[1],
                f"{v.remaining:.1f}",
                ", ".join(e.name for e in v.effects) or "-",
            ]
        )
    print_table(["joint", "verdict", "before", "after", "noise", "unit", "left / noise", "named"], rows)
    boxes = ", ".join(f"{g.channel.joint}: {100 * g.black_box_ceiling:.0f} %" for g in found.gap)
    verdict = " ".join(verdict_sentences(found))
    print(f"\na Gaussian process on the same inputs closes {boxes}\n{verdict}\n{seconds:.0f} s")
    if arguments.page is not None:
        write_discrepancy_report(found, arguments.page)


if __name__ == "__main__":
    main()
