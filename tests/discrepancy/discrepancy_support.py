"""A machine of bare joints with known noise, and reports made by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gpcorrect.sim import Model, model_from_dict

NOMINAL: dict[str, Any] = {
    "arm": "joints",
    "joints": [1, 2],
    "joint_types": "RR",
    "log_rate_hz": 20.0,
    "noise": {"external_jp_white": [1e-3, 1e-3], "external_jp_ar_std": [5e-4, 5e-4]},
}
NOMINAL_TOML = """
arm = "joints"
joints = [1, 2]
joint_types = "RR"
log_rate_hz = 20.0

[noise]
external_jp_white = [1e-3, 1e-3]
external_jp_ar_std = [5e-4, 5e-4]
"""
OFFSET_SPEC = """
model = "nominal.toml"
seed = 5

[motion]
trajectories = 15
seconds = 6.0

[[cases]]
[[cases.effects]]
name = "homing_offset"
joint = 2
offset = 0.02
"""


def nominal() -> Model:
    """Return two revolute joints at 20 Hz, seen from outside with 1 mrad of noise."""
    return model_from_dict(NOMINAL)


def written_spec(folder: Path, spec: str = OFFSET_SPEC) -> Path:
    """Write nominal.toml and a spec into a folder; return the spec's path."""
    (folder / "nominal.toml").write_text(NOMINAL_TOML)
    (folder / "spec.toml").write_text(spec)
    return folder / "spec.toml"


def named(name: str, joint: int | str, level: str = "EXACT", **more: Any) -> dict[str, Any]:
    """Return one entry of a verdict."""
    return {
        "name": name,
        "joint": joint,
        "class": "reversal",
        "level": level,
        "probability": 0.97,
        "parameters": {"radius": {"value": 0.01, "ci95": [0.009, 0.011], "unit": "rad"}},
        "rivals": [],
        "alternatives": [
            {"label": "nothing", "name": "", "joint": None, "class": "", "probability": 0.01},
            {"label": "unknown", "name": "", "joint": None, "class": "", "probability": 0.02},
        ],
        "nats": 120.0,
    } | more


def report(level: str, *effects: dict[str, Any], sha256: str = "abc", **more: Any) -> dict[str, Any]:
    """Return a report with these effects, in the JSON form."""
    gap = {
        "before": 0.02,
        "after": 0.002,
        "noise": 0.001,
        "unit": "rad",
        "closed": 0.992,
        "closed_ci95": [0.98, 0.995],
        "black_box_ceiling": 0.99,
        "placebo": 0.01,
        "p95": [0.04, 0.004],
        "max": [0.05, 0.006],
    }
    return {
        "verdict": {"level": level, "effects": list(effects)},
        "localisation": [],
        "gap": {"external_jp_1": gap | {"before": 0.0011, "after": 0.0011, "closed": 0.0}, "external_jp_2": gap},
        "next_experiment": None,
        "provenance": {
            "data": [{"name": "log.csv", "sha256": sha256, "rows": 100}],
            "seed": 0,
            "seconds": 12.0,
            "thresholds": {"localisation_nats": 7.0},
            "remainder": [],
            "equivalence": [{"channel": "external_jp_1", "systematic_upper": 0.1, "limit": 0.25}],
            "not_named": [],
            "noise": {},
            "no_trace": [],
            "not_nameable": [{"effect": "dh_error", "why": "the log lacks tracker_cp"}],
            "remarks": [],
        },
    } | more
