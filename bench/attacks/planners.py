"""One planner among others: what it asks must not stop those that ask well."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from service_bench import PATIENT

from attacks.lab import Lab, Scenario, Seen
from gpcorrect.calibration import load
from gpcorrect_service import CorrectionClient, ServiceError

FAR = 4.9999  # m: just within what is believed
DIRECTIONS = 60


def far_poses(lab: Lab) -> Seen:
    """Ask poses at the edge of what is believed, in all directions, and after each a good one."""
    rng = np.random.default_rng(0)
    good = load(lab.model).check_queries[0, :7]
    refused, blamed = 0, 0
    with (
        lab.server(lab.model) as (end, _),
        CorrectionClient(end, timeout=2.0, connect_timeout=PATIENT) as bad,
        CorrectionClient(end, timeout=2.0, connect_timeout=PATIENT) as well,
    ):
        for _ in range(DIRECTIONS):
            way = rng.standard_normal(3)
            try:
                bad.correct([*(FAR * way / np.linalg.norm(way)), 1.0, 0.0, 0.0, 0.0])
            except ServiceError as error:
                blamed += error.status == "INTERNAL"
        for _ in range(DIRECTIONS):
            with suppress(ServiceError):
                well.correct(good)
                continue
            refused += 1
        state = well.health().state
    return Seen(DIRECTIONS, refused + blamed, f"{blamed} blamed on the model, {refused} others refused, state {state}")


SCENARIOS = (Scenario("poses at 4.9999 m", "faults of the model, others refused", far_poses),)
