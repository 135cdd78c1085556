"""The worked example of docs/discrepancy.md, from simulated data alone: prints the verdict, and draws its pictures.

python bench/discrepancy_example.py                    # into docs/images
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from gpcorrect import plots
from gpcorrect.discrepancy.outcome.sentences import next_step, verdict_sentence
from gpcorrect.discrepancy.run import find_discrepancy
from gpcorrect.report import write_discrepancy_report
from gpcorrect.sim import Model, effect_from_dict, machine_of, model_from_dict
from gpcorrect.sim.joint_motion import joint_motion_log

NOMINAL = {
    "arm": "raven2_left",
    "joints": [1, 2, 3],
    "log_rate_hz": 50.0,
    "noise": {"external_jp_white": [2e-4, 2e-4, 3e-5], "external_jp_ar_std": [1e-4, 1e-4, 1e-5]},
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
    images = Path(__file__).resolve().parents[1] / "docs" / "images"
    parser.add_argument("--output", type=Path, default=images, help="folder for the pictures")
    parser.add_argument("--page", type=Path, default=None, help="also write the page, and the report beside it")
    arguments = parser.parse_args()
    nominal, true = machine()
    log = joint_motion_log(true, TRAJECTORIES, SECONDS, SEED, payloads=PAYLOADS)
    found = find_discrepancy(nominal, log)
    print(verdict_sentence(found))
    print("next:", next_step(found))
    shown = [(i, g.channel) for i, g in enumerate(found.gap) if g.channel.name in ("external_jp_2", "external_jp_3")]
    bars = [(f"joint {e.joint}: {e.name.replace('_', ' ')}", e.alternatives) for e in found.effects]
    figures = {
        "discrepancy_loops": plots.loop_plots(found.evidence, shown, machine_of(nominal).body),
        "discrepancy_gap": plots.gap_chart(found.gap),
    }
    if bars:
        figures["discrepancy_bars"] = plots.posterior_bars(bars)
    for name, figure in figures.items():
        (arguments.output / f"{name}.png").write_bytes(plots.png(figure))
    if arguments.page:
        write_discrepancy_report(found, arguments.page)
        arguments.page.with_suffix(".json").write_text(json.dumps(found.to_report(), indent=2))


if __name__ == "__main__":
    main()
