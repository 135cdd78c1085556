"""What is said of a case: the tables of nominal.toml, and the labels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from truth.facts import (
    NOISE_DECLARED,
    controller_table,
    joint_noise_table,
    labels,
    pose_table,
    tracker_noise_table,
)
from truth.hidden import Hidden
from truth.reference import LOG_HZ

from truth_mujoco.causes import AHEAD, CATALOGUE, cause_named

if TYPE_CHECKING:
    from truth_mujoco.case import Setting


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
        known["T_tracker_base"] = pose_table(machine.T_tracker_base)
    links = {"mass": arm.mass.tolist(), "com": arm.centre.tolist(), "inertia_diagonal": arm.moment.tolist()}
    tables = {
        "controller": controller_table(plant.kp, plant.kd, plant.feedforward),
        "transmission": {"motor_inertia": arm.motor_inertia.tolist()},
        "links": links,
    }
    return joints | known | tables | noise


def _noise_table(setting: Setting) -> dict[str, Any]:
    table: dict[str, Any] = {"encoder_step": setting.machine.arm.encoder_step.tolist()}
    if setting.spec.signals != "tracker":
        table |= joint_noise_table(setting.joint_noise)
    if setting.machine.tracked:
        table |= tracker_noise_table(setting.tracker_noise)
    return table


def labels_of(setting: Setting, hidden: Sequence[Hidden], ratios: Sequence[float], seed: int) -> dict[str, Any]:
    """Return what the workflow is not told."""
    nuisance = {
        "joint_noise_rms": setting.joint_noise.rms.tolist(),
        "tracker_noise_rms": setting.tracker_noise.rms.tolist(),
        "table_errors": (setting.machine.plant.rows - setting.machine.arm.rows).tolist(),
    }
    causes = [(h, cause_named(h.name), ratio) for h, ratio in zip(hidden, ratios, strict=True)]
    return labels(setting.spec, seed, causes, CATALOGUE | AHEAD, nuisance)
