"""Models that answer poses through the arm's joints: asked out of reach, near singularities, in jumps, with gaps."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from service_bench import PATIENT, free_endpoint

from attacks.commands import CARRIED, LIMIT
from attacks.lab import Lab, Scenario, Seen
from attacks.programs import held, waited
from gpcorrect import se3
from gpcorrect.calibration import CommandCorrector, load
from gpcorrect.rigid import RigidModel, pose_residual
from gpcorrect.types import FloatArray, PoseSignal
from gpcorrect_service import CorrectionClient, ServiceError
from gpcorrect_service.crtk import Bus, BusSettings, OperatingState, Pose
from gpcorrect_service.crtk.prefilter import PrefilterSettings

ROWS, STEP = 1000, 1e-3  # poses of a path, and s between them
ROUNDS = 3  # of every kind of path: 24,000 poses in all
FAST = 0.5  # of the training region's largest joint velocities, at which a path that the arm can follow moves
JUMP = 0.5e-3, np.radians(0.5)  # m and rad that a correction may change by from one millisecond to the next
ROUNDING = 1 + 1e-6
SAME = 1e-9  # m: between processes
FLOOR = 1e-6  # m and rad: the angle between two unit quaternions has half the digits of a double
SLOWEST = 0.5  # s that a pose may wait for an answer on a busy machine while paths are asked
HELD = 2.0  # s
PERIOD = 0.01  # s between two poses of a stream


def paths(lab: Lab) -> Seen:
    """Ask a server for paths at 1 kHz; count answers that are wrong by themselves, or not the model's."""
    model, tried, wrong = load(lab.jointed_model), 0, Counter[str]()
    with (
        lab.server(lab.jointed_model) as (end, _),
        CorrectionClient(end, path_timeout=30.0, connect_timeout=PATIENT) as client,
        ThreadPoolExecutor(1) as pool,
    ):
        for poses in hostile(model, np.random.default_rng(0)):
            times = STEP * np.arange(len(poses))
            asked = pool.submit(client.correct_path, poses, times)
            own, reply = model.correct_path(poses, times), asked.result()
            tried += len(poses)
            wrong["not the model's"] += int((np.abs(reply.position - own.position).max(axis=1) > SAME).sum())
            wrong.update(wrong_in(model, poses, reply.position, reply.quaternion, reply.in_domain))
        fault = client.health().state == "FAULT"
    return Seen(tried, sum(wrong.values()) + fault, f"{dict(+wrong)}")


def wrong_in(
    model: CommandCorrector, poses: FloatArray, position: FloatArray, quaternion: FloatArray, inside: FloatArray
) -> Counter[str]:
    """Count corrections above the bound, numbers that are missing, and jumps where both answers are called good."""
    desired = PoseSignal(poses[:, :3], poses[:, 3:])
    correction = pose_residual(model.rigid.apply(desired), PoseSignal(position, quaternion))
    moved = pose_residual(desired[:-1], desired[1:])
    wrong = Counter[str]({"missing": int((~np.isfinite(correction).all(axis=1)).sum())})
    good = inside[1:] & inside[:-1]
    for part, largest, jump in zip((slice(0, 3), slice(3, 6)), model.law.bounds.largest, JUMP, strict=True):
        sizes = np.linalg.norm(correction[:, part], axis=1)
        changes = np.linalg.norm(np.diff(correction[:, part], axis=0), axis=1)
        wrong["above the bound"] += int((sizes > ROUNDING * largest).sum())
        wrong["jumps"] += int((good & (changes > jump + np.linalg.norm(moved[:, part], axis=1))).sum())
    return wrong


def hostile(model: CommandCorrector, rng: np.random.Generator) -> Iterator[FloatArray]:
    """Yield paths `(n, 7)` that the arm can follow badly or not at all."""
    kinematics = model.route.kinematics
    chain, starts = kinematics.chain, kinematics.starts
    low, high = starts.min(axis=0), starts.max(axis=0)
    weights = np.array([kinematics.length] * 3 + [1.0] * 3)[:, None]
    speeds, seconds = _speeds(model), ROWS * STEP
    ramp, rising = np.linspace(0, 1, ROWS) ** 4, np.sin(np.linspace(0, np.pi, ROWS))[:, None] ** 2
    for _ in range(ROUNDS):
        one, other, *jumps = starts[rng.integers(len(starts), size=7)]
        wide = rng.uniform(1.7 * low - 0.7 * high, 1.7 * high - 0.7 * low, (2000, chain.dof))
        rates = np.linalg.svd(chain.jacobian(wide) / weights, compute_uv=False)[:, -1]
        singular, aside = wide[np.argmin(rates)], 0.05 * (high - low) * rng.normal(size=chain.dof)
        near = min(1.0, float((FAST * speeds / np.maximum(1.5 * np.abs(other - one) / seconds, 1e-9)).min()))
        quiet = chain.forward(_smooth(np.array([one, one + near * (other - one)])))
        away = 0.05 * rising * np.eye(3)[rng.integers(3)]  # slowly: what is learned of speeds is no jump
        turned, whole = np.outer(4 * np.pi * ramp, rng.normal(size=3)), np.zeros((ROWS, chain.dof))
        joint = rng.integers(chain.dof)
        whole[:, joint] = (2 * np.pi if chain.revolute[joint] else 2 * high[joint]) * ramp
        shaken = 0.02 * rng.normal(size=(ROWS, 3)), 0.7 * rng.normal(size=(ROWS, 3))
        yield _poses(model.rigid, quiet)
        yield _poses(model.rigid, chain.forward(_smooth(np.array([singular - aside, singular, singular + aside]))))
        yield _poses(model.rigid, chain.forward(np.array(jumps).repeat(ROWS // len(jumps), axis=0)))
        yield _poses(model.rigid, _moved(quiet, away, 0 * away))
        yield _poses(model.rigid, _moved(quiet, 7 * away.max() + away, 0 * away))
        yield _poses(model.rigid, _moved(quiet, 0 * away, turned))
        yield _poses(model.rigid, chain.forward(one + whole))
        yield _poses(model.rigid, _moved(quiet, *shaken))


def _speeds(model: CommandCorrector) -> FloatArray:
    """Return the joint velocities `(d,)` up to which the training region reaches, rad/s and m/s."""
    joints = model.route.joints
    kinds, owners = joints.view.features.origins
    columns, speeds = np.flatnonzero(kinds == "velocity"), np.full(len(joints.types), np.inf)
    domain = joints.law.domain
    edges = np.minimum(-domain.low[columns], domain.high[columns])
    speeds[owners[columns]] = edges * joints.view.features.half[owners[columns]]
    return speeds


def _smooth(points: FloatArray) -> FloatArray:
    """Return joints `(ROWS, d)` that rest at each of `points` (k, d)."""
    place = np.linspace(0, len(points) - 1, ROWS)
    number = np.minimum(place.astype(int), len(points) - 2)
    part = (place - number)[:, None]
    return points[number] + (points[number + 1] - points[number]) * part**2 * (3 - 2 * part)


def _moved(T: FloatArray, by: FloatArray, turned: FloatArray) -> FloatArray:
    return se3.pose(se3.matrix_from_rotvec(turned) @ T[:, :3, :3], T[:, :3, 3] + by)


def _poses(rigid: RigidModel, T: FloatArray) -> FloatArray:
    """Return the desired poses `(n, 7)` whose references are T (n, 4, 4)."""
    R = rigid.R_left.T @ T[:, :3, :3] @ rigid.R_right.T
    position = (T[:, :3, 3] - rigid.t) @ rigid.R_position - R @ rigid.offset
    return np.hstack([position, se3.quaternion_from_matrix(R)])


def others(lab: Lab) -> Seen:
    """Ask for the longest paths out of reach without a pause, while somebody asks single poses: who waits too long."""
    model = load(lab.jointed_model)
    pose = model.check_queries[0, :7]
    far = np.tile(pose, (5000, 1))
    far[:, 2] += 0.35
    stop, slow, tried = threading.Event(), 0, 0
    with lab.server(lab.jointed_model) as (end, _):

        def _flood() -> None:
            with CorrectionClient(end, path_timeout=60.0, connect_timeout=PATIENT) as client:
                while not stop.is_set():
                    client.correct_path(far, STEP * np.arange(len(far)))

        flood = threading.Thread(target=_flood)
        flood.start()
        try:
            with CorrectionClient(end, timeout=SLOWEST, connect_timeout=PATIENT) as client:
                until = time.monotonic() + 8.0
                while time.monotonic() < until:
                    tried += 1
                    try:
                        client.correct(pose)
                    except ServiceError:
                        slow += 1
                    time.sleep(0.02)
        finally:
            stop.set()
            flood.join()
    return Seen(tried, slow)


def streamed(lab: Lab) -> Seen:
    """Stream hostile poses and NaN at a pre-filter that is held up once; count commands that break what it promises."""
    model, end = load(lab.jointed_model), free_endpoint()
    poses = np.vstack([path[::25] for path in hostile(model, np.random.default_rng(1))])
    came: list[tuple[float, Pose]] = []
    refusals, sent = Counter[str](), []
    good, missing = model.check_queries[0, :7], np.full(7, np.nan)
    with (
        Bus(BusSettings(end, role="hub")) as bus,
        lab.program("prefilter", str(lab.jointed_model), "--endpoint", end, ready="corrects") as prefilter,
    ):
        bus.subscribe("corrected/servo_cp", lambda pose: came.append((time.monotonic(), pose)))
        bus.subscribe("error", lambda error: refusals.update((error.string.split(":")[0],)))

        def _send(pose: FloatArray) -> None:
            sent.append(Pose(time.monotonic(), tuple(pose.tolist()), "tracker"))
            bus.publish("operating_state", OperatingState(sent[-1].stamp, "ENABLED", True, False))
            bus.publish("servo_cp", sent[-1])
            time.sleep(PERIOD)

        waited(lambda: _send(good) or came)
        for number, pose in enumerate(poses):
            if number == len(poses) // 2:
                with held(prefilter.pid):
                    until = time.monotonic() + HELD
                    while time.monotonic() < until:
                        _send(good)
            _send(missing if number % 50 == 7 else pose)
        time.sleep(2 * LIMIT)
        traced = "Traceback" in prefilter.log
    old = sum(now - pose.stamp > LIMIT + CARRIED for now, pose in came)
    fast = _too_fast([one for one in sent if np.isfinite(one.pose).all()], [pose for _, pose in came])
    return Seen(len(came), old + fast + traced, f"{old} old, {fast} too fast; refused {dict(refusals)}")


def _too_fast(sent: list[Pose], came: list[Pose]) -> int:
    """Count commands further from the one before than all desired poses between them moved, and the correction may."""
    settings = PrefilterSettings()
    speeds = np.array([settings.linear, np.radians(60.0)])  # the command line's own
    travelled = np.vstack([np.zeros(2), np.cumsum([_distance(*pair) for pair in pairwise(sent)], axis=0)])
    place, count = {one.stamp: k for k, one in enumerate(sent)}, 0
    for before, after in pairwise(came):
        seconds, ends = after.stamp - before.stamp, (place.get(one.stamp) for one in (before, after))
        first, last = ends
        if first is not None and last is not None and 0 < seconds <= settings.gap:
            allowed = travelled[last] - travelled[first] + speeds * seconds
            count += bool((_distance(before, after) > ROUNDING * allowed + FLOOR).any())
    return count


def _distance(one: Pose, other: Pose) -> FloatArray:
    """Return by how much two poses differ, m and rad."""
    first, second = (PoseSignal(np.array([p.pose[:3]]), np.array([p.pose[3:]])) for p in (one, other))
    change = pose_residual(first, second)[0]
    return np.array([np.linalg.norm(change[:3]), np.linalg.norm(change[3:])])


SCENARIOS = (
    Scenario("paths through joints", "above the bound, jumping, missing, or not the model's", paths),
    Scenario("paths out of reach while others ask", "poses that wait for more than half a second", others),
    Scenario("poses through joints, streamed", "commands too old or too fast", streamed),
)
