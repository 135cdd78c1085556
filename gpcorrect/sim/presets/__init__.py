"""Model files that come with the package."""

from __future__ import annotations

import tomllib
from importlib import resources

from gpcorrect.errors import DataError
from gpcorrect.sim.model import Model, model_from_dict

__all__ = ["preset", "preset_names"]


def preset_names() -> tuple[str, ...]:
    """Names that :func:`preset` knows."""
    files = resources.files(__name__).iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")))


def preset(name: str) -> Model:
    """Return a packaged model.

    Raises
    ------
    DataError
        No preset has that name.
    """
    if name not in preset_names():
        raise DataError(f"no preset is called {name!r}.", hint=f"Known presets: {', '.join(preset_names())}.")
    text = resources.files(__name__).joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return model_from_dict(tomllib.loads(text), source=f"preset {name}")
