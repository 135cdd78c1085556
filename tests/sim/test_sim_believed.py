"""A payload that the controller was told of, and that the arm does not carry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_sim_controller import model, motors, plan

from gpcorrect.sim import machine_of, run
from gpcorrect.sim.effects.compliance import Payload
from gpcorrect.sim.effects.dynamics import BelievedPayload


def told(feedforward: str, mass: float) -> np.ndarray:
    """Motors of an arm that is said to carry so much more, which is taken off again: its controller alone knows it."""
    nominal = machine_of(model(feedforward))
    links = replace(nominal.body.links, payload=nominal.payload(plan()) + mass)
    known = replace(nominal, body=replace(nominal.body, links=links))
    unloaded = replace(plan(), payload=np.full(1, np.nan))
    return run(known.with_effects(Payload("all", -mass)), unloaded).motion.position


@pytest.mark.parametrize("feedforward", ["gravity", "gravity-measured", "rigid-body"])
def test_it_is_fed_forward_and_not_carried(feedforward: str) -> None:
    """It is the same as an arm that is said to carry it and does not."""
    made = motors(feedforward, BelievedPayload("all", 0.3))
    np.testing.assert_allclose(made, told(feedforward, 0.3), atol=2e-6)
    assert np.abs(made - motors(feedforward)).max() > 1e-3


def test_without_feed_forward_nobody_uses_what_is_believed() -> None:
    np.testing.assert_array_equal(motors("none", BelievedPayload("all", 0.3)), motors("none"))


def test_what_is_believed_and_carried_is_a_payload_that_the_model_knows() -> None:
    """At rest nothing is left of the two together."""
    both = motors("gravity", BelievedPayload("all", 0.3), Payload("all", 0.3))
    alone = motors("gravity", Payload("all", 0.3))
    assert np.abs(both - motors("gravity")).max() < 0.5 * np.abs(alone - motors("gravity")).max()
