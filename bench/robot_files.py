"""Robot files of other people beside MuJoCo: which arms of a folder's files are read, and whether both agree on them.

Every MJCF and URDF file of the folder is tried, with every body at the end of a branch for a tool. Tip poses and
inverse dynamics of random states are held against MuJoCo's own, without shapes, for public packages rarely bring the
meshes along. Such packages are `example-robot-data` (URDF), `robosuite`, `dm-control` and `gymnasium-robotics` (MJCF):

    pip download --no-deps example-robot-data && unzip -q example_robot_data*.whl -d robots
    python bench/robot_files.py robots
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from support import print_table, save_results

from gpcorrect import se3
from gpcorrect.arms import is_robot_file, read_robot
from gpcorrect.errors import DataError
from gpcorrect.sim import machine_of, model_from_dict
from gpcorrect.sim.dynamics import posture_at

STATES = 6
TOOLS = 12  # of a file, at most
REACH = 2.0  # rad or m around zero that states are drawn from, within the joints' limits
PASSIVE = ("FRICTIONLOSS", "LIMIT", "DAMPER", "CONTACT", "EQUALITY", "ACTUATION")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("folder", type=Path)
    folder = options.parse_args().folder
    rows, refused = [], Counter[str]()
    for path in sorted(file for file in folder.rglob("*") if is_robot_file(file) and _is_robot(file)):
        agreed = []
        for tool in _tools(path):
            try:
                agreed.append(difference(path, tool))
            except DataError as error:
                refused[reason(error, path)] += 1
        if agreed:
            rows.append([str(path.relative_to(folder)), len(agreed), *np.max(agreed, axis=0)])
    print_table(("file", "arms", "position, m", "turn, rad", "torque / largest"), rows)
    if not rows:
        print("no arm of this folder is read")
        return
    worst = " ".join(f"{value:.2g}" for value in np.max([row[2:] for row in rows], axis=0))
    print(f"\n{sum(row[1] for row in rows)} arms of {len(rows)} files; at worst {worst}")
    print("refused:", *(f"{count:5d}  {why}" for why, count in refused.most_common()), sep="\n")
    save_results("robot_files", {"files": rows, "refused": dict(refused)})


def difference(path: Path, tool: str | None) -> tuple[float, float, float]:
    """Largest differences of an arm from MuJoCo's over random states: of tip poses, and of torques beside the largest.

    The base is compared too: an arm's frame is the world's.
    """
    named = {} if tool is None else {"tool": tool}
    robot, model = read_robot(path, **named), without_shapes(path)
    machine = machine_of(model_from_dict({"robot": path.name, **named}, folder=path.parent))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    joints = [model.joint(name) for name in robot.joints]
    places, dofs = [joint.qposadr[0] for joint in joints], [joint.dofadr[0] for joint in joints]
    lower, upper = np.clip(robot.arm.chain.limits.T, -REACH, REACH)
    apart, largest = np.zeros(3), 0.0
    for _ in range(STATES):
        q, velocity, acceleration = rng.uniform(lower, upper), *rng.uniform(-1, 1, (2, len(joints)))
        data.qpos[places], data.qvel[dofs], data.qacc[dofs] = q, velocity, acceleration
        mujoco.mj_inverse(model, data)
        still, moving = posture_at(machine.body, q[None, None]).loads(velocity[None, None], acceleration[None, None])
        torque = (still + moving)[0, 0] + model.dof_armature[dofs] * acceleration
        twist = se3.log(se3.invert(tip(model, data, robot.tool)) @ robot.arm.forward(q))
        away = (np.abs(twist[:3]).max(), np.abs(twist[3:]).max(), np.abs(torque - data.qfrc_inverse[dofs]).max())
        apart, largest = np.maximum(apart, away), max(largest, np.abs(data.qfrc_inverse[dofs]).max())
    return float(apart[0]), float(apart[1]), float(apart[2] / max(largest, 1.0))


def tip(model: Any, data: Any, name: str) -> np.ndarray:
    """Pose (4, 4) of a site, or of a body where no site has the name."""
    sites = [model.site(s).name for s in range(model.nsite)]
    at = data.site(name) if name in sites else data.body(name)
    return se3.pose(at.xmat.reshape(3, 3), at.xpos)


def without_shapes(path: Path) -> Any:
    """MuJoCo's model of a file, all that acts beside gravity, inertia and springs switched off."""
    spec = mujoco.MjSpec.from_file(str(path))
    bodies, is_urdf = list(spec.bodies)[1:], path.suffix.lower() == ".urdf"
    for body in bodies:
        if is_urdf and not _moves(body):
            body.mass, body.fullinertia, body.explicitinertial = 0.0, np.full(6, np.nan), False
    for shape in [geom for geom in spec.geoms if geom.meshname or is_urdf]:
        spec.delete(shape)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    spec.compiler.fusestatic &= not is_urdf
    try:
        model = spec.compile()
    except ValueError as error:
        raise DataError(str(error)) from error
    for what in PASSIVE:
        model.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{what}")
    return model


def _moves(body: Any) -> bool:
    return body is not None and (bool(body.joints) or _moves(body.parent))


def _is_robot(path: Path) -> bool:
    return any(word in path.read_text(encoding="utf-8", errors="replace") for word in ("<mujoco", "<robot"))


def _tools(path: Path) -> list[str | None]:
    """No tool, and bodies without another behind them, some of them where there are many."""
    try:
        model = without_shapes(path)
    except (DataError, ValueError):
        return [None]
    ends = sorted(set(range(1, model.nbody)) - set(model.body_parentid))
    names = [model.body(b).name for b in ends[:: max(1, len(ends) // TOOLS)]]
    return [None, *filter(None, names)]


def reason(error: DataError, path: Path) -> str:
    """Return the first words of a refusal, without names and numbers."""
    words = error.message.replace(str(path), "").replace(path.name, "").strip(": ")
    return " ".join(re.sub(r"'[^']*'|\d+", "...", words).split()[:6])


if __name__ == "__main__":
    main()
