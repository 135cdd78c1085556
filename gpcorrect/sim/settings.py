"""The base of what is read from a model file: frozen, typed, and deaf to no unknown key."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["NonNegative", "Number", "Positive", "Settings", "Share"]

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0)]
NonNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0)]
Share = Annotated[float, Field(strict=True, ge=0, lt=1)]


class Settings(BaseModel):
    """A table of a model file; a key that it does not have is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)
