"""Whether one model may take the place of another: the same arm, frames, joints, and the same question answered."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gpcorrect.errors import ArtifactError

SAME = ("robot", "arm", "frames", "types", "direction", "input")
"""What a description must not say otherwise where both say it."""


def refuse_other_use(name: str, new: Mapping[str, Any], old: Mapping[str, Any]) -> None:
    """Refuse a model that means another thing than the one it follows.

    Parameters
    ----------
    name : str
        What to call the new model.
    new, old : mapping
        Descriptions, as :meth:`gpcorrect.calibration.task.Corrector.info` gives them.

    Raises
    ------
    ArtifactError
        It was learned on another arm, answers in other frames, or joints of another kind, of another signal, or in
        the other direction.
    """
    for what in SAME:
        one, other = old.get(what), new.get(what)
        if one and other and one != other:
            raise ArtifactError(
                f"model {name} has {what} {other}, the active model {one}.",
                hint="Activate a model of this arm and use; another arm has its own server, store and folder.",
            )
