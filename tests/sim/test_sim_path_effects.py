from dataclasses import replace

import numpy as np
import pytest
from sim_machines import motion

from gpcorrect.errors import DataError
from gpcorrect.sim.effects import Drift, GravitySag, HomingOffset


def test_every_session_has_its_own_offset():
    """With one offset a session, runs of a session share it and others do not."""
    state = motion(runs=4, sessions=2)
    q = HomingOffset(1, (0.01, -0.02)).act(state.position, state)
    np.testing.assert_allclose((state.position - q)[0, :, 0], [0.01, -0.02, 0.01, -0.02])


def test_too_few_offsets_are_refused():
    state = motion(runs=3, sessions=3)
    with pytest.raises(DataError, match=r"2 offsets.*3 sessions"):
        HomingOffset(1, (0.0, 0.0)).act(state.position, state)


def test_sag_knows_gravity_only():
    """The sag is the gravity torque over the stiffness, whatever else the joint carries."""
    state = motion()
    sag = state.position - GravitySag(1, 80.0).act(state.position, state)
    np.testing.assert_allclose(sag[..., 0], state.gravity_load[..., 0] / 80.0)


def test_drift_counts_session_time():
    """A steady drift is rate times session time, also in runs that begin late."""
    state = motion(runs=3)
    q = Drift(1, 1e-4).act(state.position, state)
    np.testing.assert_allclose((state.position - q)[..., 0], 1e-4 * state.time, atol=1e-15)


def test_drift_settles():
    """With a time constant the drift starts at its rate and ends at rate times constant; a long one is steady."""

    def offset(effect, times):
        still = replace(motion(n=len(times), runs=1), time=np.array(times)[:, None])
        still = replace(still, position=np.zeros(still.position.shape))
        return -effect.act(still.position, still)[:, 0, 0]

    settled = offset(Drift(1, 2e-5, time_constant=600.0), [0.0, 1e-3, 1e9])
    np.testing.assert_allclose(settled, [0.0, 2e-8, 2e-5 * 600.0], rtol=1e-5)
    times = np.linspace(0, 1e4, 5)
    np.testing.assert_allclose(offset(Drift(1, 2e-5, 1e12), times), offset(Drift(1, 2e-5), times), rtol=1e-7)
