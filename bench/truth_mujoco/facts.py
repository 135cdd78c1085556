"""What is said of a case: the tables of nominal.toml, and the labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation
from truth.hidden import Hidden, plain
from truth.loop import CONTROL_HZ
from truth.reference import LOG_HZ

from truth_mujoco.causes import AHEAD, CATALOGUE, cause_named

if TYPE_CHECKING:
    from truth_mujoco.case import Setting

NOISE_DECLARED = 0.5  # share of the cases whose noise is known beforehand


def nominal_tables(setting: Setting, rng: np.random.Generator) -> dict[str, Any]:
    """Tables of nominal.toml: what a careful user would know of the machine."""
    machine, plant = setting.machine, setting.machine.plant
    arm = machine.arm
    noise = {"noise": _noise_table(setting)} if rng.random() < NOISE_DECLARED else {}
    joints: dict[str, Any] = {"arm": arm.declared, "joints": list(range(1, arm.dof + 1)), "log_rate_hz": float(LOG_HZ)}
    if arm.bare:
        return joints | {"joint_types": arm.types} | noise
    known: dict[str, Any] = {"wrist": [0.0] * (len(arm.rows) - arm.dof), "gravity": plant.gravity.tolist()}
    if arm.theta_offset_deg is not None:
        known["theta_offset_deg"] = list(arm.theta_offset_deg)
    if machine.tracked and setting.registered:
        T = machine.T_tracker_base
        rotvec = Rotation.from_matrix(T[:3, :3]).as_rotvec()
        known["T_tracker_base"] = {"translation": T[:3, 3].tolist(), "rotvec": rotvec.tolist()}
    controller = {
        "kp": plant.kp.tolist(),
        "kd": plant.kd.tolist(),
        "rate_hz": float(CONTROL_HZ),
        "feedback": "motor",
        "feedforward": plant.feedforward,
    }
    links = {"mass": arm.mass.tolist(), "com": arm.centre.tolist(), "inertia_diagonal": arm.moment.tolist()}
    tables = {
        "controller": controller,
        "transmission": {"motor_inertia": arm.motor_inertia.tolist()},
        "links": links,
    }
    return joints | known | tables | noise


def _noise_table(setting: Setting) -> dict[str, Any]:
    table: dict[str, Any] = {"encoder_step": setting.machine.arm.encoder_step.tolist()}
    if setting.spec.signals != "tracker":
        law = setting.joint_noise
        table |= {
            "external_jp_white": law.white.tolist(),
            "external_jp_ar_std": law.slow.tolist(),
            "external_jp_ar_phi": law.phi,
        }
    if setting.machine.tracked:
        law = setting.tracker_noise
        table |= {
            "tracker_white": float(np.sqrt(np.mean(law.white**2))),
            "tracker_ar_std": float(np.sqrt(np.mean(law.slow**2))),
        }
    return table


def labels_of(setting: Setting, hidden: Sequence[Hidden], ratios: Sequence[float], seed: int) -> dict[str, Any]:
    """Return what the workflow is not told."""
    known = CATALOGUE | AHEAD
    kind = "null" if not hidden else "catalogue" if all(h.name in known for h in hidden) else "outside"
    effects = [
        {"name": h.name, "joint": _joint(h), "params": plain(h.params), "ratio": ratio}
        for h, ratio in zip(hidden, ratios, strict=True)
    ]
    return {
        "kind": kind,
        "suite": setting.spec.suite,
        "seed": seed,
        "spec": plain(asdict(setting.spec)),
        "effects": effects,
        "nuisance": {
            "joint_noise_rms": setting.joint_noise.rms.tolist(),
            "tracker_noise_rms": setting.tracker_noise.rms.tolist(),
            "table_errors": (setting.machine.plant.rows - setting.machine.arm.rows).tolist(),
        },
    }


def _joint(hidden: Hidden) -> int | str:
    where = cause_named(hidden.name).where
    return hidden.column + 1 if where == "joint" else where
