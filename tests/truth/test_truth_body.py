"""The independent equations of motion against energy, and against the product's recursion."""

from __future__ import annotations

import numpy as np
from truth.arm import ROWS, forward, tip_in_shaft
from truth.body import Body, equations
from truth.machine import draw_machine

from gpcorrect.arms import arm_named
from gpcorrect.sim.body import Body as ProductBody
from gpcorrect.sim.body import Links
from gpcorrect.sim.dynamics import posture_at

PAYLOAD = 0.3


def _body(seed: int = 0) -> Body:
    body = draw_machine(np.random.default_rng(seed), tracked=False).nominal_body()
    body.mass[3] = PAYLOAD
    body.centre[3] = tip_in_shaft()
    return body


def _terms(body: Body, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    M, bias, weight = np.empty((3, 3)), np.empty(3), np.empty(3)
    equations(body, q, v, M, bias, weight)
    return M, bias, weight


def _states(n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(5)
    return [(rng.uniform([0.3, 0.9, 0.33], [1.1, 2.0, 0.42]), rng.uniform(-1, 1, 3)) for _ in range(n)]


def test_velocity_terms_do_no_work_beyond_the_change_of_kinetic_energy() -> None:
    """V . bias = v . (dM/dt) v / 2, so that the energy of free motion is kept."""
    body = _body()
    for q, v in _states(5):
        M_dot = (_terms(body, q + 1e-6 * v, v)[0] - _terms(body, q - 1e-6 * v, v)[0]) / 2e-6
        np.testing.assert_allclose(v @ _terms(body, q, v)[1], 0.5 * v @ M_dot @ v, atol=1e-7)


def test_weight_has_no_curl() -> None:
    """Gravity's torque is the gradient of an energy: its derivative is symmetric."""
    body = _body()
    for q, _ in _states(3):
        slope = np.array(
            [(_terms(body, q + d, 0 * q)[2] - _terms(body, q - d, 0 * q)[2]) / 2e-5 for d in 1e-5 * np.eye(3)]
        )
        np.testing.assert_allclose(slope, slope.T, atol=1e-6)


def test_agrees_with_the_products_inverse_dynamics() -> None:
    """Two methods written apart give the same torques for the same machine."""
    body, arm = _body(3), arm_named("raven2_left")
    links = Links(body.mass[:3], body.centre[:3], body.moment[:3], np.array([PAYLOAD]))
    product = ProductBody((1, 2, 3), "RRP", arm.chain, np.zeros(3), links, body.gravity)
    for q, v in _states(5):
        M, bias, weight = _terms(body, q, v)
        a = np.array([0.7, -1.1, 0.4])
        posture = posture_at(product, q[None, None])
        assert posture is not None
        np.testing.assert_allclose(posture.gravity_load()[0, 0], weight, atol=1e-9)
        inertial = posture.loads(v[None, None], a[None, None])[1][0, 0]
        np.testing.assert_allclose(inertial, M @ a + bias, atol=1e-9)


def test_agrees_with_the_products_kinematics() -> None:
    """The table written down twice gives the same tool poses."""
    q = np.array([s[0] for s in _states(6)])
    full = np.column_stack([q, np.zeros((6, 3))])
    np.testing.assert_allclose(forward(q, ROWS), arm_named("raven2_left").chain.forward(full), atol=1e-12)


def test_the_tip_lies_on_the_shaft() -> None:
    """With the wrist straight the tip is on the insertion axis through the remote centre, as bending assumes."""
    np.testing.assert_allclose(tip_in_shaft()[:2], 0.0, atol=1e-12)
