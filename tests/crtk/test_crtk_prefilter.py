import numpy as np
import pytest
from crtk_support import SHIFT, ShiftCorrector, model

from gpcorrect_service.crtk.keyboard import KeyControl
from gpcorrect_service.crtk.messages import OperatingState, Pose
from gpcorrect_service.crtk.prefilter import Prefilter, PrefilterSettings
from gpcorrect_service.protocol.errors import ServiceError

TURN = (1.0, 0.0, 0.0, 0.0)


def prefilter(corrector: ShiftCorrector | None = None, **settings: object) -> Prefilter:
    """Return a pre-filter before a robot that is ready at time 1."""
    known = corrector or ShiftCorrector()
    chosen = PrefilterSettings(**settings)  # type: ignore[arg-type]
    answering = Prefilter(model(known), chosen, monotonic=lambda: 0.0)
    answering.robot_is(OperatingState(1.0, "ENABLED", True, False))
    return answering


def pose(stamp: float, x: float = 0.1) -> Pose:
    return Pose(stamp, (x, 0.0, -0.1, *TURN), "tracker")


def test_commands_are_corrected_poses():
    """A desired pose comes out as the corrector's command, in the command's frame, with the report of both."""
    for answer in (prefilter().servo, prefilter().move):
        command, report = answer(pose(1.1))
        np.testing.assert_allclose(command.pose[:3], np.array([0.1, 0.0, -0.1]) + SHIFT)
        assert command.stamp == report.stamp == 1.1
        assert command.frame == "base"
        assert report.command == command.pose
        assert report.desired == pose(1.1).pose
        assert report.status == "OK"


@pytest.mark.parametrize(
    "state",
    [
        OperatingState(1.0, "DISABLED", True, False),
        OperatingState(1.0, "PAUSED", True, False),
        OperatingState(1.0, "FAULT", True, False),
        OperatingState(1.0, "ENABLED", False, False),
    ],
)
def test_a_robot_that_is_not_ready_gets_no_command(state):
    """While the robot is not ENABLED and homed nothing is passed on."""
    answering = prefilter()
    answering.robot_is(state)
    for answer in (answering.servo, answering.move):
        with pytest.raises(ServiceError, match="Enable and home"):
            answer(pose(1.1))


def test_an_old_or_unknown_state_is_not_believed():
    """Without a fresh operating state nothing is passed on."""
    corrector = ShiftCorrector()
    with pytest.raises(ServiceError, match="not known"):
        Prefilter(model(corrector)).servo(pose(1.1))
    with pytest.raises(ServiceError, match="not known"):
        prefilter(state_age=0.5).servo(pose(1.6))


@pytest.mark.parametrize("stamp", [0.0, -3.0, float("nan")])
def test_a_pose_without_a_stamp_is_refused(stamp):
    with pytest.raises(ServiceError, match="stamp"):
        prefilter().servo(pose(stamp))


def test_poses_come_once_and_in_order():
    """A stream's stamps advance; after a gap or a refusal of the robot the stream begins anew."""
    corrector = ShiftCorrector()
    answering = prefilter(corrector, gap=0.2)
    answering.servo(pose(1.1))
    for stamp in (1.1, 1.05):
        with pytest.raises(ServiceError, match="in order"):
            answering.servo(pose(stamp))
    assert corrector.resets == 1
    answering.servo(pose(1.2))
    assert corrector.resets == 1
    answering.servo(pose(1.5))
    assert corrector.resets == 2


@pytest.mark.parametrize(
    "bad", [(0.1, 0.0), (float("nan"), 0, 0, *TURN), (100.0, 0, 0, *TURN), (0.1, 0, 0, 2, 0, 0, 0)]
)
def test_a_pose_that_cannot_be_meant_is_refused(bad):
    with pytest.raises(ServiceError) as refused:
        prefilter().servo(Pose(1.1, bad))
    assert refused.value.status == "BAD_INPUT"


def test_the_correction_changes_no_faster_than_allowed():
    """When the correction jumps the command follows at the allowed speed, says LIMITED, and arrives."""
    corrector = ShiftCorrector(np.zeros(3))
    answering = prefilter(corrector, linear=0.02, state_age=100.0)
    answering.servo(pose(1.0))
    corrector.shift = np.array([0.01, 0.0, 0.0])
    moved, states = [], []
    for k in range(1, 61):
        command, report = answering.servo(pose(1.0 + 0.01 * k))
        moved.append(command.pose[0] - 0.1)
        states.append(report.status)
    steps = np.diff([0.0, *moved])
    assert steps.max() <= 0.02 * 0.01 + 1e-12
    assert moved[-1] == pytest.approx(0.01)
    assert states[0] == "LIMITED"
    assert states[-1] == "OK"


def test_the_desired_motion_itself_is_not_limited():
    """However fast the desired pose goes, a constant correction leaves it as it is."""
    answering = prefilter(linear=0.001)
    answering.servo(pose(1.0, 0.1))
    command, report = answering.servo(pose(1.01, 0.3))
    assert report.status == "OK"
    assert command.pose[0] == pytest.approx(0.3 + SHIFT[0])


def test_out_of_domain_is_flagged_or_refused():
    """A pose that the model does not know is passed on with its status, or not at all where that was asked for."""
    _, report = prefilter().servo(pose(1.1, 0.6))
    assert (report.in_domain, report.status) == (False, "EXTRAPOLATING")
    with pytest.raises(ServiceError, match="domain"):
        prefilter(outside=False).servo(pose(1.1, 0.6))


def test_keys_move_their_joints():
    """Each key moves its own joint one step up or down; plus and minus change the step; space stays; x leaves."""
    control = KeyControl(np.zeros(3), np.array([0.01, 0.02, 0.001]))
    assert control.press("w", np.zeros(3))
    assert control.press("d", np.zeros(3))
    np.testing.assert_allclose(control.target, [0.0, 0.02, -0.001])
    assert not control.press("+", np.zeros(3))
    assert control.press("q", np.zeros(3))
    np.testing.assert_allclose(control.target, [0.015, 0.02, -0.001])
    assert control.press(" ", np.ones(3))
    np.testing.assert_array_equal(control.target, np.ones(3))
    assert not control.press("y", np.zeros(3))
    assert not control.done
    control.press("x", np.zeros(3))
    assert control.done
