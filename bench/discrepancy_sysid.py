"""What MuJoCo's own system identification makes of the blind cases: all candidate numbers of the file fitted at once.

    pip install 'mujoco[sysid]'
    python bench/discrepancy_sysid.py --short --share 0.2 --first-seed 600000 --beside bench/results/found.jsonl

Cases are those of `discrepancy_blind.py --truth mujoco` with the same options. `mujoco.sysid` (DeepMind, MuJoCo 4.0)
gets the arm's MJCF with its controller as actuators, what was commanded with its feed-forward, three trajectories of
the recording, and every number that it can fit and the catalogue has a name for: friction loss, damping and gain of
each drive, zero and scale of each joint's sensor, a payload and a delay. It has no rule for what is missing; two that
its user would take are scored: every number whose 95 % interval leaves out what the file says, and the one that leaves
it out by most. With --beside, a file of results of `discrepancy_blind.py`, its workflow stands in the last row.
"""

from __future__ import annotations

import argparse
import io
import json
import logging
import time
import warnings
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from discrepancy_cases import Job, case_of, label_of, outcome_of
from discrepancy_jobs import NUMBERS, jobs_of
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from support import RESULTS, print_table
from threadpoolctl import threadpool_limits
from truth.spec import Case

from gpcorrect.discrepancy.protocol.score_reports import Proportion
from gpcorrect.parallel import each_as_done, workers
from gpcorrect.types import CalibrationLog

try:
    from mujoco.sysid import (
        ModelSequences,
        Parameter,
        ParameterDict,
        SignalTransform,
        TimeSeries,
        build_residual_fn,
        calculate_intervals,
        create_initial_state,
        optimize,
    )
except ImportError as error:
    raise SystemExit(f"this peer needs its extra: pip install 'mujoco[sysid]' ({error})") from error

Array = NDArray[np.float64]
Place = tuple[str, object]

TRAJECTORIES = 3
STEP = 2e-3  # s
ITERATIONS = 8
logging.getLogger("absl").setLevel(logging.ERROR)  # it warns of friction that begins at its bound, zero
RULES = ("sysid: all that differ", "sysid: what differs most")


def fitted_places(case: Case, arm: Any) -> dict[Place, float]:
    """Return for every effect that a number stands for how many half widths of its 95 % interval it is off."""
    log, controller = case.log, case.nominal["controller"]
    kp, kd = np.array(controller["kp"]), np.array(controller["kd"])
    spec = _driven(arm, case.nominal, kp, kd, log.external_jp is None)
    parameters, places, transform = _parameters(arm, log)
    sequences = ModelSequences(arm.name, spec, *_sequences(spec, log, case.nominal, kp, kd))

    def compared(*arguments: Any, **named: Any) -> tuple[Any, TimeSeries, TimeSeries]:
        """Compare signals as `transform` does; 4.0.0 compares the names of vectors only if they are one object."""
        difference, predicted, measured = transform.apply(*arguments, **named)
        return difference, predicted, TimeSeries(measured.times, measured.data, predicted.signal_mapping)

    residual = build_residual_fn(models_sequences=[sequences], modify_residual=compared, n_threads=1)
    nominal = parameters.as_vector()
    parameters.move_off_bounds(fraction=1e-3)
    with redirect_stdout(io.StringIO()):
        found, result = optimize(parameters, residual, "mujoco", verbose=False, max_iters=ITERATIONS)
    left = residual(found.as_vector(), found)[0]
    _, widths = calculate_intervals([np.ravel(r) for r in left], result.jac)
    off = np.abs(found.as_vector() - nominal) / np.maximum(widths, 1e-12)
    return {place: float(x) for place, x in zip(places, off, strict=True)}


def _driven(arm: Any, nominal: Any, kp: Array, kd: Array, tracked: bool) -> mujoco.MjSpec:
    """Return the arm's file with the controller as actuators (force = ctrl - kp q - kd v) and what is measured."""
    from truth_mujoco.body import robot_xml

    spec = mujoco.MjSpec.from_string(robot_xml(arm, np.array(nominal["gravity"])))
    spec.option.timestep = STEP
    for j in range(arm.dof):
        drive = spec.add_actuator(name=f"drive{j + 1}", target=f"joint{j + 1}", trntype=mujoco.mjtTrn.mjTRN_JOINT)
        drive.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        drive.biasprm[1:3] = -kp[j], -kd[j]
        if not tracked:
            spec.add_sensor(
                name=f"joint{j + 1}",
                type=mujoco.mjtSensor.mjSENS_JOINTPOS,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=f"joint{j + 1}",
            )
    if tracked:
        tip = {"objtype": mujoco.mjtObj.mjOBJ_XBODY, "objname": "tip"}
        spec.add_sensor(name="tip", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, **tip)
    return spec


def _parameters(arm: Any, log: CalibrationLog) -> tuple[ParameterDict, list[Place], SignalTransform]:
    """Return all numbers with bounds, the effect that each stands for, and those of the sensors once more."""
    parameters, transform = ParameterDict(), SignalTransform(normalize=False)
    places: list[Place] = []

    def add(name: str, place: Place, nominal: float, low: float, high: float, modifier: Any = None) -> Parameter:
        parameter = Parameter(name, nominal, low, high, modifier=modifier)
        parameters.add(parameter)
        places.append(place)
        return parameter

    effort = np.sqrt(np.nanmean(log.measured_jf**2, axis=0)) if log.measured_jf is not None else np.full(arm.dof, 1.0)
    speed = np.nanmax(np.abs(np.diff(log.setpoint_jp, axis=0)), axis=0) * 100.0
    for j in range(arm.dof):
        joint, drive, most = f"joint{j + 1}", f"drive{j + 1}", 3.0 * max(float(effort[j]), 1e-3)

        def friction(spec: Any, p: Any, joint: str = joint) -> None:
            spec.joint(joint).frictionloss = float(p.value[0])

        def damping(spec: Any, p: Any, joint: str = joint) -> None:
            spec.joint(joint).damping = [float(p.value[0]), 0.0, 0.0]

        def gain(spec: Any, p: Any, drive: str = drive) -> None:
            spec.actuator(drive).gainprm[0] = float(p.value[0])

        add(f"friction {joint}", ("coulomb_friction", j + 1), 0.0, 0.0, most, friction)
        add(f"damping {joint}", ("viscous_friction", j + 1), 0.0, 0.0, most / max(speed[j], 1e-6), damping)
        add(f"gain {joint}", ("gain_error", j + 1), 1.0, 0.7, 1.3, gain)
        if log.external_jp is not None:
            reach = float(np.ptp(log.setpoint_jp[:, j]))
            zero = add(f"zero {joint}", ("homing_offset", j + 1), 0.0, -0.2 * reach, 0.2 * reach)
            scale = add(f"scale {joint}", ("transmission_ratio", j + 1), 1.0, 0.8, 1.2)
            transform.gain(joint, scale, target="predicted")
            transform.bias(joint, zero, target="predicted")

    def payload(spec: Any, p: Any) -> None:
        spec.body("payload").mass = float(p.value[0])

    add("payload", ("payload", "all"), 1e-6, 0.0, 1.0, payload)
    transform.delay("*", add("delay", ("delay", "all"), 0.0, -0.05, 0.05))
    if log.external_jp is not None:  # joints in units of their own noise, for they are rad and m
        noise = np.nanstd(np.diff(log.external_jp, n=2, axis=0), axis=0) / np.sqrt(6.0)
        transform.set_sensor_weights({f"joint{j + 1}": 1.0 / s for j, s in enumerate(noise)})
    return parameters, places, transform


def _sequences(spec: mujoco.MjSpec, log: CalibrationLog, nominal: Any, kp: Array, kd: Array) -> tuple[list[Any], ...]:
    """Return names, first states, controls and measurements of trajectories spread over the recording."""
    model = spec.compile()
    data = mujoco.MjData(model)
    ids = np.asarray(log.trajectory_ids)
    names, states, controls, measured = [], [], [], []
    for number in ids[np.linspace(0, len(ids) - 1, TRAJECTORIES).astype(int)]:
        part = log.select(log.trajectory == number)
        seen = part.external_jp if part.external_jp is not None else _in_base(part, nominal, model)
        if not np.isfinite(seen).all():  # it takes no gaps
            rows = np.isfinite(seen).all(axis=1)
            seen = np.column_stack([np.interp(part.time, part.time[rows], column[rows]) for column in seen.T])
        q = part.setpoint_jp
        v = np.gradient(q, part.time, axis=0)
        times = part.time - part.time[0]
        force = kp * q + kd * v + _feedforward(model, data, part, q, v, nominal["controller"]["feedforward"])
        names.append(f"trajectory {number}")
        states.append(create_initial_state(model, part.measured_jp[0], v[0]))
        controls.append(TimeSeries(times, force))
        measured.append(TimeSeries.from_names(times, seen, model))
    return names, states, controls, measured


def _feedforward(model: mujoco.MjModel, data: Any, part: CalibrationLog, q: Array, v: Array, kind: str) -> Array:
    torque = np.zeros_like(q)
    if kind == "none":
        return torque
    a, moving = np.gradient(v, part.time, axis=0), kind == "rigid-body"
    mass = 0.0 if part.payload is None else float(part.payload[0])
    model.body_mass[model.body("payload").id] = mass
    for i in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[i], moving * v[i], moving * a[i]
        mujoco.mj_inverse(model, data)
        torque[i] = data.qfrc_inverse
    return torque


def _in_base(part: CalibrationLog, nominal: Any, model: mujoco.MjModel) -> Array:
    """Return the tracker's positions in the base frame: as the nominal file says, or registered to the nominal tips."""
    from truth_mujoco.body import tips

    seen = part.tracker_cp.position
    if "T_tracker_base" in nominal:
        frame = nominal["T_tracker_base"]
        turn = Rotation.from_rotvec(frame["rotvec"])
        return turn.inv().apply(seen - np.array(frame["translation"]))
    tip, good = tips(model, part.setpoint_jp)[:, :3, 3], np.isfinite(seen).all(axis=1)
    centres = tip[good].mean(axis=0), seen[good].mean(axis=0)
    turn, _ = Rotation.align_vectors(tip[good] - centres[0], seen[good] - centres[1])
    return turn.apply(seen - centres[1]) + centres[0]


def solve(job: Job) -> dict[str, Any]:
    """Fit one case, and score both rules."""
    from truth_mujoco.arms import ARMS

    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        case = case_of(job)
        begun = time.process_time()
        off = fitted_places(case, ARMS[job.spec.arm])  # type: ignore[union-attr]
        seconds = time.process_time() - begun
    true = {(e["name"], e["joint"]) for e in label_of(dict(case.labels))["effects"] if e["known"]}
    differ = {place for place, x in off.items() if x > 1.0}
    most = max(off, key=lambda place: off[place])
    sets = {RULES[0]: differ, RULES[1]: {most} & differ}
    known = bool(true) and all(place in off for place in true)
    rules = {r: {"exact": bool(true) and s == true, "wrong": bool(s - true)} for r, s in sets.items()}
    return {"key": job.key, "suite": job.spec.suite, "can": known, "seconds": seconds, "rules": rules}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="12 trajectories of 10 s")
    parser.add_argument("--share", type=float, help="of the protocol's numbers")
    parser.add_argument("--suite", action="append", choices=list(NUMBERS["mujoco"]), help="only this set; repeatable")
    parser.add_argument(
        "--least-ratio", type=float, default=0.0, help="only cases with this much over the noise hidden"
    )
    parser.add_argument("--first-seed", type=int)
    parser.add_argument("--workers", type=int, default=-1)
    parser.add_argument("--beside", type=Path, help="results of discrepancy_blind.py on the same cases")
    parser.add_argument("--results", type=Path, default=RESULTS / "discrepancy_sysid.jsonl")
    arguments = parser.parse_args()
    arguments.truth, arguments.baselines_every = "mujoco", 0
    path: Path = arguments.results
    path.parent.mkdir(parents=True, exist_ok=True)
    entries = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {e["key"] for e in entries}
    every = list(jobs_of(arguments))
    jobs = [job for job in every if job.spec.signals != "bare"]
    print(f"{len(every) - len(jobs)} of {len(every)} cases are joints without a controller, which it cannot simulate")
    with path.open("a", encoding="utf-8") as file, workers(arguments.workers):
        for entry in each_as_done(solve, [job for job in jobs if job.key not in done]):
            entries.append(entry)
            file.write(json.dumps(entry) + "\n")
            file.flush()
    asked = {job.key for job in jobs}
    beside = arguments.beside.read_text().splitlines() if arguments.beside else []
    show([e for e in entries if e["key"] in asked], [json.loads(line) for line in beside])


def show(entries: list[dict[str, Any]], beside: list[dict[str, Any]]) -> None:
    """Print each set's table, and of the singles those that the file's numbers can say."""
    print_table(["the same cases", "n", "exact (95 %)", "a wrong name (95 %)"], list(_rows(entries, beside)))


def _rows(entries: list[dict[str, Any]], beside: list[dict[str, Any]]) -> Iterator[list[str]]:
    workflow = {e["key"]: outcome_of(e["outcome"]) for e in beside if e["outcome"] is not None}
    for suite in dict.fromkeys(e["suite"] for e in entries):
        for title, part in (
            (suite, [e for e in entries if e["suite"] == suite]),
            (f"{suite}, of which it has the numbers", [e for e in entries if e["suite"] == suite and e["can"]]),
        ):
            if not part:
                continue
            for rule in RULES:
                yield _row(f"{title}: {rule}", [e["rules"][rule] for e in part])
            own = [workflow[e["key"]] for e in part if e["key"] in workflow]
            if own:
                yield _row(f"{title}: workflow", [{"exact": o.exact, "wrong": o.wrong} for o in own])


def _row(title: str, scores: list[dict[str, bool]]) -> list[str]:
    cells = []
    for key in ("exact", "wrong"):
        share = Proportion(sum(s[key] for s in scores), len(scores))
        low, high = share.interval
        cells.append(f"{100 * share.value:.0f} % ({100 * low:.0f} to {100 * high:.0f})")
    return [title, str(len(scores)), *cells]


if __name__ == "__main__":
    main()
