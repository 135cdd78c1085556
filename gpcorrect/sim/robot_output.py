"""A model with a robot file, written: effects in that file's own words where it has them, the others beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gpcorrect.arms import Chain, Joint, RobotEdit
from gpcorrect.sim.effects import Effect, Stage
from gpcorrect.sim.effects.compliance import Payload
from gpcorrect.sim.effects.geometry import DhError
from gpcorrect.sim.effects.limit import JointStop, TorqueSaturation
from gpcorrect.sim.effects.reversal import CoulombFriction, ViscousFriction
from gpcorrect.sim.model import Model, write_model


@dataclass(frozen=True)
class Written:
    """What was written.

    Parameters
    ----------
    model : Path
        The model file.
    robot : Path or None
        The robot file, which the model file names; None where the model has none.
    words : tuple of Effect
        Effects that are in the robot file.
    """

    model: Path
    robot: Path | None = None
    words: tuple[Effect, ...] = ()


def write_completed(model: Model, path: Path) -> Written:
    """Write a model with its effects; a robot file goes beside the model file, as MJCF with the same stem.

    Parameters
    ----------
    model : Model
    path : Path
        Of the model file (TOML).

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
    joint = effect.joint
    match effect:
        case CoulombFriction(torque=torque) if isinstance(joint, int) and not _felt_behind(effect, model.effects):
            edit.add_friction(joint, torque)
            return True
        case ViscousFriction(damping=damping) if isinstance(joint, int) and not _felt_behind(effect, model.effects):
            edit.add_damping(joint, damping)
            return True
        case TorqueSaturation(limit=limit) if isinstance(joint, int):
            return edit.limit_torque(joint, limit)
        case Payload(mass=mass) if not _fed_forward(model) and model.links is None:
            edit.add_payload(mass)
            return True
        case DhError(alpha=alpha, a=a, d=d, theta=theta) if isinstance(joint, int) and not _fed_forward(model):
            row = Joint("R", alpha, a, d, theta, -1.0, 1.0)
            return edit.move_joint(joint, Chain((row,), "modified").forward([0.0]))
        case JointStop(limit=limit, end=end) if isinstance(joint, int):
            edit.limit_range(joint, end, limit)
    return False  # of a stop the file has the place, but no stiffness in N m/rad


def _fed_forward(model: Model) -> bool:
    """Whether the controller computes torques from the file's masses and geometry: it must not know what was found."""
    return model.controller is not None and model.controller.feedforward != "none"


def _felt_behind(effect: CoulombFriction | ViscousFriction, others: tuple[Effect, ...]) -> bool:
    """Whether the friction acts behind a transmission that gives way, where a robot file has no friction."""
    soft = {other.joint for other in others if other.stage == Stage.TRANSMISSION}
    return effect.side == "joint" and effect.joint in soft
