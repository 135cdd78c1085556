"""A log and a model, prepared for comparison."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from gpcorrect import se3
from gpcorrect.discrepancy.recording.layout import Layout, layout_of
from gpcorrect.discrepancy.recording.noise import ChannelNoise, estimate_noise, outliers
from gpcorrect.discrepancy.recording.replay_memory import ReplayMemory
from gpcorrect.discrepancy.recording.scene import Channel, Scene
from gpcorrect.discrepancy.recording.servo_clock import RUN_OUT, commanded_plan, holes, settled_stamps
from gpcorrect.discrepancy.recording.tracker import (
    Misfit,
    Slack,
    Tracker,
    refuse_mixed_joints,
    slack_of,
    table_slopes,
    tracker_misfit,
)
from gpcorrect.discrepancy.settings import CLOCK, NOISE
from gpcorrect.errors import DataError
from gpcorrect.sim.body import Body
from gpcorrect.sim.machine import Machine
from gpcorrect.sim.model import Model
from gpcorrect.sim.motion import Motion
from gpcorrect.sim.plant import Command, follow_command
from gpcorrect.sim.resolve import has_controller, machine_of
from gpcorrect.types import BoolArray, CalibrationLog, FloatArray, IntArray
from gpcorrect.velocity import derivative

PIECE, WARM_UP = 200, 400  # rows; pieces of long motions are replayed after a warm-up that fills the memories
MOVES = 1e-3  # rad, or a tenth of it in m, that some joint goes at least
SMOOTHED = 0.015  # s, a quarter of the window of an acceleration: what is beyond 10 Hz, no arm's load is known for
TOLD = 1e-3  # ms by which stamps must move for the report to say so
FEW_RUNS = 4  # to tell joints apart by
FAR = 10.0  # half ranges from the middle: degrees of a joint that uses a fifth of its range are eleven


def build_scene(
    log: CalibrationLog, model: Model, registered_on: BoolArray, noises: tuple[ChannelNoise, ...] | None = None
) -> Scene:
    """Prepare a log and a model for comparison.

    Parameters
    ----------
    log : CalibrationLog
    model : Model
    registered_on : (n,) bool array, rows that may be used to register the tracker
    noises : tuple of ChannelNoise, optional
        Of each channel, against which the tolerance of table and registration is held; as the recording shows it when
        None.

    Raises
    ------
    DataError
        The log lacks the motor side or every outside signal, or its joints cannot be the model's.
    """
    machine = machine_of(model).with_effects()
    joints, source = machine.body.joints, _motor_side(log)
    motor = _whole_columns(log, source, joints)
    _refuse_other_units(motor, source, machine)
    _refuse_still_arm(motor, source, machine.body)
    label = _continuous_runs(log, motor)
    layout = layout_of(label, piece=PIECE, warm_up=WARM_UP, run_out=RUN_OUT)
    driven = has_controller(model) and log.setpoint_jp is not None
    command = _whole_columns(log, "setpoint_jp", joints) if driven else None
    time = None if command is None else settled_stamps(log.time, label, command)
    first_rows = np.flatnonzero(np.diff(label, prepend=-1))
    # Where a servo may not have forgotten how the motion began.
    on_the_move = settling = np.asarray(log.time - log.time[first_rows][label] < CLOCK.settles)
    if time is not None and command is not None:
        on_the_move = settling & _begun_on_the_move(time, label, command)
    loop = time is not None and not on_the_move.all()
    remarks = _loop_remarks(log, model, source, loop=loop)
    columns, chain = getattr(log, source).shape[1], machine.body.chain
    if chain is not None and columns > chain.dof:
        remarks.append(f"{source} has {columns} columns for an arm of {chain.dof} joints: the first are taken for them")
    if time is not None and (moved := 1e3 * float(np.std(time - log.time))) > TOLD:
        remarks.append(f"stamps are put on the even clock on which commands are smooth, moved by {moved:.2g} ms")
        log = replace(log, time=time)
    session = np.unique(log.session, return_inverse=True)[1].astype(np.int64)
    payload = np.full(layout.rows.shape[1], model.payload)
    if log.payload is not None:
        payload = np.median(layout.spread(np.nan_to_num(log.payload)), axis=0)
    motion = _motion(log, joints, motor, session, label, layout)
    channels, observed = _compared_channels(log, machine.body, source, loop=loop)
    of_motor = np.array([c.signal == "measured_jp" for c in channels], dtype=np.bool_)
    plan, stamps = None, None
    if loop and command is not None:
        observed[on_the_move[:, None] & (of_motor | (source != "measured_jp"))] = np.nan
        plan, stamps = commanded_plan(command, layout, motion, payload)
    scene = Scene(
        model=model,
        machine=machine,
        channels=channels,
        observed=observed,
        motion=motion,
        acceleration=layout.spread(np.nan_to_num(_acceleration(log.time, motor, label))),
        layout=layout,
        plan=plan,
        unclocked=driven and not loop,
        stamps=stamps,
        payload=payload,
        time=log.time,
        trajectory=log.trajectory,
        session=session,
        effort=None if log.measured_jf is None else _joint_columns(log, "measured_jf", joints),
        measured=source == "measured_jp",
        remarks=tuple(remarks),
    )
    if plan is not None and source == "measured_jp":
        off = "the motors' distance from where their servo holds them"
        roughly, exactly = (_servo_misfit(scene, exactly=e) for e in (False, True))
        refuse_mixed_joints(machine.body, f"setpoint_jp and {source}", roughly, exactly, off)
    if _begun_elsewhere(scene, of_motor, label, settling):
        observed[settling[:, None] & of_motor] = np.nan
        if scene.measured and plan is not None:
            begins = np.stack([motion.position[0], motion.velocity[0]])
            scene = replace(scene, plan=replace(plan, begins=begins), memory=ReplayMemory())
    if log.tracker_cp is None or machine.body.chain is None:
        return scene
    seen = log.tracker_cp
    known = model.T_tracker_base is not None, model.T_tip_marker is not None
    simulated, motions = scene.marker_poses(), np.unique(log.trajectory, return_inverse=True)[1]
    # With faults of the tracker, which move it.
    first, places = Tracker(seen.position, registered_on, *known).with_places(session, simulated)
    misfit = tracker_misfit(first, _up_to_marker(machine), scene.motor_path(), machine.T_tracker_base)
    refuse_mixed_joints(machine.body, source, misfit, misfit, "the tracker's residual")
    faults = [outliers(error, motions) for error in (seen.position - first.predicted(simulated)).T]
    sound = registered_on & ~np.any(faults, axis=0)
    mounted, where = replace(first, rows=sound).with_mount(simulated)
    tracker, why = mounted.with_orientations(seen.quaternion, simulated)
    kinds = (("tracker_cp", "m"), ("tracker_rotation", "rad"))
    axes = [Channel(f"{signal}_{axis}", signal, i, 0, unit) for signal, unit in kinds for i, axis in enumerate("xyz")]
    scene = replace(
        scene,
        tracker=tracker,
        channels=(*channels, *axes[: tracker.observed.shape[1]]),
        observed=np.concatenate([observed, tracker.observed], axis=1),
        remarks=(*remarks, *(words for words in (places, where, why) if words)),
    )
    return replace(scene, slack=_slack(scene, tracker, noises))


def _servo_misfit(scene: Scene, *, exactly: bool) -> Misfit:
    """Return by how much motors are off from where the servo holds the nominal arm, rad and m RMS.

    Of a few runs, by the signs and the order of the joints; roughly without simulating the servo, which takes as long
    as all of them, but for a delay of each joint.
    """
    assert scene.plan is not None
    runs = np.arange(len(scene.payload))[:: max(1, len(scene.payload) // FEW_RUNS)]
    machine, plan, measured = scene.machine, scene.plan.of_runs(runs), scene.motion.position[:, runs]
    stamps = None if scene.stamps is None else scene.stamps.of_runs(runs)

    def left(signs: FloatArray, order: IntArray) -> float:
        command = Command.of(machine, replace(plan, q=signs * plan.q[..., order]))
        held = follow_command(machine, command).motion.position if exactly else command.guess.q
        velocity = command.desired.velocity
        if stamps is not None:
            held, velocity = stamps.sampled(held), stamps.sampled(velocity)
        off = signs * measured[..., order] - held
        known = np.isfinite(off)
        late = np.sum(velocity * np.where(known, off, 0.0), (0, 1))
        late /= np.maximum(np.sum(known * velocity**2, (0, 1)), 1e-300)
        return float(np.sqrt(np.nanmean((off - late * velocity) ** 2)))

    return left


def _up_to_marker(machine: Machine) -> Body:
    """Arm whose chain ends at the tracker's marker."""
    chain = machine.body.chain
    assert chain is not None
    return replace(machine.body, chain=replace(chain, tool=se3.compose(chain.tool, machine.T_tip_marker)))


def _slack(scene: Scene, tracker: Tracker, noises: tuple[ChannelNoise, ...] | None) -> Slack:
    """Tolerance of table and registration, against the noise given or that the residual shows over short lags."""
    body, n_axes = _up_to_marker(scene.machine), tracker.observed.shape[1]
    assert body.chain is not None
    slopes = table_slopes(body.chain, body.all_joints(scene.motor_path()), scene.machine.T_tracker_base, tracker)
    rows = np.repeat((tracker.rows & np.isfinite(tracker.observed).all(axis=1))[:, None], n_axes, axis=1)
    if noises is None:
        label, still = scene.run_of_row(), np.zeros(len(scene), dtype=np.bool_)
        residual = scene.residual()[:, -n_axes:]
        noises = tuple(estimate_noise(scene.time, r, label, still) for r in residual.T)
    own = noises[-n_axes:]
    least = max(n.std for n in own[:3]) / NOISE.marker_size  # of turns, as everywhere
    own = (*own[:3], *(replace(n, white=max(n.white, least)) for n in own[3:]))
    return slack_of(slopes, rows, own, scene.step)


def _motor_side(log: CalibrationLog) -> str:
    """Name of the signal that says where the motors were: measured, else commanded."""
    if log.measured_jp is None and log.setpoint_jp is None:
        raise DataError(
            "the log has neither measured_jp nor setpoint_jp: nothing says where the motors were.",
            hint="Log measured_jp_1, _2, ... (joint positions from the motor encoders) or setpoint_jp_1, ..., or name "
            "the columns in a mapping file (--columns).",
        )
    return "setpoint_jp" if log.measured_jp is None else "measured_jp"


def _joint_columns(log: CalibrationLog, signal: str, joints: tuple[int, ...]) -> FloatArray:
    """Columns `(n, k)` of a joint signal for these joint numbers, in whose order just k columns stand."""
    values: FloatArray = getattr(log, signal)
    if values.shape[1] == len(joints):
        return values
    if values.shape[1] < max(joints):
        raise DataError(
            f"the model speaks of joints {list(joints)}, {signal} of the log has {values.shape[1]} columns.",
            hint="Name the recorded joints in the model's `joints`.",
        )
    return values[:, [j - 1 for j in joints]]


def _whole_columns(log: CalibrationLog, signal: str, joints: tuple[int, ...]) -> FloatArray:
    """Return columns `(n, k)` of a joint signal, each of which has values; refuse it where one has none."""
    values = _joint_columns(log, signal, joints)
    if missing := [j for j, q in zip(joints, values.T, strict=True) if not np.isfinite(q).any()]:
        raise DataError(
            f"{signal}: joint {missing[0]} has no value in any row.",
            hint="Log it. If it stood still, name the others alone in the model's `joints`.",
        )
    return values


def _refuse_other_units(motor: FloatArray, signal: str, machine: Machine) -> None:
    """Refuse joint positions `(n, k)` far beyond the limits of the arm's joints: they are in another unit."""
    if machine.description is None:
        return
    for j, q in zip(machine.body.joints, motor.T, strict=True):
        low, high = machine.description.limits[j - 1]
        reach = float(np.nanpercentile(np.abs(q - (low + high) / 2), 95))
        if reach > FAR * (high - low) / 2 and not np.isclose(high - low, 2 * np.pi):  # which stands for no limits
            raise DataError(
                f"{signal}: joint {j} goes {reach:.3g} from the middle of its range in the model, {low:.3g} to "
                f"{high:.3g}: they are not in the same unit.",
                hint="A mapping file scales columns: 0.0174533 for degrees, 0.001 for mm. Or correct the range.",
            )


def _refuse_still_arm(motor: FloatArray, signal: str, body: Body) -> None:
    """Refuse joint positions `(n, k)` of which none changes: one pose fits any number of effects."""
    low, high = np.nanpercentile(motor, [1, 99], axis=0)
    units = np.where([kind == "P" for kind in body.types], 0.1, 1.0)
    if not (high - low > MOVES * units).any():
        raise DataError(
            f"{signal}: no joint moves by more than {MOVES:g} rad ({0.1 * MOVES:g} m): what an arm does in one pose "
            "tells no effect from another.",
            hint="Record motions that use each joint's range, as `gpcorrect zigzag` makes them.",
        )


def _compared_channels(
    log: CalibrationLog, body: Body, source: str, *, loop: bool
) -> tuple[tuple[Channel, ...], FloatArray]:
    """Joint channels that a log lets us compare, and what was measured in them `(n, c)`."""
    kinematics = body.chain is not None
    if log.external_jp is None and (log.tracker_cp is None or not kinematics):
        bare = ", and a bare joint chain has no kinematics to use tracker_cp with"
        raise DataError(
            f"the log has no external_jp{' and no tracker_cp' if kinematics else bare}: nothing says where the arm "
            "really was.",
            hint="Log external_jp, or tracker_cp with an arm that has kinematics.",
        )
    signals = ["measured_jp"] if loop and source == "measured_jp" else []
    signals += [] if log.external_jp is None else ["external_jp"]
    channels = tuple(
        Channel(f"{signal}_{joint}", signal, i, joint, "m" if body.types[i] == "P" else "rad")
        for signal in signals
        for i, joint in enumerate(body.joints)
    )
    observed = [_joint_columns(log, signal, body.joints) for signal in signals]
    return channels, np.concatenate([np.zeros((len(log), 0)), *observed], axis=1)


def _continuous_runs(log: CalibrationLog, motor: FloatArray) -> IntArray:
    """Label `(n,)` of the continuous motion of each row, for play and hysteresis remember across trajectory numbers.

    Two trajectories of a session are one motion when time and motors `(n, k)` step from one to the next no further than
    they ever do inside a trajectory. A hole in the stamps ends a motion that went on in it.
    """
    change, hole = np.diff(log.trajectory) != 0, holes(log.time)[1:]
    inside = ~change & ~hole
    if not inside.any():
        return np.arange(len(log), dtype=np.int64)
    step, moved = np.diff(log.time), np.abs(np.diff(motor, axis=0))
    near = (moved <= np.nanmax(moved[inside], axis=0)).all(axis=1)
    joined = (step > 0) & (step <= step[~change].max()) & near & (np.diff(log.session) == 0)
    return np.concatenate([[0], np.cumsum(np.where(change, ~joined, hole & ~near))]).astype(np.int64)


def _begun_on_the_move(time: FloatArray, label: IntArray, command: FloatArray) -> BoolArray:
    """Say of which rows `(n,)` the motion begins with a command that moves.

    Whether the arm moved with it, or still stood, is in no log.
    """
    first, inside = np.flatnonzero(np.diff(label, prepend=-1)), np.diff(label, append=label[-1] + 1) == 0
    speed = np.zeros(command.shape)
    speed[inside] = (np.diff(command, axis=0) / np.diff(time)[:, None])[inside[:-1]]
    usual = np.sqrt(np.mean(speed[inside] ** 2, axis=0))
    moves = (np.abs(speed[first]) > CLOCK.moving * usual).any(axis=1) & inside[first]
    return np.asarray(moves[label])


def _begun_elsewhere(scene: Scene, of_motor: BoolArray, label: IntArray, settling: BoolArray) -> bool:
    """Whether motors stand farther from the simulated ones in motions' first rows than they are later, beyond chance.

    What the controller's integral held, or what it held against, is in no log: simulated motions begin in balance.
    Otherwise they begin where the motors were measured: an arm that sank in a pause, saturated, goes on sinking.
    """
    if scene.plan is None or settling.all() or not of_motor.any():
        return False
    squares = scene.residual()[:, of_motor] ** 2
    first = squares[np.flatnonzero(np.diff(label, prepend=-1))]
    known = np.isfinite(first).sum(axis=0)
    least = chi2.ppf(1.0 - CLOCK.chance, np.maximum(known, 1)) * np.nanmean(squares[~settling], axis=0)
    return bool((np.nansum(first, axis=0) > least).any())


def _loop_remarks(log: CalibrationLog, model: Model, source: str, *, loop: bool) -> list[str]:
    """Return what was taken for the motors, and why the closed loop is not run where it is not."""
    remarks = [f"motor side taken from {source}"]
    if not has_controller(model):
        remarks.append("the model has no controller: effects inside the servo loop leave no trace and cannot be named")
    elif log.setpoint_jp is None:
        remarks.append("the closed loop needs setpoint_jp: effects inside it cannot be named")
    elif not loop:
        rough = "stamps stand still, or are uneven and commands as rough on them as on an even clock"
        brief = f"no motion lasts {CLOCK.settles:g} s"
        remarks.append(f"{rough}, or {brief}: the closed loop is not run, effects inside it cannot be named")
    if source != "measured_jp":
        path = "those of the simulated servo loop" if loop else "taken to follow their commands exactly"
        remarks.append(f"the motors were not measured: they are {path}")
    return remarks


def _motion(
    log: CalibrationLog, joints: tuple[int, ...], motor: FloatArray, session: IntArray, label: IntArray, layout: Layout
) -> Motion:
    """Motors as replayed, without loads."""
    begin = np.array([log.time[session == s].min() for s in range(session.max() + 1)])
    velocity = np.zeros(motor.shape)
    for k in np.unique(label):
        rows = np.flatnonzero(label == k)
        if len(rows) > 1:
            velocity[rows] = np.gradient(motor[rows], log.time[rows], axis=0)
    position, nothing = layout.spread(motor), np.zeros((*layout.rows.shape, len(joints)))
    clock = layout.spread(log.time - begin[session])
    return Motion(joints, clock, session[layout.rows[0]], position, layout.spread(velocity), nothing, nothing)


def _acceleration(time: FloatArray, motor: FloatArray, label: IntArray) -> FloatArray:
    """Acceleration `(n, k)` of the motors: parabolas through a few hundredths of a second, twice."""
    begun = np.diff(label, prepend=label[:1]) != 0
    runs = np.cumsum(begun | (np.diff(time, prepend=-np.inf) <= 0))  # stamps that stand still show none
    return derivative(time, derivative(time, motor, runs, SMOOTHED), runs, SMOOTHED)
