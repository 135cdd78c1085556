"""Geometry: zeros, ratios, coupling, pulleys, registration, table errors; ratios act about the pose of homing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from truth import alike
from truth.alike import ROW_TERMS, SIMILARITY, draw_row, draw_similarity, moved, row_changed
from truth.kinds.kind import at
from truth.reference import Reference

from truth_mujoco.causes.cause import Array, Cause, Params, Scene, column
from truth_mujoco.plant import PER_TICK, Plant

HOMING = 0.35  # of half the range about its middle, where an arm is homed


def _home(rng: np.random.Generator, j: int, scene: Scene) -> float:
    low, high = scene.arm.ranges[j]
    return float(0.5 * (low + high) + HOMING * 0.5 * (high - low) * rng.uniform(-1, 1))


def _homing(params: Params, j: int, plant: Plant) -> Plant:
    offsets = np.atleast_1d(params["offset"])

    def more(reference: Reference, time: Array) -> Array:
        session = np.repeat(reference.session, PER_TICK) if len(offsets) > 1 else np.zeros(len(time), dtype=np.int64)
        return column(len(time), plant.arm.dof, j, offsets[session])

    return plant.with_offset(more)


def _draw_ratio(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    home = _home(rng, j, scene)
    return {"error": alike.sign(rng) * float(scene.noise[j]) / alike.rms(scene.path(j) - home), "home": home}


def _ratio(params: Params, j: int, plant: Plant) -> Plant:
    """Return a plant that reports q + s (q - home)."""
    mapping = np.array(plant.mapping)
    mapping[j, j] += params["error"]
    return replace(plant, mapping=mapping, home=at(plant.home, j, params["home"]))


def _draw_coupling(rng: np.random.Generator, j: int, scene: Scene) -> Params:
    k = scene.other(rng, j)
    home = _home(rng, k, scene)
    return {
        "source": k + 1,
        "coefficient": alike.sign(rng) * float(scene.noise[j]) / alike.rms(scene.path(k) - home),
        "home": home,
    }


def _coupling(params: Params, j: int, plant: Plant) -> Plant:
    """Return a plant that reports q_j + c (q_k - home_k)."""
    mapping, k = np.array(plant.mapping), params["source"] - 1
    mapping[j, k] += params["coefficient"]
    return replace(plant, mapping=mapping, home=at(plant.home, k, params["home"]))


def _eccentricity(params: Params, j: int, plant: Plant) -> Plant:
    return replace(plant, waves=(*plant.waves, (j, params["amplitude"], params["waves"], params["phase"])))


def _table(params: Params, j: int, plant: Plant) -> Plant:
    return replace(plant, rows=row_changed(plant.rows, j, params))


CAUSES = {
    "homing_offset": Cause(alike.draw_homing, grow=("offset",), build=_homing, bare=True),
    "transmission_ratio": Cause(_draw_ratio, grow=("error",), build=_ratio, bare=True),
    "cable_coupling": Cause(_draw_coupling, grow=("coefficient",), build=_coupling, bare=True),
    "pulley_eccentricity": Cause(alike.draw_eccentricity, grow=("amplitude",), build=_eccentricity, bare=True),
    "registration_error": Cause(
        lambda rng, j, scene: draw_similarity(rng),
        where="base",
        grow=SIMILARITY,
        tip=lambda params, j, run, T: moved(params, T),
        tracker_only=True,
    ),
    "dh_error": Cause(lambda rng, j, scene: draw_row(rng), grow=ROW_TERMS, build=_table, tracker_only=True),
}
