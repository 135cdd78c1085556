"""One rotation at a time agrees with stacks of them."""

from __future__ import annotations

import numpy as np
import pytest

from gpcorrect import se3, se3_single
from gpcorrect.types import FloatArray


def rotation_vectors() -> FloatArray:
    """Random ones, tiny ones, and ones of nearly pi about every kind of axis."""
    rng = np.random.default_rng(5)
    axes = rng.standard_normal((400, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    axes = np.concatenate([axes, np.eye(3), -np.eye(3)])
    angles = np.concatenate(
        [rng.uniform(0, np.pi, 200), 10 ** rng.uniform(-12, -4, 100), np.pi - 10 ** rng.uniform(-6, -2, 106)]
    )
    return axes * angles[:, None]


@pytest.mark.parametrize(
    "name", ["matrix_from_quaternion", "quaternion_from_matrix", "matrix_from_rotvec", "rotvec_from_matrix"]
)
def test_one_at_a_time_is_the_stack(name: str) -> None:
    """Each function equals its namesake in `se3` for every kind of rotation."""
    vectors = rotation_vectors()
    matrices = se3.matrix_from_rotvec(vectors)
    given = {"rotvec": vectors, "matrix": matrices, "quaternion": se3.quaternion_from_matrix(matrices)}[
        name.split("_")[-1]
    ]
    expected = getattr(se3, name)(given)
    for one, wanted in zip(given, expected, strict=True):
        np.testing.assert_allclose(
            getattr(se3_single, name)(one), wanted, atol=2e-9 if "rotvec_from" in name else 1e-12
        )
