"""The worked example of docs/discrepancy.md, from simulated data alone: prints the verdict, and pictures its page.

python bench/discrepancy_example.py                    # into docs/images
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

from gpcorrect.discrepancy.outcome.sentences import next_step, verdict_sentences
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.report import write_discrepancy_report
from gpcorrect.sim import Model, effect_from_dict, model_from_dict
from gpcorrect.sim.joint_motion import joint_motion_log

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests"))
from chromium import browser  # noqa: E402 - of the tests

CHARTS = {"loops": "Residual against position, by direction of travel", "bars": "What", "gap": "How much"}
WIDTH = 1040  # px
NOMINAL = {
    "arm": "raven2_left",
    "joints": [1, 2, 3],
    "log_rate_hz": 50.0,
    "noise": {
        "external_jp_white": [2e-4, 2e-4, 3e-5],
        "external_jp_ar_std": [1e-4, 1e-4, 1e-5],
        "tracker_white": 1e-4,
        "tracker_rotation_white": 1e-3,
    },
}
HIDDEN = (
    {"name": "cable_stretch", "joint": 2, "stiffness": 900.0},
    {"name": "backlash", "joint": 3, "radius": 3.0e-4},
)
SEED = 7
TRAJECTORIES, SECONDS, PAYLOADS = 16, 10.0, (0.0, 0.3)


def machine() -> tuple[Model, Model]:
    """Return the model that the workflow is given, and the machine with what is hidden in it."""
    nominal = model_from_dict(NOMINAL)
    return nominal, nominal.with_effects(*(effect_from_dict(dict(values)) for values in HIDDEN))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "images", help="folder for the pictures")
    parser.add_argument("--page", type=Path, default=None, help="keep the page here")
    arguments = parser.parse_args()
    nominal, true = machine()
    log = joint_motion_log(true, TRAJECTORIES, SECONDS, SEED, payloads=PAYLOADS)
    found = find_discrepancy(nominal, log)
    print(*verdict_sentences(found))
    print("next:", next_step(found))
    with tempfile.TemporaryDirectory() as folder:
        path = arguments.page or Path(folder) / "page.html"
        write_discrepancy_report(found, path)
        picture(path, arguments.output, Path(folder))


def picture(path: Path, output: Path, folder: Path) -> None:
    """Write pictures of some charts of the page."""
    with browser(folder / "profile") as page:
        page.open(path.resolve().as_uri(), WIDTH, 800)
        page.wait_for("document.readyState == 'complete' && document.querySelectorAll('.chart svg').length > 3")
        for name, title in CHARTS.items():
            found = f"[...document.querySelectorAll('section')].find((s) => s.firstElementChild.innerText == '{title}')"
            page.picture(output / f"discrepancy_{name}.png", f"{found}.querySelector('.chart')")


if __name__ == "__main__":
    main()
