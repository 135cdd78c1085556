"""What a recording can show: every effect is looked for, or said to be out of sight with what is lacking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpcorrect.discrepancy.recording.build import build_scene
from gpcorrect.discrepancy.recording.commanded import with_joint_paths
from gpcorrect.discrepancy.recording.scene import Scene
from gpcorrect.discrepancy.search.candidates import all_candidates
from gpcorrect.discrepancy.search.needs import Lack, split_by_needs
from gpcorrect.sim import EFFECTS, Model, machine_of, model_from_dict
from gpcorrect.sim.effects import DhError, Effect, Family, HomingOffset, RcmShift, RegistrationError, ShaftBending
from gpcorrect.sim.joint_motion import joint_motion_log
from gpcorrect.types import CalibrationLog, FloatArray

CONTROLLER = {"kp": [400.0, 400.0, 110000.0], "kd": [22.0, 19.0, 6200.0], "feedforward": "gravity"}
NOTHING = {"setpoint_jp": None, "measured_jp": None, "measured_jv": None, "measured_jf": None, "external_jp": None}


def arm(**more: object) -> Model:
    values = {"arm": "raven2_left", "joints": [1, 2, 3], "log_rate_hz": 50.0, "controller": CONTROLLER}
    return model_from_dict(values | more)


def recorded(model: Model, *, tracker: bool, payload: float = 0.3) -> CalibrationLog:
    log = joint_motion_log(model, 4, 5.0, seed=1, payloads=(0.0, payload))
    if tracker:
        return replace(log, **NOTHING, measured_cp=None)
    return replace(log, tracker_cp=None, setpoint_cp=None, measured_cp=None)


def seen(log: CalibrationLog, model: Model) -> tuple[Scene, CalibrationLog]:
    whole, _ = with_joint_paths(log, machine_of(model).body)
    return build_scene(whole, model, np.ones(len(whole), dtype=np.bool_)), whole


def lacks(log: CalibrationLog, model: Model) -> dict[str, str]:
    scene, whole = seen(log, model)
    able, missing = split_by_needs(all_candidates(scene), scene, whole)
    looked_for = {c.name for c in able}
    noise = {n for n, k in EFFECTS.items() if k.about.family == Family.NOISE}
    lacking = {k.effect: k.why for k in missing if isinstance(k, Lack)}
    assert looked_for | noise | set(lacking) == set(EFFECTS), "neither looked for nor reported as out of sight"
    assert not looked_for & set(lacking)
    return lacking


def test_a_tracker_alone_lacks_the_encoders_only() -> None:
    """Commanded and tracked poses with a payload: all but the steps and the instants of encoders can be looked for."""
    lacking = lacks(recorded(arm(), tracker=True), arm())
    assert set(lacking) == {"encoder_quantisation", "speed_noise"}
    assert "measured_jp" in lacking["encoder_quantisation"]


def test_joint_sensors_lack_what_only_a_tracker_sees() -> None:
    """With outside joint sensors, effects at the tip and of the registration are out of sight."""
    lacking = lacks(recorded(arm(), tracker=False), arm())
    assert set(lacking) == {"registration_error", "dh_error", "shaft_bending", "rcm_shift"}


def test_without_payload_or_servo_model_their_effects_are_out_of_sight() -> None:
    """No payload: no shaft or RCM compliance. No controller: nothing that acts inside the servo loop."""
    lacking = lacks(recorded(arm(), tracker=True, payload=0.0), arm())
    assert "payload" in lacking["shaft_bending"]
    assert "payload" in lacking["rcm_shift"]
    lacking = lacks(recorded(arm(), tracker=False), arm(controller=None))
    assert "controller" in lacking["coulomb_friction"]
    assert "controller" in lacking["torque_saturation"]


def test_bare_joints_lack_an_arm() -> None:
    """Bare joints have no masses and no tip, and say that the arm should be named."""
    bare = model_from_dict({"arm": "joints", "joints": [1, 2], "joint_types": "RR", "log_rate_hz": 50.0})
    lacking = lacks(joint_motion_log(bare, 4, 5.0, seed=2), bare)
    assert "name the arm" in lacking["payload"]
    assert lacking["length_dependent_stiffness"] == "none of the model's joints slides"


def trace(effect: Effect, *, tracker: bool, payload: float = 0.3, **more: object) -> FloatArray:
    """RMS that an effect changes in each channel, m or rad."""
    model = arm(**more)
    scene = seen(recorded(model, tracker=tracker, payload=payload), model)[0].strict()
    return np.sqrt(np.nanmean((scene.predict([effect]) - scene.predict()) ** 2, axis=0))


@pytest.mark.parametrize("effect", [ShaftBending("tool", 0.5), RcmShift("base", 2000.0)])
def test_compliance_at_the_tip_shows_under_a_payload_only(effect: Effect) -> None:
    """The tip gives way under what hangs there, in the tracker; without a payload there is no trace."""
    assert trace(effect, tracker=True).max() > 1e-4
    assert trace(effect, tracker=True, payload=0.0).max() < 1e-12
    assert trace(effect, tracker=False).max() < 1e-12


def test_geometry_of_the_tip_shows_in_the_tracker() -> None:
    """A table error moves the tracked tip, also where joints are outside; a known registration shows a wrong one."""
    identity = {"T_tracker_base": {"translation": [0.0, 0.0, 0.0]}}
    error = RegistrationError("base", 2e-3, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0)
    assert trace(error, tracker=True, **identity).max() > 1e-3
    assert trace(error, tracker=True).max() < 1e-9, "a registration from the same data takes it up"
    scaled = RegistrationError("base", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02)
    assert trace(scaled, tracker=True).max() > 5e-4
    assert trace(DhError(2, 0.0, 5e-3, 0.0, 0.0), tracker=True, **identity).max() > 1e-4


def test_a_joint_error_shows_in_the_tracker_through_the_kinematics() -> None:
    """An offset of a joint moves the tracked tip by about its lever, less what the registration takes up."""
    known = trace(HomingOffset(2, 0.01), tracker=True, T_tracker_base={"translation": [0.0, 0.0, 0.0]})
    assert 2e-4 < np.linalg.norm(known) < 0.01 * 0.6


def test_a_session_of_two_motions_cannot_show_a_slip() -> None:
    """An instant with one motion after it is that motion's own oddity: slips are reported as lacking."""
    log = joint_motion_log(arm(), 2, 5.0, seed=1)
    short = replace(log, tracker_cp=None, setpoint_cp=None, measured_cp=None)
    assert "2 after the one it is in" in lacks(short, arm())["cable_slip"]
