"""The model file: what is known of a machine, as TOML, strict, and the same when written back.

Beside a robot file, effects are written in that file's own words where it has them.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, SerializeAsAny, ValidationError, field_serializer, field_validator

from gpcorrect.arms import RobotEdit, is_robot_file, read_robot
from gpcorrect.atomic import write_file
from gpcorrect.errors import DataError
from gpcorrect.plain import toml_text
from gpcorrect.sim.body import Feedforward
from gpcorrect.sim.effects import Effect, Stage, effect_from_dict, in_order
from gpcorrect.sim.effects.compliance import GravityError, JointSpring, LinkMassError, Payload
from gpcorrect.sim.effects.dynamics import InertiaError, MissingFriction
from gpcorrect.sim.effects.geometry import DhError
from gpcorrect.sim.effects.limit import JointStop, TorqueSaturation
from gpcorrect.sim.effects.reversal import CoulombFriction, ViscousFriction
from gpcorrect.sim.settings import Noise, NonNegative, Number, Positive, Settings, TrackerFaults

PRESETS = resources.files("gpcorrect.sim") / "presets"  # model files that come with the package
Vector = tuple[Number, Number, Number]
Moments = tuple[NonNegative, NonNegative, NonNegative]
JointNumber = Annotated[int, Field(strict=True, ge=1)]


class Pose(Settings):
    """A rigid motion: translation in m and rotation vector in rad."""

    translation: Vector = (0.0, 0.0, 0.0)
    rotvec: Vector = (0.0, 0.0, 0.0)


class Controller(Settings):
    """Motor-side PD or PID control; gains in joint units."""

    kp: tuple[Positive, ...]
    kd: tuple[NonNegative, ...]
    ki: tuple[NonNegative, ...] | None = None
    rate_hz: Positive = 1000.0
    feedback: Literal["motor"] = "motor"
    feedforward: Feedforward = "none"


class TransmissionTable(Settings):
    """Drive train: the motors' inertia reflected to the joints, kg m^2 or kg."""

    motor_inertia: tuple[Positive, ...]


class LinkTable(Settings):
    """Masses of links 1, 2, ... (kg), their centres (m) and principal moments (kg m^2), each in its own link frame."""

    mass: tuple[NonNegative, ...]
    com: tuple[Vector, ...]
    inertia_diagonal: tuple[Moments, ...] | None = None


class Model(Settings):
    """All that the simulator takes of a machine; what is absent comes from the arm's own description.

    Parameters
    ----------
    arm : str
        "raven2_left", "raven2_right", "dvrk_psm", or "joints" for a bare joint chain with no kinematics; with a robot
        file only a name for logs.
    joints : tuple of int, numbers of the joints that the logs speak of, from the base on
    robot : str
        Robot file, MJCF or URDF; in a model file relative to it, and `joints` may there be names, or absent for all.
    tool, base : str
        Of the robot file: body or site whose frame is the tip, and body whose frame is the base; see
        :func:`gpcorrect.arms.read_robot`.
    joint_types : str, "R" or "P" for each of them; only for bare joints, "R" throughout when absent
    wrist : tuple of float, where the arm's other joints are held, rad or m; at home when absent
    theta_offset_deg : tuple of float
        Joint value to DH theta, degrees, of revolute joints; the arm's own when absent.
    gravity : (3,) tuple, m/s^2, base frame
    payload : float, kg at the tip
    log_rate_hz : float, of recordings
    T_tracker_base, T_tip_marker : Pose, base in the tracker frame, and tracked marker in the tip frame
    controller, transmission, links, noise, faults : tables
    effects : tuple of Effect, what the model already has beyond the nominal machine
    """

    arm: str
    joints: Annotated[tuple[JointNumber, ...], Field(min_length=1)]
    robot: str | None = None
    tool: str | None = None
    base: str | None = None
    joint_types: Annotated[str, Field(pattern="^[RP]+$")] | None = None
    wrist: tuple[Number, ...] | None = None
    theta_offset_deg: tuple[Number, ...] | None = None
    gravity: Vector | None = None
    payload: NonNegative = 0.0
    log_rate_hz: Positive = 100.0
    T_tracker_base: Pose | None = None
    T_tip_marker: Pose | None = None
    controller: Controller | None = None
    transmission: TransmissionTable | None = None
    links: LinkTable | None = None
    noise: Noise | None = None
    faults: TrackerFaults | None = None
    effects: tuple[SerializeAsAny[Any], ...] = ()

    @field_validator("effects", mode="before")
    @classmethod
    def _read_effects(cls, value: Any) -> tuple[Effect, ...]:
        return in_order(v if isinstance(v, Effect) else effect_from_dict(v) for v in value)

    @field_serializer("effects")
    def _write_effects(self, effects: tuple[Effect, ...]) -> list[dict[str, Any]]:
        return [effect.to_dict() for effect in effects]

    def with_effects(self, *effects: Effect) -> Model:
        """Return the model with these effects instead of its own."""
        return self.model_copy(update={"effects": in_order(effects)})


def model_from_dict(values: Mapping[str, Any], source: str = "model", folder: Path | None = None) -> Model:
    """Check plain values and return the model.

    Parameters
    ----------
    values : mapping, keys of a model file
    source : str, what the message of an error begins with
    folder : Path, optional, what the path of a robot file is relative to

    Raises
    ------
    DataError
        A key is unknown or missing, or a value has the wrong type or range; the message names every one. Or the robot
        file holds no such arm.
    """
    plain = dict(values)
    if isinstance(plain.get("robot"), str):
        plain |= _of_robot(plain, Path() if folder is None else folder)
    elif "tool" in plain or "base" in plain:
        raise DataError(f"{source}: tool and base are of a robot file.", hint='Name it: robot = "robot.xml".')
    try:
        return Model.model_validate(plain)
    except ValidationError as error:
        problems = "; ".join(_problem(e["loc"], e["type"], e["msg"]) for e in error.errors())
        raise DataError(f"{source}: {problems}.", hint="See docs/simulator.md for the keys of a model file.") from error


def _of_robot(values: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return path, joint numbers, tool and name of a model with a robot file."""
    joints = values.get("joints", ())
    names = [joint for joint in joints if isinstance(joint, str)] if isinstance(joints, Sequence) else []
    path = (folder / values["robot"]).absolute()
    robot = read_robot(path, names or None, values.get("tool"), values.get("base"))
    found: dict[str, Any] = {"robot": str(path), "tool": robot.tool, "arm": values.get("arm", robot.arm.name)}
    if not joints:
        found["joints"] = tuple(range(1, robot.arm.dof + 1))
    elif names:
        found["joints"] = tuple(robot.joints.index(j) + 1 if isinstance(j, str) else j for j in joints)
    return found


def read_model(path: str | Path) -> Model:
    """Read a model file, or a robot file (MJCF, URDF) as a model of all its joints.

    Parameters
    ----------
    path : str or Path, of the file

    Raises
    ------
    DataError
        The file cannot be read, is no TOML, or :func:`model_from_dict` refuses it.
    """
    file = Path(path)
    if is_robot_file(file):
        return model_from_dict({"robot": file.name}, source=str(path), folder=file.parent)
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"cannot read the model file {path}: {error}.") from error
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DataError(f"{path} is no TOML: {error}.") from error
    return model_from_dict(values, source=str(path), folder=file.parent)


def model_key(model: Model) -> str:
    """Return a text that changes when the model, or what its robot file says of the arm, changes.

    Parameters
    ----------
    model : Model
    """
    digest = "" if model.robot is None else read_robot(model.robot, tool=model.tool, base=model.base).digest
    return model.model_dump_json() + digest


def model_text(model: Model) -> str:
    """Return the TOML of a model, without the keys that say nothing.

    Parameters
    ----------
    model : Model
    """
    return toml_text(model.model_dump(mode="python", exclude_none=True, exclude_defaults=True))


def write_model(model: Model, path: str | Path) -> None:
    """Write a model file, whole or not at all; `read_model` gives the same model back.

    Parameters
    ----------
    model : Model
    path : str or Path, of the file; a robot file is named relative to it
    """
    if model.robot is not None:
        model = model.model_copy(update={"robot": Path(os.path.relpath(model.robot, Path(path).parent)).as_posix()})
    write_file(path, model_text(model))


def preset_names() -> tuple[str, ...]:
    """Names that :func:`preset` knows."""
    files = PRESETS.iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")))


def preset(name: str) -> Model:
    """Return a packaged model.

    Parameters
    ----------
    name : str, one of :func:`preset_names`

    Raises
    ------
    DataError
        No preset has that name.
    """
    if name not in preset_names():
        raise DataError(f"no preset is called {name!r}.", hint=f"Known presets: {', '.join(preset_names())}.")
    text = PRESETS.joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return model_from_dict(tomllib.loads(text), source=f"preset {name}")


def _problem(location: tuple[int | str, ...], kind: str, message: str) -> str:
    key = ".".join(map(str, location))
    match kind:
        case "extra_forbidden":
            return f"unknown key {key}"
        case "missing":
            return f"{key} is missing"
        case _:
            return f"{key}: {message.removeprefix('Value error, ').removesuffix('.')}"


@dataclass(frozen=True)
class Written:
    """What was written.

    Parameters
    ----------
    model : Path, the model file
    robot : Path or None, the robot file, which the model file names; None where the model has none
    words : tuple of Effect, effects that are in the robot file
    """

    model: Path
    robot: Path | None = None
    words: tuple[Effect, ...] = ()


def write_completed(model: Model, path: Path) -> Written:
    """Write a model with its effects; a robot file goes beside the model file, as MJCF with the same stem.

    Parameters
    ----------
    model : Model
    path : Path, of the model file (TOML)

    Raises
    ------
    DataError
        The robot file would be written over the one that was read.
    """
    if model.robot is None:
        write_model(model, path)
        return Written(path)
    edit, robot = RobotEdit(model.robot, model.tool, model.base), path.with_suffix(".xml")
    left = [effect for effect in model.effects if not _in_own_words(edit, effect, model)]
    edit.write(robot)
    write_model(model.with_effects(*left).model_copy(update={"robot": str(robot.absolute())}), path)
    return Written(path, robot, tuple(effect for effect in model.effects if effect not in left))


def _in_own_words(edit: RobotEdit, effect: Effect, model: Model) -> bool:
    """Put an effect into a robot file; return whether the file says all of it."""
    if isinstance(effect.joint, int) and _acts_on_motor(effect, model.effects):
        return _on_joint(edit, effect, effect.joint)
    # A controller that computes torques from the file's masses and geometry must not know what was found.
    weighs = model.controller is None or model.controller.feedforward == "none"
    match effect:
        case InertiaError(joint=int(joint), inertia=inertia) if weighs and model.transmission is None:
            return edit.add_inertia(joint, inertia)
        case Payload(mass=mass, x=x, y=y, z=z, place=where) if mass > 0.0 and weighs and model.links is None:
            return edit.add_payload(mass, (x, y, z) if where == "beside" else (0.0, 0.0, 0.0))
        case LinkMassError(joint=int(joint), mass=mass) if mass > 0.0 and weighs and model.links is None:
            return edit.add_link_mass(joint, mass)
        case GravityError(x=x, y=y, z=z) if weighs and model.gravity is None:
            return edit.add_gravity((x, y, z))
        case DhError(joint=int(joint)) if weighs:
            return edit.move_joint(joint, effect.motion("modified"))
    return False


def _on_joint(edit: RobotEdit, effect: Effect, joint: int) -> bool:
    """Put an effect that resists or drives one joint into a robot file."""
    match effect:
        case CoulombFriction(rest="soft", torque=torque, onset=onset, onset_time=time) if onset > 0.0:
            return edit.add_soft_friction(joint, torque, onset, time)
        case CoulombFriction() if effect.law().bristle > 0.0:
            return False  # MuJoCo's friction does not bend
        case CoulombFriction(torque=torque):
            edit.add_friction(joint, torque)
        case ViscousFriction(damping=damping):
            edit.add_damping(joint, damping)
        case MissingFriction(part=part, term=term):
            return edit.lose_friction(joint, term, part)
        case TorqueSaturation(limit=limit):
            return edit.limit_torque(joint, limit)
        case JointSpring(stiffness=stiffness, push=push):
            return edit.add_spring(joint, stiffness, push)
        case JointStop(limit=limit, end=end):
            edit.limit_range(joint, end, limit)
            return False  # the file has the place, but no stiffness in N m/rad
        case _:
            return False
    return True


def _acts_on_motor(effect: Effect, others: tuple[Effect, ...]) -> bool:
    """Whether it resists or drives a joint, and not behind a transmission that gives way, which no file has."""
    kinds = (CoulombFriction, ViscousFriction, MissingFriction, TorqueSaturation, JointSpring, JointStop)
    behind = isinstance(effect, JointSpring) or getattr(effect, "side", "") == "joint"
    soft = {other.joint for other in others if other.stage == Stage.TRANSMISSION}
    return isinstance(effect, kinds) and not (behind and effect.joint in soft)
