"""Effects at tool, base and sensors, and those of time and geometry on the joint path."""

from dataclasses import replace

import numpy as np
import pytest
from sim_machines import hold, motion, moves, raven

from gpcorrect import se3
from gpcorrect.arms import Chain, Joint, arm_named
from gpcorrect.errors import DataError
from gpcorrect.sim import run, simulate
from gpcorrect.sim.effects import (
    CableCoupling,
    CableSlip,
    CableStretch,
    Creep,
    Delay,
    DhError,
    EncoderQuantisation,
    Hysteresis,
    LengthDependentStiffness,
    NoiseChange,
    NonlinearStretch,
    PulleyEccentricity,
    RcmShift,
    RegistrationError,
    ShaftBending,
    play,
)
from gpcorrect.sim.motion import Readings

WEIGHT = np.array([[0.0, 0.0, -3.0], [1.0, 2.0, 0.0]])  # force on the tip in two runs


def poses(n=20, seed=3):
    """Return random tip poses of two runs, and a motion that carries the weights."""
    rng = np.random.default_rng(seed)
    R = se3.matrix_from_rotvec(rng.standard_normal((n, 2, 3)))
    return se3.pose(R, 0.3 * rng.standard_normal((n, 2, 3))), replace(motion(n, runs=2), tip_force=WEIGHT)


def readings(state):
    """Return readings that say exactly what the motors did."""
    marker = np.broadcast_to(np.eye(4), (*state.time.shape, 4, 4))
    return Readings(state.position, state.velocity, state.load, state.position, marker)


def test_registration_error_is_a_similarity():
    """All distances scale alike and all orientations turn alike: a similarity fit leaves nothing."""
    T, state = poses()
    seen = RegistrationError("base", 0.01, -0.02, 0.03, 0.1, -0.2, 0.3, 0.05).act(T, state)
    p, y = T[..., :3, 3].reshape(-1, 3), seen[..., :3, 3].reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(y[1:] - y[0], axis=1), 1.05 * np.linalg.norm(p[1:] - p[0], axis=1))
    R = se3.matrix_from_rotvec(np.array([0.1, -0.2, 0.3]))
    np.testing.assert_allclose(seen[..., :3, :3], R @ T[..., :3, :3], atol=1e-12)
    np.testing.assert_allclose(y, 1.05 * p @ R.T + [0.01, -0.02, 0.03], atol=1e-12)


@pytest.mark.parametrize("name", ["raven2_left", "dvrk_psm"])
@pytest.mark.parametrize("joint", [1, 2, 3, 6, "tool"])
def test_dh_error_agrees_with_finite_steps_along_the_chain(name, joint):
    """Each entry moves the tip as altering that row of the table does, in either convention."""
    arm = arm_named(name)
    chain, q = arm.chain, arm.home[None]
    for entry in ("a", "alpha", "d", "theta"):
        values = {"a": 0.0, "alpha": 0.0, "d": 0.0, "theta": 0.0} | {entry: 0.01}
        changed = DhError(joint, **values).act(chain).forward(q)
        assert np.abs(changed - chain.forward(q)).max() > 1e-3
        if joint != "tool":
            row = chain.joints[joint - 1]
            rows = [*chain.joints]
            rows[joint - 1] = replace(row, **{entry: getattr(row, entry) + 0.01})
            np.testing.assert_allclose(changed, Chain(tuple(rows), chain.convention, chain.base, chain.tool).forward(q))


def test_parallel_axes_may_be_askew_about_what_is_across_them():
    """The axis turns about the y axis of the link before, and all behind it; of axes that cross, a table says all."""
    rows = [Joint("R", 0.0, a, 0.0, 0.0, -2.0, 2.0) for a in (0.0, 0.4, 0.3)]
    chain, q = Chain(tuple(rows), "modified"), np.array([0.3, -0.5, 0.8])
    askew = se3.pose(se3.matrix_from_rotvec(np.array([0.0, 0.02, 0.0])), np.zeros(3))
    parts = (chain.joints[:1], q[:1]), (chain.joints[1:], q[1:])
    front, rear = (Chain(some, "modified").forward(values) for some, values in parts)
    effect = DhError(2, 0.0, 0.0, 0.0, 0.0, beta=0.02, form="parallel")
    np.testing.assert_allclose(effect.act(chain).forward(q), front @ askew @ rear, atol=1e-12)
    for joint, arm in ((1, chain), ("tool", chain), (2, arm_named("raven2_left").chain)):
        with pytest.raises(DataError, match="parallel"):
            replace(effect, joint=joint).check(arm)


def test_axes_that_are_parallel_in_the_model_may_be_askew_beside_any_other_error():
    """A twist of the same row is no reason to refuse it: a run ended with an error where a fit came by both."""
    rows = tuple(Joint("R", 0.0, a, 0.0, 0.0, -2.0, 2.0) for a in (0.0, 0.4, 0.3))
    arm = raven()
    arm = replace(arm, body=replace(arm.body, chain=Chain(rows, "modified"), held=np.zeros(0)))
    twisted, askew = DhError(2, 0.0, 0.01, 0.0, 0.0), DhError(2, 0.0, 0.0, 0.0, 0.0, beta=0.02, form="parallel")
    both = arm.with_effects(twisted, askew).actual_body(np.zeros(1)).chain
    assert both.forward(np.zeros(3))[0, 2] == pytest.approx(np.cos(0.01) * np.sin(0.02), abs=1e-12)
    with pytest.raises(DataError, match="parallel"):
        arm.with_effects(replace(askew, joint=1)).actual_body(np.zeros(1))


@pytest.mark.parametrize("joint", [1, 2, 5])
def test_theta_of_a_revolute_joint_is_a_joint_offset(joint):
    """An error of theta moves the tip as the same step of the joint does: the two cannot be told apart by poses."""
    arm = arm_named("raven2_left")
    moved = arm.home.copy()
    moved[joint - 1] += 0.02
    np.testing.assert_allclose(
        DhError(joint, 0.0, 0.0, 0.0, 0.02).act(arm.chain).forward(arm.home), arm.chain.forward(moved), atol=1e-12
    )


def test_dh_error_is_seen_by_the_tracker_only():
    """A link's true length changes where the tool is, not what the joint sensors say."""
    plan = moves(runs=1, seconds=1.0)
    plain, changed = (simulate(raven(*e), plan) for e in ((), (DhError(1, 0.005, 0.0, 0.0, 0.0),)))
    np.testing.assert_allclose(changed.external_jp, plain.external_jp, atol=1e-4)
    np.testing.assert_array_equal(changed.setpoint_cp.position, plain.setpoint_cp.position)
    assert np.abs(changed.tracker_cp.position - plain.tracker_cp.position).max() > 2e-3


def test_shaft_bends_as_a_cantilever():
    """The tip moves across the shaft by F L^3 / 3EI towards the lateral force and turns by F L^2 / 2EI."""
    T, state = poses()
    bent = ShaftBending("tool", 8.0).act(T, state)
    tip, moved = T[..., :3, 3], bent[..., :3, 3] - T[..., :3, 3]
    length = np.linalg.norm(tip, axis=-1, keepdims=True)
    along = tip / length
    lateral = WEIGHT - (along * WEIGHT).sum(-1, keepdims=True) * along
    np.testing.assert_allclose(moved, lateral * length**3 / 24.0, atol=1e-12)
    np.testing.assert_allclose((moved * along).sum(-1), 0.0, atol=1e-12)
    turn = se3.rotvec_from_matrix(bent[..., :3, :3] @ np.swapaxes(T[..., :3, :3], -1, -2))
    np.testing.assert_allclose(
        np.linalg.norm(turn, axis=-1), (np.linalg.norm(lateral, axis=-1) * length[..., 0] ** 2) / 16.0, rtol=1e-6
    )
    tilted = np.cross(turn, along)
    assert ((tilted * lateral).sum(-1) > 0).all()


@pytest.mark.parametrize(("effect", "power"), [(ShaftBending("tool", 8.0), 3), (RcmShift("base", 500.0), 0)])
def test_two_insertions_tell_bending_from_rcm_shift(effect, power):
    """Twice as far in, the same force bends the shaft eight times as much and moves the remote centre as before."""
    T, state = poses()
    near, far = T.copy(), T.copy()
    far[..., :3, 3] *= 2.0
    d_near, d_far = (np.linalg.norm((effect.act(t, state) - t)[..., :3, 3], axis=-1) for t in (near, far))
    np.testing.assert_allclose(d_far / d_near, 2.0**power)


def test_rcm_shift_turns_nothing():
    T, state = poses()
    np.testing.assert_array_equal(RcmShift("base", 500.0).act(T, state)[..., :3, :3], T[..., :3, :3])


@pytest.mark.parametrize("effect", [ShaftBending("tool", 8.0), RcmShift("base", 500.0)], ids=lambda e: e.about.name)
def test_no_load_no_bending(effect):
    """Without anything at the tip nothing gives way; with twice as much, twice as far; joints see none of it."""
    T, state = poses()
    np.testing.assert_array_equal(effect.act(T, replace(state, tip_force=None)), T)
    q = np.array([0.6, 1.5, 0.4])
    logs = [simulate(raven(effect), hold(q, payload=m)) for m in (0.0, 0.2, 0.4)]
    rigid = [simulate(raven(), hold(q, payload=m)) for m in (0.0, 0.2, 0.4)]
    for bent, straight in zip(logs, rigid, strict=True):
        np.testing.assert_array_equal(bent.external_jp, straight.external_jp)
    shift = [
        np.linalg.norm((b.tracker_cp.position - r.tracker_cp.position)[-1]) for b, r in zip(logs, rigid, strict=True)
    ]
    assert shift[0] < 1e-12
    assert shift[2] == pytest.approx(2 * shift[1], rel=0.02)
    assert shift[1] > 1e-5


def test_eccentricity_is_a_wave_of_its_pulley():
    """A turn of the pulley brings the same error back, in both directions alike, and its mean is none."""
    state = replace(motion(n=400), position=np.linspace(0, 2.0, 400)[:, None, None] + np.zeros((400, 2, 3)))
    effect = PulleyEccentricity(2, 0.01, 2 * np.pi * 3, 0.7)
    error = (state.position - effect.act(state.position, state))[..., 1]
    np.testing.assert_allclose(error, 0.01 * np.sin(2 * np.pi * 3 * state.position[..., 1] + 0.7), atol=1e-15)
    back = replace(state, position=state.position[::-1])
    np.testing.assert_array_equal((back.position - effect.act(back.position, back))[::-1, :, 1], error)


def test_nonlinear_stretch_solves_its_cubic():
    """The stretch carries the torque exactly, whatever the coefficients, and is odd."""
    torque = np.linspace(-30, 30, 101)
    for k1, k3 in ((200.0, 2e6), (5.0, 1e9), (1e4, 1.0), (0.0, 1e6), (100.0, 0.0)):
        d = NonlinearStretch(1, k1, k3)._stretch(torque)
        np.testing.assert_allclose(k1 * d + k3 * d**3, torque, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(d, -d[::-1], atol=1e-15)


def test_a_cable_without_hardening_is_linear():
    state = motion()
    linear = CableStretch(2, 150.0).act(state.position, state)
    np.testing.assert_allclose(NonlinearStretch(2, 150.0, 0.0).act(state.position, state), linear)
    np.testing.assert_allclose(NonlinearStretch(2, 150.0, 1e-3).act(state.position, state), linear, rtol=1e-6)


def test_a_longer_cable_stretches_more():
    """The stretch for one torque is proportional to the cable's length, which the insertion pays out."""
    state = motion()
    effect = LengthDependentStiffness(2, 3, 60.0, 3.0)
    stretch = (state.position - effect.act(state.position, state))[..., 1]
    np.testing.assert_allclose(stretch, state.load[..., 1] * np.maximum(3.0 + state.position[..., 2], 0.0) / 60.0)
    assert (np.sign(stretch) == np.sign(state.load[..., 1])).mean() > 0.99


def test_a_drag_follows_its_source_after_reversals():
    """Without drag the coupling is linear; with it, the source less its play comes on top, at most d r large."""
    state = motion()
    source = state.position[..., 0]
    plain = CableCoupling(3, 1, 0.2).act(state.position, state)
    dragged = CableCoupling(3, 1, 0.2, drag=0.5, drag_radius=0.3).act(state.position, state)
    part = (plain - dragged)[..., 2]
    np.testing.assert_allclose(part, 0.5 * (source - play(source, 0.3)), atol=1e-14)
    assert np.abs(part).max() == pytest.approx(0.5 * 0.3)
    far = CableCoupling(3, 1, 0.2, drag=0.5, drag_radius=1e6).act(state.position, state)
    expected = plain[..., 2] - 0.5 * (source - source[0])  # never out of its play: a linear coupling to the motion
    np.testing.assert_allclose(far[..., 2], expected, atol=1e-12)


def test_hysteresis_and_creep_take_their_operators_off_the_path():
    """Both lag: the joint is where its motor is, less a bounded hysteretic part, or less a slow share of the load."""
    state = motion(n=300)
    lagging = (state.position - Hysteresis(1, 0.2, 2.0).act(state.position, state))[..., 0]
    assert np.abs(lagging).max() <= 0.2 + 1e-12
    steady = replace(state, load=np.full(state.load.shape, 5.0))
    settled = (steady.position - Creep(1, 0.01, 3.0).act(steady.position, steady))[..., 0]
    np.testing.assert_allclose(settled, 0.05)


def test_delay_shifts_all_joints_alike():
    """A smooth motion is seen where it was, on even and uneven clocks, and before its start it stood still."""
    for mean, tolerance in ((None, 3e-6), (0.01, 1e-3)):
        n = 3000
        steps = np.full(n, 0.01) if mean is None else np.random.default_rng(0).exponential(mean, n)
        time = np.cumsum(steps)[:, None] + np.zeros((n, 2))
        path = np.sin(time[..., None] * [1.0, 2.0, 0.5])
        state = replace(motion(n, runs=2), time=time, position=path)
        seen = Delay("all", 0.13).act(path, state)
        late = time[:, 0] > time[0, 0] + 0.13
        np.testing.assert_allclose(seen[late], np.sin((time[late, :, None] - 0.13) * [1.0, 2.0, 0.5]), atol=tolerance)
        np.testing.assert_array_equal(seen[0], path[0])


def test_delay_changes_no_load():
    """When it is seen is nothing that the arm feels: motors and torques are those without delay."""
    plan = moves(runs=1, seconds=1.0)
    late, prompt = run(raven(Delay("all", 0.05)), plan), run(raven(), plan)
    np.testing.assert_array_equal(late.torque, prompt.torque)
    np.testing.assert_allclose(late.q[5:], prompt.q[:-5], atol=1e-9)


def test_the_tracker_may_be_late_alone():
    """It has a clock of its own, of which no encoder says anything."""
    plan = moves(runs=1, seconds=1.0)
    late, prompt = run(raven(Delay("tool", 0.05)), plan), run(raven(), plan)
    np.testing.assert_array_equal(late.q, prompt.q)
    np.testing.assert_allclose(late.T_base_tip[5:], prompt.T_base_tip[:-5], atol=1e-9)


def test_a_slip_is_a_step_in_one_session():
    """Before its instant, and in other sessions, nothing; from then on the whole step."""
    state = motion(runs=4, sessions=2)
    state = replace(state, time=state.time - np.arange(4) * 100.0)
    error = (state.position - CableSlip(2, 0.05, 0.2, session=1).act(state.position, state))[..., 1]
    np.testing.assert_allclose(error[:, [0, 2]], 0.0)
    np.testing.assert_allclose(error[:, [1, 3]], 0.05 * (state.time[:, [1, 3]] >= 0.2), atol=1e-15)
    assert (error != 0).any()


def test_quantised_readings_lie_on_a_grid():
    """Reported positions are whole counts, at most half a count off; nothing else is touched."""
    state = motion()
    seen = EncoderQuantisation(2, 0.05).operator(np.random.default_rng(0))(readings(state), state)
    counts = seen.measured_jp[..., 1] / 0.05
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    assert np.abs(seen.measured_jp - state.position)[..., 1].max() <= 0.025 + 1e-12
    np.testing.assert_array_equal(seen.measured_jp[..., [0, 2]], state.position[..., [0, 2]])
    np.testing.assert_array_equal(seen.external_jp, state.position)


def test_lost_counts_leave_the_zero_elsewhere():
    """With every count lost nothing is ever reported; with some, the zero wanders by whole counts."""
    state = motion(n=400)
    all_lost = EncoderQuantisation(1, 0.01, lost=1.0).operator(np.random.default_rng(0))(readings(state), state)
    assert np.ptp(all_lost.measured_jp[..., 0], axis=0).max() < 1e-9
    some = EncoderQuantisation(1, 0.01, lost=0.05).operator(np.random.default_rng(0))(readings(state), state)
    shift = (some.measured_jp - state.position)[..., 0]
    assert np.abs(shift).max() > 0.02
    none = EncoderQuantisation(1, 0.01).operator(np.random.default_rng(0))(readings(state), state)
    wandered = (some.measured_jp - none.measured_jp)[..., 0] / 0.01
    np.testing.assert_allclose(wandered, np.round(wandered), atol=1e-6)


@pytest.mark.parametrize(("tail", "kurtosis"), [(float("inf"), (2.8, 3.2)), (5.0, (4.5, 40.0))])
def test_changed_noise_has_its_size_and_tails(tail, kurtosis):
    """Zero mean, the given deviation, and tails as heavy as the law's; the other sensors are left alone."""
    state = motion(n=40000, runs=1)
    before = readings(state)
    noise = (
        NoiseChange(1, 0.3, tail=tail).operator(np.random.default_rng(4))(before, state).external_jp - state.position
    )[..., 0]
    assert abs(noise.mean()) < 0.006
    assert noise.std() == pytest.approx(0.3, rel=0.05)
    assert kurtosis[0] < np.mean(noise**4) / np.var(noise) ** 2 < kurtosis[1]


def test_changed_noise_begins_when_it_says():
    state = motion(n=400, runs=1)
    seen = NoiseChange("tool", 1e-3, since=2.0).operator(np.random.default_rng(0))(readings(state), state)
    shift = seen.T_tracker_marker[..., :3, 3]
    assert (shift[state.time < 2.0] == 0).all()
    assert (shift[state.time >= 2.0] != 0).all()
    assert shift[state.time >= 2.0].std() == pytest.approx(1e-3, rel=0.1)
    np.testing.assert_array_equal(seen.external_jp, state.position)


def test_a_tool_may_be_off_along_all_three_axes_of_its_link():
    """The tip is where the nominal one is, shifted in the frame of the last link; a joint has no such form."""
    shift = DhError("tool", a=0.003, b=-0.002, d=0.004, form="tool")
    chain = raven().body.chain
    q = np.zeros((1, chain.dof))
    link = replace(chain, tool=np.eye(4)).forward(q)[0]
    moved = shift.act(chain).forward(q)[0] - chain.forward(q)[0]
    if chain.convention == "modified":
        np.testing.assert_allclose(moved[:3, 3], link[:3, :3] @ [0.003, -0.002, 0.004], atol=1e-12)
    assert np.linalg.norm(moved[:3, 3]) == pytest.approx(np.linalg.norm([0.003, -0.002, 0.004]))
    np.testing.assert_allclose(moved[:3, :3], 0.0, atol=1e-12)
    for effect in (replace(shift, joint=2), replace(shift, form="table")):
        with pytest.raises(DataError, match="the tool alone"):
            effect.check(chain)
