"""What a fit may be told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from gpcorrect.cleaning import CleaningSettings
from gpcorrect.gpr import FeatureMap
from gpcorrect.rigid import MarkerOption

__all__ = ["MEMORY", "FitSettings"]

MEMORY = "memory"


@dataclass(frozen=True)
class FitSettings:
    """What `fit_corrector` may be told.

    Parameters
    ----------
    features : tuple of str
        "pose" (or "euler": the paper's angles), "velocity", and "memory": states of play operators of the path so far.
    clean : bool
        Reject faulty samples first.
    cleaning : CleaningSettings
        Limits of the cleaning.
    rigid : bool
        Register frames first; without it the regression learns from the observed pose as it is.
    marker : str
        "none", "solve" or "auto": whether the marker may be away from the tool tip.
    inducing : int
        Inducing points of the sparse regression.
    time_offset : str
        "auto", "none", or seconds by which the tracker's stamps run ahead of the commands'.
    velocity_step : float, None or "auto"
        Step of the stencil on recorded paths, s, through all samples within two steps on either side; None takes five
        neighbouring samples, "auto" a step that keeps the tracker's noise out of the velocities.
    seed : int
        Seed of everything random.

    Raises
    ------
    DataError
        A feature is unknown.
    """

    features: tuple[str, ...] = ("pose", "velocity")
    clean: bool = True
    cleaning: CleaningSettings = field(default_factory=CleaningSettings)
    rigid: bool = True
    marker: MarkerOption = "auto"
    inducing: int = 700
    time_offset: str = "auto"
    velocity_step: float | Literal["auto"] | None = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        FeatureMap([kind for kind in self.features if kind != MEMORY])  # refuses unknown ones
