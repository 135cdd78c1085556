"""Joint calibrators on machines that MuJoCo moves: strong effects, half of them outside our catalogue, beside peers.

    python bench/joint_foreign.py [--sets wrist,ageing --ours gp,auto --splits last]

Two effects a machine, each 25 times the noise of the joint sensors, 40 motions of 10 s at 100 Hz; no code is shared
with our simulator. Peers are those of bench/joint_peers.py that fit in seconds. These machines were looked at while
the learners were mended.
"""

from __future__ import annotations

import argparse

import joint_peers
import numpy as np
from joint_peers import compare, ids_of
from support import print_table, save_results

SETS = {
    "stretch": ("raven2_left", ("hysteresis", "cable_stretch")),
    "slack": ("dvrk_psm", ("backlash", "cable_coupling")),
    "wrist": ("dvrk_psm", ("hysteresis", "backlash")),
    "creep": ("raven2_left", ("coulomb_friction", "creep")),
    "climbing": ("raven2_left", ("climbing_cable", "rubbing_cables")),
    "ageing": ("raven2_left", ("ageing_friction", "nonlinear_stretch")),
}
RATIO, TRAJECTORIES, SECONDS, SEED = 25.0, 40, 10.0, 7
QUICK = ("ridge + play", "ridge of the past", "boosted trees + play", "boosted trees of the past")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", default=",".join(SETS))
    parser.add_argument("--splits", default="last")
    parser.add_argument("--ours", default="gp")
    args = parser.parse_args()
    try:
        from truth_mujoco import Spec, make_case
    except ImportError as error:
        raise SystemExit(f"the machines need MuJoCo: pip install 'gpcorrect[mujoco]' ({error})") from error
    joint_peers.PEERS[:] = [peer for peer in joint_peers.PEERS if peer[0] in QUICK]
    results, worst = {}, []
    for name in args.sets.split(","):
        arm, hidden = SETS[name]
        case = make_case(Spec("foreign", arm, hidden, RATIO, "joints", 1, TRAJECTORIES, SECONDS), SEED)
        log, effects = case.log, ", ".join(f"{e['name']} in joint {e['joint']}" for e in case.labels["effects"])
        for split in args.splits.split(","):
            held_out = np.isin(log.trajectory, ids_of(log, split))
            rows = compare(f"{name} ({effects}), {split} fifth held out", log, held_out, args.ours.split(","))
            results[f"{name} {split}"] = rows
            worst += [[f"{name} {split}", *row] for row in rows["beside best peer"]]
    print_table(["ours / best peer of each joint", "model", "worst", "of all joints"], worst)
    save_results("joint_foreign", results)


if __name__ == "__main__":
    main()
