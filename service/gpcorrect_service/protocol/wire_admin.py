"""The messages of those who run a server: which models it has, which one answers, and whether it answers at all."""

from __future__ import annotations

from typing import Literal

import msgspec

__all__ = ["ActivateAnswer", "ActivateRequest", "ModelEntry", "ModelListAnswer", "StateAnswer", "StateRequest"]


class ActivateRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which model of the server's store is to answer: its name, or the beginning of its hash."""

    model: str


class ActivateAnswer(msgspec.Struct, frozen=True):
    """Which model answers now, and which one did before."""

    id: str
    hash: str
    kind: str
    before: str
    replica: str


class ModelEntry(msgspec.Struct, frozen=True):
    """One model of a store."""

    id: str
    hash: str
    kind: str
    added: float
    active: bool


class ModelListAnswer(msgspec.Struct, frozen=True):
    """The models of the server's store, oldest first, and those that answered before, latest last, by kind."""

    replica: str
    models: list[ModelEntry]
    history: dict[str, list[str]]
    serving: dict[str, str]


class StateRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """PAUSED stops corrections, ENABLED goes on, and ends a FAULT."""

    state: Literal["ENABLED", "PAUSED"]


class StateAnswer(msgspec.Struct, frozen=True):
    """The state after the change."""

    state: str
    replica: str
