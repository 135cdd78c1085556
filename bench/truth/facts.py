"""What is said of a case: the tables of nominal.toml, and the labels."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from truth.arm import CENTRES, INERTIAS, MASSES, MOTOR_INERTIA, ROWS, THETA_OFFSET_DEG, WRIST
from truth.hidden import Array, Hidden, plain
from truth.kinds import CATALOGUE, kind_named
from truth.kinds.kind import Cause
from truth.loop import CONTROL_HZ, FEEDFORWARDS
from truth.machine import ENCODER_STEP
from truth.noise import NoiseLaw
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
        known["T_tracker_base"] = pose_table(machine.T_tracker_base)
    controller = controller_table(loop.kp, loop.kd, FEEDFORWARDS[loop.feedforward])
    tables = {
        "controller": controller,
        "transmission": {"motor_inertia": MOTOR_INERTIA.tolist()},
        "links": {"mass": MASSES.tolist(), "com": CENTRES.tolist(), "inertia_diagonal": INERTIAS.tolist()},
    }
    return known | tables | noise


def pose_table(T: Array) -> dict[str, Any]:
    """Return a rigid motion `(4, 4)` as nominal.toml has it."""
    return {"translation": T[:3, 3].tolist(), "rotvec": Rotation.from_matrix(T[:3, :3]).as_rotvec().tolist()}


def controller_table(kp: Array, kd: Array, feedforward: str) -> dict[str, Any]:
    return {
        "kp": kp.tolist(),
        "kd": kd.tolist(),
        "rate_hz": float(CONTROL_HZ),
        "feedback": "motor",
        "feedforward": feedforward,
    }


def tracker_noise_table(law: NoiseLaw) -> dict[str, Any]:
    return {
        "tracker_white": float(np.sqrt(np.mean(law.white**2))),
        "tracker_ar_std": float(np.sqrt(np.mean(law.slow**2))),
    }


def joint_noise_table(law: NoiseLaw) -> dict[str, Any]:
    return {
        "external_jp_white": law.white.tolist(),
        "external_jp_ar_std": law.slow.tolist(),
        "external_jp_ar_phi": law.phi,
    }


def _noise_table(setting: Setting) -> dict[str, Any]:
    if setting.spec.signals == "tracker":
        return {"noise": tracker_noise_table(setting.tracker_noise)}
    return {"noise": {**joint_noise_table(setting.joint_noise), "encoder_step": ENCODER_STEP.tolist()}}


def labels_of(setting: Setting, hidden: list[Hidden], ratios: list[float], seed: int) -> dict[str, Any]:
    noise = setting.tracker_noise if setting.spec.signals == "tracker" else setting.joint_noise
    nuisance = {
        "noise_rms": noise.rms.tolist(),
        "friction_law": "lugre" if setting.machine.loop.lugre else "karnopp",
        "table_errors": (setting.machine.rows - ROWS).tolist(),
    }
    causes = [(h, kind_named(h.name), ratio) for h, ratio in zip(hidden, ratios, strict=True)]
    return labels(setting.spec, seed, causes, CATALOGUE, nuisance)


def labels(
    spec: Any, seed: int, causes: list[tuple[Hidden, Cause, float]], known: Container[str], nuisance: dict[str, Any]
) -> dict[str, Any]:
    """Return what the workflow is not told; `causes` are what is hidden, its sort and its ratio."""
    return {
        "kind": "null" if not causes else "catalogue" if all(h.name in known for h, *_ in causes) else "outside",
        "suite": spec.suite,
        "seed": seed,
        "spec": plain(asdict(spec)),
        "effects": [
            {
                "name": h.name,
                "joint": h.column + 1 if cause.where == "joint" else cause.where,
                "params": plain(h.params),
                "ratio": ratio,
            }
            for h, cause, ratio in causes
        ],
        "nuisance": nuisance,
    }
