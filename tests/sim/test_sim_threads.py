import numpy as np
import pytest
from sim_machines import moves, raven

from gpcorrect.sim import dynamics, run
from gpcorrect.sim.effects import CableStretch, CoulombFriction, Payload
from gpcorrect.sim.plant import Command, follow_command


@pytest.mark.parametrize("count", [1, 2, 3, 7, 50])
@pytest.mark.parametrize("length", [0, 1, 5, 24])
def test_parts_make_the_whole_range(monkeypatch, count, length):
    """Every item is worked on once, however many threads there are."""
    monkeypatch.setattr(dynamics, "thread_count", lambda: count)
    visits = np.zeros(length)

    def visit(first, last):
        visits[first:last] += 1

    dynamics.in_parts(length, 10 * dynamics.WORTH_A_THREAD, visit)
    np.testing.assert_array_equal(visits, 1)


def test_motion_is_the_same_on_any_number_of_threads(monkeypatch):
    """Runs do not depend on each other: the parts they are shared out in change no bit."""
    plan, machine = moves(runs=5, seconds=2.0), raven(CoulombFriction(1, torque=0.4))
    monkeypatch.setattr(dynamics, "WORTH_A_THREAD", 1)
    paths = []
    for count in (1, 3):
        monkeypatch.setattr(dynamics, "thread_count", lambda count=count: count)
        paths.append(run(machine, plan).q)
    np.testing.assert_array_equal(*paths)


@pytest.mark.parametrize(("stated", "count"), [("1", 1), ("", 2), ("999", 2), ("two", 2)])
def test_stated_threads_are_not_exceeded(monkeypatch, stated, count):
    """OMP_NUM_THREADS lowers the number of threads, and never raises it above numba's."""
    monkeypatch.setattr(dynamics.numba.config, "NUMBA_NUM_THREADS", 2)
    monkeypatch.setenv("OMP_NUM_THREADS", stated)
    assert dynamics.thread_count() == count


@pytest.mark.parametrize(
    "effects",
    [(), (CoulombFriction(2, torque=0.3),), (CableStretch(2, 80.0),), (Payload("all", 0.3),)],
    ids=["none", "friction", "stretch", "payload"],
)
def test_a_command_serves_any_effects(effects):
    """A command made without effects gives the motion that one made for them would."""
    plan = moves(runs=2, seconds=3.0)
    shared = Command.of(raven(), plan)
    np.testing.assert_array_equal(follow_command(raven(*effects), shared).q, run(raven(*effects), plan).q)
