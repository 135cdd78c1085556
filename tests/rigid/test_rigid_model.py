from __future__ import annotations

import json

import numpy as np
import pytest
from rigid_planted import motion, random_model

from gpcorrect import se3
from gpcorrect.errors import DataError
from gpcorrect.rigid import RigidModel
from gpcorrect.types import PoseSignal

KINDS = ["identity", "pose", "marker", "separate", "position"]


@pytest.mark.parametrize("kind", KINDS)
def test_apply_is_the_stated_law(kind: str, rng: np.random.Generator) -> None:
    """Poses map to `R_position (p + R_obs offset) + t` and `R_left R_obs R_right`, a sample at a time."""
    model, observed = random_model(kind, rng), motion(7, rng)
    mapped = model.apply(observed)
    for k in range(7):
        R_obs = se3.matrix_from_quaternion(observed.quaternion[k])
        expected = model.R_position @ observed.position[k] + model.t + model.R_position @ R_obs @ model.offset
        np.testing.assert_allclose(mapped.position[k], expected, atol=1e-14)
        np.testing.assert_allclose(
            se3.matrix_from_quaternion(mapped.quaternion[k]), model.R_left @ R_obs @ model.R_right, atol=1e-14
        )


@pytest.mark.parametrize("kind", KINDS)
def test_the_inverse_maps_back(kind: str, rng: np.random.Generator) -> None:
    """What `apply` maps, `inverse` maps back."""
    model, observed = random_model(kind, rng), motion(7, rng)
    back = model.inverse(model.apply(observed))
    np.testing.assert_allclose(back.position, observed.position, atol=1e-13)
    turned = (se3.matrix_from_quaternion(q) for q in (back.quaternion, observed.quaternion))
    np.testing.assert_allclose(*turned, atol=1e-13)


def test_marker_model_is_a_product_of_poses(rng: np.random.Generator) -> None:
    """A marker model is `T_base_tracker X T_marker_tip`."""
    model, observed = random_model("marker", rng), motion(5, rng)
    X = se3.from_parts(observed.position, observed.quaternion)
    expected = se3.pose(model.R_position, model.t) @ X @ se3.pose(model.R_right, model.offset)
    mapped = model.apply(observed)
    np.testing.assert_allclose(se3.from_parts(mapped.position, mapped.quaternion), expected, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_json_round_trip_is_exact(kind: str, rng: np.random.Generator) -> None:
    """A model comes back from JSON to the last bit."""
    model, observed = random_model(kind, rng), motion(5, rng)
    back = RigidModel.from_dict(json.loads(json.dumps(model.to_dict())))
    assert back.kind == kind
    np.testing.assert_array_equal(back.apply(observed).position, model.apply(observed).position)
    np.testing.assert_array_equal(back.apply(observed).quaternion, model.apply(observed).quaternion)


def test_positions_alone_map_without_a_lever_arm_only(rng: np.random.Generator) -> None:
    """A lever arm needs orientations to turn it; without one positions map as they do with orientations."""
    observed = motion(5, rng)
    bare = PoseSignal(observed.position)
    pose = random_model("pose", rng)
    np.testing.assert_array_equal(pose.apply(bare).position, pose.apply(observed).position)
    assert pose.apply(bare).quaternion is None
    with pytest.raises(DataError, match="needs orientations"):
        random_model("marker", rng).apply(bare)


def test_missing_samples_stay_missing(rng: np.random.Generator) -> None:
    """A row of NaN maps to a row of NaN and leaves its neighbours alone."""
    model, observed = random_model("marker", rng), motion(4, rng)
    position, quaternion = np.array(observed.position), np.array(observed.quaternion)
    position[1], quaternion[1] = np.nan, np.nan
    mapped = model.apply(PoseSignal(position, quaternion))
    assert mapped.finite.tolist() == [True, False, True, True]
    np.testing.assert_allclose(mapped.position[2], model.apply(observed).position[2], rtol=1e-15)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "affine"}, "affine"),
        ({"R_left": (2 * np.eye(3)).tolist()}, "R_left .* rotation matrix"),
        ({"R_right": np.diag([1.0, 1.0, -1.0]).tolist()}, "R_right .* rotation matrix"),
        ({"t": [0.0, np.nan, 0.0]}, "t of a rigid model must be finite"),
        ({"offset": [0.0, 0.0]}, r"offset .* \(3,\)"),
    ],
)
def test_stored_models_that_are_not_rigid_are_refused(change: dict[str, object], message: str) -> None:
    """Scaled, mirrored, infinite or misshapen parts never become a model."""
    with pytest.raises(DataError, match=message):
        RigidModel.from_dict({**RigidModel().to_dict(), **change})


def test_stored_model_with_a_part_missing_is_refused() -> None:
    """The message names the part that is missing."""
    stored = RigidModel().to_dict()
    del stored["offset"]
    with pytest.raises(DataError, match="lacks offset"):
        RigidModel.from_dict(stored)
