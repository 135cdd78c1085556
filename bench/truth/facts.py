"""What is said of a case: the tables of nominal.toml, and the labels."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from truth.arm import CENTRES, INERTIAS, MASSES, MOTOR_INERTIA, ROWS, THETA_OFFSET_DEG, WRIST
from truth.hidden import Hidden, plain
from truth.kinds import CATALOGUE, kind_named
from truth.loop import CONTROL_HZ, FEEDFORWARDS
from truth.machine import ENCODER_STEP
from truth.reference import LOG_HZ
from truth.setting import Setting

NOISE_DECLARED = 0.5  # share of the cases whose noise is known beforehand


def nominal_tables(setting: Setting, rng: np.random.Generator) -> dict[str, Any]:
    """Tables of nominal.toml: what a careful user would know of the machine."""
    spec, machine = setting.spec, setting.machine
    noise = _noise_table(setting) if not spec.awkward and rng.random() < NOISE_DECLARED else {}
    if spec.signals == "bare":
        return {"arm": "joints", "joints": [1, 2, 3], "joint_types": "RRP", "log_rate_hz": float(LOG_HZ)} | noise
    loop = machine.loop
    known: dict[str, Any] = {
        "arm": "raven2_left",
        "joints": [1, 2, 3],
        "wrist": list(WRIST),
        "theta_offset_deg": list(THETA_OFFSET_DEG),
        "gravity": machine.gravity.tolist(),
        "payload": 0.0,
        "log_rate_hz": float(LOG_HZ),
    }
    if spec.signals == "tracker" and setting.registered:
        T = machine.T_tracker_base
        rotvec = Rotation.from_matrix(T[:3, :3]).as_rotvec()
        known["T_tracker_base"] = {"translation": T[:3, 3].tolist(), "rotvec": rotvec.tolist()}
    return (
        known
        | {
            "controller": {
                "kp": loop.kp.tolist(),
                "kd": loop.kd.tolist(),
                "rate_hz": float(CONTROL_HZ),
                "feedback": "motor",
                "feedforward": FEEDFORWARDS[loop.feedforward],
            },
            "transmission": {"motor_inertia": MOTOR_INERTIA.tolist()},
            "links": {"mass": MASSES.tolist(), "com": CENTRES.tolist(), "inertia_diagonal": INERTIAS.tolist()},
        }
        | noise
    )


def _noise_table(setting: Setting) -> dict[str, Any]:
    if setting.spec.signals == "tracker":
        law = setting.tracker_noise
        return {
            "noise": {
                "tracker_white": float(np.sqrt(np.mean(law.white**2))),
                "tracker_ar_std": float(np.sqrt(np.mean(law.slow**2))),
            }
        }
    law = setting.joint_noise
    return {
        "noise": {
            "external_jp_white": law.white.tolist(),
            "external_jp_ar_std": law.slow.tolist(),
            "external_jp_ar_phi": law.phi,
            "encoder_step": ENCODER_STEP.tolist(),
        }
    }


def labels_of(setting: Setting, hidden: list[Hidden], ratios: list[float], seed: int) -> dict[str, Any]:
    kind = "null" if not hidden else "catalogue" if all(h.name in CATALOGUE for h in hidden) else "outside"
    noise = setting.tracker_noise if setting.spec.signals == "tracker" else setting.joint_noise
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
            "noise_rms": noise.rms.tolist(),
            "friction_law": "lugre" if setting.machine.loop.lugre else "karnopp",
            "table_errors": (setting.machine.rows - ROWS).tolist(),
        },
    }


def _joint(hidden: Hidden) -> int | str:
    where = kind_named(hidden.name).where
    return hidden.column + 1 if where == "joint" else where
