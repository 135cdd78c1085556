import io
import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest
from crtk_support import SHIFT, ShiftCorrector, model

from gpcorrect_service.crtk.messages import OperatingState, Pose
from gpcorrect_service.crtk.prefilter import WAITING, FilterServer, Prefilter, PrefilterSettings
from gpcorrect_service.ops.logger import open_logger
from gpcorrect_service.protocol.errors import ServiceError

TURN = (1.0, 0.0, 0.0, 0.0)


def prefilter(corrector: ShiftCorrector | None = None, **settings: object) -> Prefilter:
    """Return a pre-filter before a robot that is ready at time 1."""
    known = corrector or ShiftCorrector()
    chosen = PrefilterSettings(**{"command_age": 100.0, **settings})  # type: ignore[arg-type]
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


@pytest.mark.parametrize("stamp", [math.nan, math.inf, 0.0, 1.7e18])
def test_a_state_whose_stamp_says_nothing_lets_no_command_pass(stamp):
    """A state stamped with no number, or in ns, is refused; without a good one nobody knows how old a command is."""
    answering = prefilter()
    with pytest.raises(ServiceError, match="stamp"):
        answering.robot_is(OperatingState(stamp, "ENABLED", True, False))
    with pytest.raises(ServiceError, match="not known"):
        answering.servo(pose(1.1))
    answering.robot_is(OperatingState(1.0, "ENABLED", True, False))
    answering.servo(pose(1.1))


class Wall:
    """A monotonic clock that a test moves."""

    now = 50.0

    def __call__(self) -> float:
        return self.now


def test_a_pose_in_another_frame_is_refused():
    """A pose that says it is in another frame than the model was trained in is not taken for one in it."""
    corrector = ShiftCorrector()
    corrector.info = lambda: {"frames": {"input": "tracker", "output": "base"}}  # type: ignore[method-assign]
    with pytest.raises(ServiceError, match="'base'"):
        prefilter(corrector).servo(Pose(1.1, pose(1.1).pose, "base"))
    prefilter(corrector).servo(pose(1.1))
    prefilter(corrector, desired_frame="polaris").servo(Pose(1.1, pose(1.1).pose, "polaris"))


def test_an_old_or_unknown_state_is_not_believed():
    """Without a fresh operating state nothing is passed on; how old it is, the pre-filter's own clock says."""
    wall = Wall()
    answering = Prefilter(model(ShiftCorrector()), PrefilterSettings(state_age=0.5, command_age=100.0), monotonic=wall)
    with pytest.raises(ServiceError, match="not known"):
        answering.servo(pose(1.1))
    answering.robot_is(OperatingState(1.0, "ENABLED", True, False))
    answering.servo(pose(1.1))
    wall.now += 0.6
    with pytest.raises(ServiceError, match="not known"):
        answering.servo(pose(1.2))


@pytest.mark.parametrize("scale", [1.0, 20.0])
@pytest.mark.parametrize("held", [0.3, 5.0, 3600.0])
def test_what_waited_while_the_prefilter_was_stopped_moves_nothing(scale, held):
    """Poses that came in while it was held up are refused when it goes on, though all come at the same instant."""
    wall, began = Wall(), 1.8e9
    answering = Prefilter(model(ShiftCorrector()), PrefilterSettings(time_scale=scale), monotonic=wall)

    def both(wall_seconds: float) -> bool:
        """Hear state and pose of one moment; whether the pose passes."""
        stamp = began + scale * wall_seconds
        answering.robot_is(OperatingState(stamp, "ENABLED", True, False))
        with suppress(ServiceError):
            answering.servo(pose(stamp + 1e-6))
            return True
        return False

    for k in range(20):
        wall.now = 50.0 + 0.02 * k + 0.001
        assert both(0.02 * k)
    wall.now = 50.0 + 0.4 + held
    waiting = 0.4 + np.linspace(0.0, held, 400)
    passed = [seconds for seconds in waiting if both(seconds)]
    assert min(passed) >= 0.4 + held - 0.251 - 1e-3 * held
    assert max(passed) == waiting[-1]


def test_a_robot_that_was_held_up_is_believed_again_once_it_was_disabled():
    """A clock that lost five seconds is STALE; disabling and enabling learns it anew, and not from what waited."""
    wall = Wall()
    answering = Prefilter(model(ShiftCorrector()), monotonic=wall)

    def passes(stamp: float, state: str = "ENABLED") -> bool:
        answering.robot_is(OperatingState(stamp, state, True, False))  # type: ignore[arg-type]
        with suppress(ServiceError):
            answering.servo(pose(stamp))
            return True
        return False

    assert passes(1.0)
    wall.now += 6.0
    assert not passes(2.0)
    # It was disabled and enabled while the pre-filter was stopped, and all of it comes at once.
    wall.now += 3.0
    assert not passes(2.1, "DISABLED")
    assert not any(passes(2.1 + 0.1 * k) for k in range(29))
    wall.now += 1.1
    assert passes(6.1)
    assert not passes(5.5)


@pytest.mark.parametrize("back", [0.3, 2.0, 60.0])
def test_a_robot_whose_clock_was_set_back_is_told_so_and_believed_after_a_second(back):
    """Poses are refused with the clock as the reason while it is not known, and pass again by themselves."""
    wall, said = Wall(), []
    answering = Prefilter(model(ShiftCorrector()), monotonic=wall)
    for k in range(50):
        wall.now = 50.0 + 0.1 * k
        stamp = 1000.0 + 0.1 * k - (back if k > 20 else 0.0)
        answering.robot_is(OperatingState(stamp, "ENABLED", True, False))
        try:
            answering.servo(pose(stamp + 0.001))
            said.append("")
        except ServiceError as error:
            said.append(str(error))
    assert set(said[:21]) == set(said[33:]) == {""}
    assert all("behind the robot's clock" in one and "was set back" in one for one in said[21:31])


@pytest.mark.parametrize("off", [-3600.0, -0.3, 0.3, 3600.0])
def test_a_clock_that_is_not_the_robots_says_nothing_of_age(off):
    """Poses stamped by a planner's clock that is behind the robot's, or ahead of it, are refused, with the reason."""
    for answer in (prefilter(command_age=0.25).servo, prefilter(command_age=0.25).move):
        with pytest.raises(ServiceError, match="robot's clock") as refused:
            answer(pose(4000.0 + off) if abs(off) > 1 and off > 0 else pose(max(1.0 + off, 1e-3)))
        assert refused.value.status == "STALE"


def test_a_process_that_is_stopped_at_work_sends_nothing_old():
    """The age counts when the command is ready, and not when the pose was taken up."""
    wall = Wall()

    class Stopped(ShiftCorrector):
        def correct(self, pose, twist=None):
            wall.now += 0.3
            return super().correct(pose, twist)

    answering = Prefilter(model(Stopped()), monotonic=wall)
    answering.robot_is(OperatingState(1.0, "ENABLED", True, False))
    with pytest.raises(ServiceError, match="behind"):
        answering.servo(pose(1.0))
    answering.robot_is(OperatingState(1.3, "ENABLED", True, False))
    with pytest.raises(ServiceError, match="behind"):
        answering.move(pose(1.3))


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
    with pytest.raises(ServiceError, match="training region"):
        prefilter(outside=False).servo(pose(1.1, 0.6))


def test_a_command_that_is_no_command_does_not_spoil_the_stream():
    """After a command that was withheld the next one is bounded from the last that was sent."""
    corrector = ShiftCorrector()
    answering = prefilter(corrector)
    answering.servo(pose(1.0))
    corrector.shift = np.full(3, np.nan)
    with pytest.raises(ServiceError, match="not finite"):
        answering.servo(pose(1.01))
    corrector.shift = SHIFT
    command, _ = answering.servo(pose(1.02))
    np.testing.assert_allclose(command.pose[:3], np.array([0.1, 0.0, -0.1]) + SHIFT)


class Deaf:
    """As much of a bus as a pre-filter's server takes: keeps who listens to what, and sends nothing."""

    def __init__(self) -> None:
        self.inboxes: dict[str, Callable[[Pose], None]] = {}

    def claim(self, what: str) -> None:
        pass

    def subscribe(self, name: str, inbox: Callable[[Pose], None], refused: object = None) -> None:
        self.inboxes[name] = inbox


def test_poses_that_a_full_queue_loses_are_told_of_once():
    """Where poses come faster than they are answered, the log says so with the first that is lost."""
    log, bus = io.StringIO(), Deaf()
    FilterServer(prefilter(), bus, open_logger(log))  # type: ignore[arg-type]
    for k in range(WAITING + 3):
        assert ("dropped" in log.getvalue()) == (k > WAITING)
        bus.inboxes["servo_cp"](pose(1.1 + 0.01 * k))
    assert log.getvalue().count("oldest pose dropped") == 1
