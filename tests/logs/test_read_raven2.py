from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from read_support import START, Post, counted, header, write, write_bag
from scipy.spatial.transform import Rotation

from gpcorrect.errors import LogError
from gpcorrect.logs import read_log
from gpcorrect.logs.messages import RAVEN_STATE_DEFINITION, RAVEN_STATE_TYPE
from gpcorrect.types import LogMeta

N = 10
STEP = 10_000_000  # ns
RNG = np.random.default_rng(0)
GOLD, GREEN = 24, 10
JOINTS = {  # rad and m: shoulder, elbow, insertion, unused, roll, wrist, two jaws
    "left": RNG.uniform(0.1, 1.5, (N, 8)) * [1, 1, 0.3, 0, 1, 1, 1, 1],
    "right": RNG.uniform(0.1, 1.5, (N, 8)) * [1, 1, 0.3, 0, 1, 1, 1, 1],
}
POSITIONS = RNG.integers(-400_000, 400_000, (N, 2, 3))  # micrometres, by mechanism
TURNS = Rotation.random(2 * N, rng=RNG).as_matrix().reshape(N, 2, 3, 3)
OFFSET = 1500  # micrometres from measured to desired
TORQUES = RNG.normal(size=(N, 16)).astype(np.float32)


def state(k: int, **changes: Any) -> Post:
    """State message number k; changes overwrite fields."""
    degrees = np.rad2deg(np.concatenate([JOINTS["left"][k], JOINTS["right"][k]])).astype(np.float32)
    fields: dict[str, Any] = {
        "runlevel": 3,
        "sublevel": 0,
        "last_seq": k,
        "type": np.array([GOLD, GREEN], np.int32),
        "pos": POSITIONS[k].ravel().astype(np.int32),
        "ori": TURNS[k].ravel().astype(np.float32),
        "ori_d": TURNS[k].swapaxes(1, 2).ravel().astype(np.float32),
        "pos_d": (POSITIONS[k].ravel() + OFFSET).astype(np.int32),
        "tau": TORQUES[k],
        "jpos": degrees,
        "jvel": (2 * degrees).astype(np.float32),
        "jpos_d": (3 * degrees).astype(np.float32),
        "grasp_d": np.zeros(2, np.float32),
        **dict.fromkeys(("encVals", "dac_val"), np.zeros(16, np.int32)),
        **dict.fromkeys(("mpos", "mvel", "mpos_d", "encoffsets"), np.zeros(16, np.float32)),
        **dict.fromkeys(("jac_vel", "jac_f"), np.zeros(12, np.float32)),
    } | changes
    stamp = START + k * STEP

    def make(types: Any) -> Any:
        still = types["builtin_interfaces/msg/Duration"](0, 0)
        return types[RAVEN_STATE_TYPE](hdr=header(types, stamp), dt=still, **fields)

    return Post("/ravenstate", RAVEN_STATE_TYPE, stamp, make)


def record(path: Path, posts: list[Post], kind: str = "bag") -> Path:
    definition = RAVEN_STATE_DEFINITION
    if kind == "bag":
        definition = definition.replace("builtin_interfaces/Duration", "duration").replace("std_msgs/", "")
    return write_bag(path, posts, kind, [(RAVEN_STATE_TYPE, definition)])


def six(eight: np.ndarray) -> np.ndarray:
    return np.column_stack([eight[:, [0, 1, 2, 4, 5]], (eight[:, 7] - eight[:, 6]) / 2])


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
@pytest.mark.parametrize(("arm", "place"), [("left", 0), ("right", 1)])
def test_planted_states_are_read_back_in_si_units(tmp_path: Path, kind: str, arm: str, place: int):
    log = read_log(record(tmp_path / "r", [state(k) for k in range(N)], kind), arm=arm)
    np.testing.assert_allclose(log.time, np.arange(N) * STEP / 1e9)
    np.testing.assert_allclose(log.measured_cp.position, POSITIONS[:, place] * 1e-6, rtol=0, atol=1e-15)
    np.testing.assert_allclose(log.setpoint_cp.position, (POSITIONS[:, place] + OFFSET) * 1e-6, rtol=0, atol=1e-15)
    seen = Rotation.from_quat(log.measured_cp.quaternion, scalar_first=True).as_matrix()
    asked = Rotation.from_quat(log.setpoint_cp.quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(seen, TURNS[:, place], atol=1e-6)
    np.testing.assert_allclose(asked, TURNS[:, place].swapaxes(1, 2), atol=1e-6)
    joints = six(JOINTS[arm])
    np.testing.assert_allclose(log.measured_jp, joints, atol=1e-6)
    np.testing.assert_allclose(log.measured_jv, 2 * joints, atol=1e-6)
    np.testing.assert_allclose(log.setpoint_jp, 3 * joints, atol=1e-6)
    tau = TORQUES[:, 8 * place : 8 * place + 8].astype(np.float64)
    np.testing.assert_array_equal(log.measured_jf[:, :5], tau[:, [0, 1, 2, 4, 5]])
    np.testing.assert_array_equal(log.measured_jf[:, 5], tau[:, 7] - tau[:, 6])


def test_a_database_without_definitions_is_read_by_the_packages_own(tmp_path: Path):
    path = record(tmp_path / "r", [state(k) for k in range(N)], "db3")
    with closing(sqlite3.connect(path)) as database:
        database.execute("DELETE FROM message_definitions")
        database.commit()
    np.testing.assert_allclose(read_log(path, arm="left").measured_jp, six(JOINTS["left"]), atol=1e-6)


def test_poses_go_by_the_serial_number_and_joints_by_the_arm(tmp_path: Path):
    swapped = np.array([GREEN, GOLD], np.int32)
    log = read_log(record(tmp_path / "r", [state(k, type=swapped) for k in range(N)]), arm="left")
    np.testing.assert_allclose(log.measured_cp.position, POSITIONS[:, 1] * 1e-6, atol=1e-15)
    np.testing.assert_allclose(log.measured_jp, six(JOINTS["left"]), atol=1e-6)


@pytest.mark.parametrize(("types", "place"), [((77, GREEN), 0), ((GREEN, 77), 1), ((77, 78), 0)])
def test_an_unknown_serial_number_is_the_other_arm_or_taken_by_place(tmp_path: Path, types: tuple, place: int):
    posts = [state(k, type=np.array(types, np.int32)) for k in range(N)]
    log = read_log(record(tmp_path / "r", posts), arm="left")
    np.testing.assert_allclose(log.measured_cp.position, POSITIONS[:, place] * 1e-6, atol=1e-15)
    assert any("unknown serial numbers [77, 78]" in r for r in log.remarks) == (types == (77, 78))


def test_both_arms_must_be_chosen_from_and_a_lone_one_need_not(tmp_path: Path):
    with pytest.raises(LogError, match=r"both arms\. Choose --arm left or right"):
        read_log(record(tmp_path / "two", [state(k) for k in range(N)]))
    degrees = np.rad2deg(JOINTS["right"]).astype(np.float32)
    lone = [state(k, jpos=np.concatenate([np.zeros(8, np.float32), degrees[k]])) for k in range(N)]
    log = read_log(record(tmp_path / "one", lone))
    assert "read the right arm." in log.remarks
    np.testing.assert_allclose(log.measured_jp, six(JOINTS["right"]), atol=1e-6)


def test_desired_poses_that_are_copies_of_the_measured_ones_are_missing(tmp_path: Path):
    posts = []
    for k in range(N):
        same = {"pos_d": POSITIONS[k].ravel().astype(np.int32), "ori_d": TURNS[k].ravel().astype(np.float32)}
        posts.append(state(k, runlevel=2, **same) if k < 4 else state(k, **({} if k < 8 else same)))
    log = read_log(record(tmp_path / "r", posts), arm="left")
    assert np.isnan(log.setpoint_cp.position[:, 0]).tolist() == [k < 4 for k in range(N)]
    assert np.isfinite(log.measured_cp.position).all()
    assert any("4 of 10 desired poses are copies" in r for r in log.remarks)


def test_an_insertion_too_long_to_be_scaled_metres_is_millimetres(tmp_path: Path):
    posts = []
    for k in range(N):
        joints = np.rad2deg(np.concatenate([JOINTS["left"][k], JOINTS["right"][k]]))
        joints[2] = 1000 * (0.3 + 0.01 * k)
        posts.append(state(k, jpos=joints.astype(np.float32)))
    log = read_log(record(tmp_path / "r", posts), arm="left")
    np.testing.assert_allclose(log.measured_jp[:, 2], 0.3 + 0.01 * np.arange(N), atol=1e-6)
    assert any("millimetres" in r for r in log.remarks)


def test_the_log_names_the_arm_unless_its_sidecar_does(tmp_path: Path):
    bag = record(tmp_path / "r", [state(k) for k in range(N)])
    meta = LogMeta(robot="RAVEN-II", arm="raven2_right", joint_types="RRPRRR")
    assert read_log(bag, arm="right").meta == meta
    write(tmp_path / "r.toml", 'arm = "ours"\nnotes = "n"\n')
    assert read_log(bag, arm="right").meta == replace(meta, arm="ours", notes="n")
    with pytest.raises(LogError, match="expected arm 'left' or 'right', got 'middle'"):
        read_log(bag, arm="middle")


def test_efforts_are_reported_as_desired_torques(tmp_path: Path):
    log = read_log(record(tmp_path / "r", [state(k) for k in range(N)]), arm="left")
    assert any("not measured ones" in r for r in log.remarks)


def test_a_tracker_beside_the_state_gives_the_rows(tmp_path: Path):
    seen = counted("/optitrack/tool", [START + k * STEP + STEP // 2 for k in range(N - 1)])
    log = read_log(record(tmp_path / "r", [*(state(k) for k in range(N)), *seen]), arm="left")
    np.testing.assert_array_equal(log.tracker_cp.position[:, 0], np.arange(N - 1))
    middle = (POSITIONS[1:, 0] + POSITIONS[:-1, 0]) / 2e6
    np.testing.assert_allclose(log.measured_cp.position, middle, atol=1e-9)


def test_a_state_message_of_another_shape_is_refused_by_its_missing_fields(tmp_path: Path):
    short = "std_msgs/Header hdr\nint32 runlevel\nfloat32[16] jpos\n"

    def make(types: Any) -> Any:
        return types[RAVEN_STATE_TYPE](header(types, START), 3, np.zeros(16, np.float32))

    posts = [Post("/ravenstate", RAVEN_STATE_TYPE, START, make)]
    with pytest.raises(LogError, match="raven_state message lacks type, pos, ori"):
        read_log(write_bag(tmp_path / "r", posts, "mcap", [(RAVEN_STATE_TYPE, short)]))
