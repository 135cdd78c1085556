"""A hidden cause means what the catalogue means: the product's effect with the hidden numbers does the same.

Compared is what the cause alone does to the motion, without sensor noise: truth with it less truth without it, against
the product's simulator with the effect less without. The share of the one that the other explains is 1 for equal
operators; what the two do not share is stated below, effect by effect.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from truth import CATALOGUE, Spec
from truth.case import Truth, make_truth

from gpcorrect.sim import (
    EFFECTS,
    Effect,
    Outcome,
    Plan,
    Segment,
    effect_from_dict,
    machine_of,
    model_from_dict,
    plan_of,
    run,
)
from gpcorrect.sim.effects import EncoderQuantisation, Hysteresis
from gpcorrect.sim.effects.operators import PAUSES
from gpcorrect.sim.motion import Readings

RATE = 100.0
SECONDS = 5.0
SEED = 3
# Share of the trace that the product's operator explains at least. Each run begins with an empty memory in the product,
# while the hidden machine comes from the run before: backlash, friction and creep differ until that is overwritten
WHOLE = {
    "backlash": 0.85, "coulomb_friction": 0.85, "stribeck_friction": 0.75, "position_dependent_friction": 0.75,
    "capstan_friction": 0.9, "creep": 0.5, "joint_stop": 0.95,
}  # fmt: skip
ELSE = 0.985
# ... and where it has been: with it the operators are the same
LATE = {"backlash", "coulomb_friction", "stribeck_friction", "position_dependent_friction", "capstan_friction"}
BOUC_WEN = 0.85  # share of a hidden hysteresis that the fitted element explains at least
NO_TRACE = {"hysteresis", "encoder_quantisation", "noise_change"}  # tested by themselves


@dataclass(frozen=True, eq=False)
class Pair:
    """A hidden cause and the product's machine without it and with it, both along the same path."""

    truth: Truth
    label: dict
    without: Outcome
    with_it: Outcome | None

    @property
    def rows(self) -> np.ndarray:
        return self.truth.setting.reference.logged

    @property
    def noise(self) -> np.ndarray:
        return np.array(self.truth.case.labels["nuisance"]["noise_rms"])

    def traces(self) -> tuple[np.ndarray, np.ndarray]:
        """Return what the cause does, in units of the noise, hidden and by the product, runs apart `(N, n, 3)`."""
        before, after = self.truth.setting.readings, self.truth.readings
        if CATALOGUE[self.label["name"]].tracker_only:
            hidden = (after.tip - before.tip)[self.rows, :3, 3]
            ours = (self.with_it.T_base_tip - self.without.T_base_tip)[..., :3, 3]
        else:
            hidden, ours = (after.outside - before.outside)[self.rows], self.with_it.q - self.without.q
        ours = np.swapaxes(ours, 0, 1)
        return hidden.reshape(ours.shape) / self.noise, ours / self.noise


def _plan(truth: Truth) -> Plan:
    reference = truth.setting.reference
    rows = reference.logged
    q = reference.position[::2][rows]
    segments = []
    for number in np.unique(reference.trajectory[rows]):
        here = reference.trajectory[rows] == number
        first = rows[here][0]
        start, payload = float(reference.session_time[first]), float(reference.payload[first])
        segments.append(Segment(q[here], reference.trajectory[rows][here], 0, start, payload))
    return plan_of(segments, RATE)


def _effect(label: dict) -> Effect:
    params = {k: float("inf") if v == "inf" else v for k, v in label["params"].items()}
    return effect_from_dict({"name": label["name"], "joint": label["joint"]} | params)


@cache
def _pair(name: str) -> Pair:
    signals = "tracker" if CATALOGUE[name].tracker_only else "joints"
    truth = make_truth(Spec("one", (name,), 2.0, signals, trajectories=4, seconds=SECONDS), SEED)
    (label,) = truth.case.labels["effects"]
    plan, model = _plan(truth), model_from_dict(dict(truth.case.nominal))
    effect = None if name == "hysteresis" else _effect(label)
    with_it = None if effect is None else run(machine_of(model.with_effects(effect)), plan)
    return Pair(truth, dict(label), run(machine_of(model), plan), with_it)


def _explained(hidden: np.ndarray, ours: np.ndarray) -> float:
    return float(1.0 - np.sum((hidden - ours) ** 2) / np.sum(hidden**2))


@pytest.mark.parametrize("name", sorted(set(CATALOGUE) - NO_TRACE))
def test_the_products_effect_with_the_hidden_numbers_does_what_the_hidden_one_does(name: str) -> None:
    """Names, units and signs of the labels are the catalogue's, and the two operators agree."""
    pair = _pair(name)
    hidden, ours = pair.traces()
    assert _explained(hidden, ours) > WHOLE.get(name, ELSE)
    if name in LATE:
        half = hidden.shape[1] // 2
        assert _explained(hidden[:, half:], ours[:, half:]) > ELSE
    if name == "creep":
        assert _explained(hidden, ours + _fading(hidden - ours, pair.label["params"]["time_constant"])) > 0.995


def test_a_held_load_is_what_the_hidden_creep_remembers() -> None:
    """The hidden payload changes as the next run begins: of the three pauses, the held one explains the most."""
    pair, shares = _pair("creep"), {}
    plan, model = _plan(pair.truth), model_from_dict(dict(pair.truth.case.nominal))
    for pause in PAUSES:
        effect = replace(_effect(pair.label), pause=pause)
        ours = replace(pair, with_it=run(machine_of(model.with_effects(effect)), plan))
        shares[pause] = _explained(*ours.traces())
    assert max(shares, key=lambda pause: shares[pause]) == "held"
    assert 1.0 - shares["held"] < 0.5 * (1.0 - shares["linear"])


def _fading(rest: np.ndarray, time_constant: float) -> np.ndarray:
    """Part of the rest that fades from each run's start: the strain with which the run began."""
    law = np.exp(-np.arange(rest.shape[1]) / RATE / time_constant)
    size = np.einsum("rnk,n->rk", rest, law) / (law @ law)
    fading: np.ndarray = size[:, None] * law[:, None]
    return fading


def test_the_catalogues_are_the_same() -> None:
    """The hidden causes are the product's effects by name, but for those that MuJoCo's truth alone has."""
    assert set(CATALOGUE) == set(EFFECTS) - {
        "feedforward_error",
        "gain_error",
        "speed_noise",
        "command_delay",
        "inertia_error",
        "link_mass_error",
        "centre_of_mass_error",
        "gravity_error",
        "joint_spring",
        "missing_friction",
        "velocity_filter",
        "integral_action",
        "motor_constant_error",
        "loaded_backlash",
        "believed_payload",
    }


@pytest.mark.parametrize("name", sorted(set(CATALOGUE) - {"hysteresis"}))
def test_hidden_numbers_are_physical(name: str) -> None:
    """What is hidden lies in the range that the catalogue calls physical; hysteresis has numbers of its own."""
    label = _pair(name).label
    effect = _effect(label)
    for parameter in effect.about.parameters:
        if parameter.only is not None and getattr(effect, parameter.only[0]) not in parameter.only[1:]:
            continue  # of another choice
        span = parameter.range("P" if label["joint"] == 3 else "R")
        assert span.low <= getattr(effect, parameter.name) <= span.high


def test_a_bouc_wen_element_explains_most_of_an_uneven_preisach_plane() -> None:
    """No numbers translate: fitted, the product's hysteresis explains most of it, and more than its backlash does."""
    pair = _pair("hysteresis")
    column = pair.label["joint"] - 1
    before, after = pair.truth.setting.readings, pair.truth.readings
    hidden = (after.outside - before.outside)[pair.rows, column].reshape(4, -1).T / pair.noise[column]
    late = slice(len(hidden) // 2, None)

    def ours(numbers: np.ndarray) -> np.ndarray:
        effect = Hysteresis(column + 1, *np.exp(numbers).tolist())
        q = pair.without.q
        return (effect.act(q, pair.without.motion) - q)[..., column] / pair.noise[column]

    start = np.log([2.0 * pair.noise[column], 1.0])
    bounds = (np.log([1e-7, 0.3]), np.log([0.3, 20.0]))
    fit = least_squares(lambda x: (ours(x) - hidden)[late].ravel(), start, bounds=bounds, diff_step=1e-3, max_nfev=20)
    assert _explained(hidden[late], ours(fit.x)[late]) > BOUC_WEN
    sharp = min(
        np.sum((ours(np.array([r, np.log(20.0)])) - hidden)[late] ** 2) for r in start[0] + np.linspace(-2, 1, 25)
    )
    assert 2.0 * fit.cost < sharp


def test_counts_of_an_encoder_are_the_same() -> None:
    """The product's quantisation of the true motor path gives the very numbers that were written down."""
    pair = _pair("encoder_quantisation")
    column = pair.label["joint"] - 1
    motor = pair.truth.setting.readings.reported[pair.rows][:, None]
    effect = EncoderQuantisation(pair.label["joint"], pair.label["params"]["step"])
    plain = Readings(motor, motor, motor, motor, None)
    written = effect.operator(np.random.default_rng(0))(plain, pair.without.motion).measured_jp[:, 0, column]
    np.testing.assert_allclose(written, pair.truth.readings.reported[pair.rows, column], atol=1e-9)


def test_noise_is_higher_by_as_much_and_from_the_moment_that_the_label_says() -> None:
    """Before it the recording's noise is the declared one; after it the variances add."""
    pair = _pair("noise_change")
    column, params = pair.label["joint"] - 1, pair.label["params"]
    rest = pair.truth.case.log.external_jp[:, column] - pair.truth.readings.outside[pair.rows, column]
    later = pair.truth.setting.reference.session_time[pair.rows] >= params["since"]
    spread = [1.4826 * np.nanmedian(np.abs(rest[rows])) for rows in (~later, later)]
    assert spread[0] == pytest.approx(pair.noise[column], rel=0.25)
    assert spread[1] == pytest.approx(np.hypot(pair.noise[column], params["std"]), rel=0.25)
