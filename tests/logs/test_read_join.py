from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from read_support import assert_same_log, random_log

from gpcorrect.errors import LogError
from gpcorrect.logs import join_logs
from gpcorrect.types import LogMeta, PoseSignal


def test_one_log_joined_is_itself():
    log = random_log(0)
    assert_same_log(join_logs([log]), log)


def test_rows_keep_their_order_and_values():
    logs = [random_log(k) for k in range(3)]
    joined = join_logs(logs)
    np.testing.assert_array_equal(joined.time, np.concatenate([log.time for log in logs]))
    np.testing.assert_array_equal(
        joined.tracker_cp.quaternion, np.concatenate([log.tracker_cp.quaternion for log in logs])
    )
    np.testing.assert_array_equal(
        joined.extra["grip, force"], np.concatenate([log.extra["grip, force"] for log in logs])
    )


def test_trajectories_never_merge_and_keep_their_rows():
    logs = [random_log(k) for k in range(3)]
    joined = join_logs(logs)
    assert joined.trajectory_ids.tolist() == [0, 1, 2, 3, 4, 5]
    parts = [rows for log in logs for _, rows in log.trajectories()]
    assert [len(rows) for _, rows in joined.trajectories()] == [len(rows) for rows in parts]


def test_sessions_are_each_logs_own_unless_they_mean_the_same():
    logs = [random_log(0), random_log(1)]
    assert np.unique(join_logs(logs).session).tolist() == [0, 1]
    assert np.unique(join_logs(logs, sessions="keep").session).tolist() == [3]


def test_a_signal_that_not_every_log_has_is_dropped_and_reported():
    joined = join_logs([random_log(0), replace(random_log(1), payload=None, external_jp=None, extra={})])
    assert "payload" not in joined.signals
    assert joined.extra == {}
    assert joined.remarks[0] == "signals that not every log has were dropped: external_jp, payload."


def test_positions_are_what_a_pose_and_a_position_have_in_common():
    other = random_log(1)
    joined = join_logs([random_log(0), replace(other, tracker_cp=PoseSignal(other.tracker_cp.position))])
    assert joined.tracker_cp.quaternion is None
    assert "positions only" in joined.remarks[0]


def test_what_the_logs_say_alike_stays_and_notes_are_joined():
    one, two = (
        LogMeta(robot="R", notes="a", tracker_base=(1.0,) * 6),
        LogMeta(robot="R", notes="b", arm="left"),
    )
    joined = join_logs([replace(random_log(0), meta=one), replace(random_log(1), meta=two)])
    assert joined.meta == LogMeta(robot="R", arm="left", notes="a; b")


def test_remarks_name_the_log_they_are_from():
    logs = [replace(random_log(k), name=f"log{k}", remarks=(f"remark {k}",)) for k in range(2)]
    assert join_logs(logs).remarks == ("log0: remark 0", "log1: remark 1")


def test_the_digest_is_of_all_files_in_order_or_none():
    one, two = (replace(random_log(k), digest=str(k) * 64) for k in range(2))
    assert join_logs([one, two]).digest != join_logs([two, one]).digest != ""
    assert join_logs([one, replace(two, digest="")]).digest == ""


def test_nothing_different_machines_or_different_joints_are_refused():
    with pytest.raises(LogError, match="at least one log"):
        join_logs([])
    with pytest.raises(LogError, match="robot is RAVEN-II and dVRK"):
        join_logs([random_log(0), replace(random_log(1), meta=LogMeta(robot="dVRK"))])
    with pytest.raises(LogError, match=r"different numbers of joints in setpoint_jp \(: 6, : 7\)"):
        join_logs([random_log(0), random_log(1, dof=7)])


def test_a_log_without_samples_adds_none():
    """It raised a ValueError of NumPy's."""
    log = random_log(0)
    joined = join_logs([log, replace(random_log(1).select(slice(0, 0)), contents=(), recordings=())])
    np.testing.assert_array_equal(joined.tracker_cp.table, log.tracker_cp.table)


def test_joints_are_put_in_order_by_name_with_their_types_and_other_joints_are_refused():
    one, two = (replace(random_log(k), meta=LogMeta()) for k in range(2))
    count = two.measured_jp.shape[1]
    names = tuple("abcdefgh"[:count])
    turned = np.roll(np.arange(count), 1)
    types = "R" * (count - 1) + "P"
    one = replace(one, meta=LogMeta(joint_names=names, joint_types=types))
    joints = {name: getattr(two, name)[:, turned] for name in two.JOINTS}
    own = LogMeta(joint_names=tuple(names[j] for j in turned), joint_types="".join(types[j] for j in turned))
    joined = join_logs([one, replace(two, **joints, meta=own)])
    assert joined.meta == one.meta
    assert joined.listed_joints == own.joint_names
    for name in joints:
        np.testing.assert_array_equal(getattr(joined, name)[len(one) :], getattr(two, name))
    np.testing.assert_array_equal(join_logs([one, two]).measured_jp[len(one) :], two.measured_jp)  # no names: as before
    with pytest.raises(LogError, match=r"the joints are z, .* and those that they go with a, "):
        join_logs([one, replace(two, meta=LogMeta(joint_names=("z", *names[1:])))])
    with pytest.raises(LogError, match="columns cannot be put in that order"):
        join_logs([one, replace(two, measured_jp=two.measured_jp[:, 1:], meta=own)])
    with pytest.raises(LogError, match="twice"):
        LogMeta(joint_names=("a", "a"))
