"""Poses at 1 kHz that an arm follows badly or not at all, streamed at models that answer through its joints.

Real: the dVRK of `dvrk_random.csv`. Simulated: 30 reaches of a RAVEN-II. Each is asked 24,000 poses in streams: slow
motion, postures near singularities, jumps, out of reach and back, turned round, a joint by a whole turn, white noise.
Printed is how they were answered, and what must not be: corrections above the bound, missing numbers, answers called
good that change by more than the desired pose does and 0.5 mm or 0.5 degrees within a millisecond.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from attacks.reaching import STEP, hostile, wrong_in
from support import print_table, real_data, save_results

from gpcorrect.calibration import FitSettings, fit_model
from gpcorrect.logs import read_log
from gpcorrect.sim import random_reaches_log

SETTINGS = FitSettings(features=("pose", "velocity", "joints"), inducing=200, search_samples=200)
HEAD = ("arm", "poses", "OK", "LIMITED", "EXTRAPOLATING", "above the bound", "missing", "jumps")


def main() -> None:
    rows = []
    for name, log in (
        ("dVRK, real", read_log(real_data("dvrk_random.csv"))),
        ("RAVEN-II, simulated", random_reaches_log("raven2_left", 30, 0)),
    ):
        model, found, wrong = fit_model(log, SETTINGS).corrector, Counter[str](), Counter[str]()
        for poses in hostile(model, np.random.default_rng(0)):
            stream = model.stream()
            answers = [stream.correct(STEP * k, pose) for k, pose in enumerate(poses)]
            position, quaternion = (
                np.array([getattr(a, part) for a in answers]) for part in ("position", "quaternion")
            )
            wrong.update(wrong_in(model, poses, position, quaternion, np.array([bool(a.in_domain) for a in answers])))
            found.update(str(answer.status) for answer in answers)
        rows.append([name, str(found.total()), *(str((found + wrong)[what]) for what in HEAD[2:])])
        print(f"{name}: {dict(found)}, {dict(wrong)}", flush=True)
    print_table(HEAD, rows)
    save_results("route_walks", rows)


if __name__ == "__main__":
    main()
