from dataclasses import replace
from itertools import pairwise

import numpy as np
from planning_support import Moves, ideal

from gpcorrect import se3
from gpcorrect.planning import Margins
from gpcorrect_studies.debridement.mission import (
    ATTEMPTS,
    MIDDLE,
    ArmRecord,
    Condition,
    Fetched,
    Mission,
    Outcome,
    debride,
)
from gpcorrect_studies.debridement.page import path_charts, seconds_chart
from gpcorrect_studies.debridement.rehearsal import rehearsal_log
from gpcorrect_studies.debridement.scene import catches, stations
from gpcorrect_studies.debridement.strategies import LookAndMove, OpenLoop


def mission(arms: int, fragments: int, seed: int, *, perfect: bool = True) -> Mission:
    """Return a task of ideal arms, or of the arms as they come."""
    scene, places = stations(arms)
    places = tuple(ideal(p) for p in places) if perfect else places
    return Mission(scene, places, scene.fragments(fragments, np.random.default_rng(seed)))


def knowing(task: Mission, *, interval: float = 1e-4) -> list[OpenLoop]:
    """Strategies that know where each arm's base really is."""
    return [
        OpenLoop(Moves(se3.invert(p.machine.T_tracker_base), interval), margins=Margins(position=1e-3))
        for p in task.stations
    ]


def test_fragments_lie_in_the_box():
    """Fragments are drawn evenly in 8 x 8 x 2 cm, the last axis up."""
    scene, _ = stations(2)
    box = scene.along(scene.fragments(4000, np.random.default_rng(0)))
    np.testing.assert_allclose(np.ptp(box, axis=0), [0.08, 0.08, 0.02], rtol=2e-3)
    np.testing.assert_allclose(box.mean(axis=0), 0.0, atol=2e-3)
    np.testing.assert_allclose(scene.up, -stations(1)[1][0].arm.gravity / 9.80665, atol=1e-12)


def test_an_arm_that_is_known_needs_one_attempt():
    """With the true correction in open loop every fragment is fetched at once, within millimetres."""
    outcome = debride(mission(1, 3, 1), knowing(mission(1, 3, 1)), np.random.default_rng(2))
    assert outcome.success_rate == 1.0
    assert outcome.retries == 0
    assert max(m for f in outcome.fetched for m in f.misses_mm) < 3.0


def test_a_wrong_correction_fetches_nothing():
    """Two centimetres beside the truth no fragment is caught, and each is given up after the attempts allowed."""
    task = mission(1, 2, 1)
    beside = se3.pose(np.eye(3), np.array([0.0, 0.02, 0.0]))
    strategies = [OpenLoop(Moves(beside @ se3.invert(p.machine.T_tracker_base))) for p in task.stations]
    outcome = debride(task, strategies, np.random.default_rng(2))
    assert outcome.success_rate == 0.0
    assert [f.attempts for f in outcome.fetched] == [ATTEMPTS] * 2


def test_looking_needs_no_correction():
    """An arm that misses by centimetres still comes to its fragments when it looks; it takes longer."""
    task = mission(1, 2, 4, perfect=False)
    looking = debride(task, [LookAndMove()], np.random.default_rng(3))
    assert looking.success_rate == 1.0
    assert min(f.looks for f in looking.fetched) >= 4
    known = mission(1, 2, 4)
    fast = debride(known, knowing(known), np.random.default_rng(3))
    assert looking.seconds_per_fragment > 2 * fast.seconds_per_fragment


def test_an_unsure_correction_is_replanned_and_then_looked_at():
    """Where no tilt of the tool is sure enough the arm looks its way there, and says so."""
    task = mission(1, 1, 5)
    unsure = replace(knowing(task, interval=0.01)[0], careful=LookAndMove())
    (fetched,) = debride(task, [unsure], np.random.default_rng(1)).fetched
    assert fetched.careful
    assert fetched.removed
    assert fetched.replanned >= 9


def test_two_arms_are_never_in_the_middle_together():
    """While one arm fetches a fragment of the middle the other one keeps to its side."""
    task = mission(2, 1, 6)
    x = np.array([0.004, -0.004, 0.012, -0.012, 0.03])
    fragments = task.scene.at(np.stack([x, np.linspace(-0.02, 0.02, 5), np.zeros(5)], axis=1))
    outcome = debride(replace(task, fragments=fragments), knowing(task), np.random.default_rng(7))
    inside = []
    for fetched in outcome.fetched:
        if abs(task.scene.along(fetched.fragment)[0]) < MIDDLE:
            inside.append((fetched.clock - fetched.seconds, fetched.clock))
    inside.sort()
    assert len(inside) == 4
    assert all(end <= begin + 1e-9 for (_, end), (begin, _) in pairwise(inside))
    assert sum(arm.waited for arm in outcome.arms) > 0
    assert {f.arm for f in outcome.fetched} == {"arm1", "arm2"}


def test_the_gripper_is_where_it_says():
    """A fragment is caught up to the jaws' reach along the floor and up, and up to a turn; not beyond."""
    up, T = np.array([0.0, 0.0, 1.0]), np.eye(4)
    caught = [catches(T, T, np.array(p), up) for p in ([0.0049, 0, 0], [0.0051, 0, 0], [0, 0, 0.0041])]
    assert caught == [True, False, False]
    turned = se3.pose(se3.matrix_from_rotvec(np.deg2rad([0, 0, 26.0])), np.zeros(3))
    assert not catches(turned, T, np.zeros(3), up)


def test_a_rehearsal_covers_the_fragments():
    """Under the tracker, rehearsed grasps lie around the box: its middle is reached in every direction."""
    scene, (place,) = stations(1)
    log = rehearsal_log(scene, place, 8, 0.06, np.random.default_rng(1), 2)
    box = scene.along(log.tracker_cp.position[log.extra["fault"] == 0])
    assert (np.abs(np.median(box, axis=0)) < [0.05, 0.05, 0.03]).all()
    assert len(log.trajectory_ids) == 8


def test_figures_are_means_over_the_sets_and_counts_are_of_all() -> None:
    """Two sets of one fragment: seconds and successes are averaged, looks are added, the worst miss is the worst."""

    def done(seconds: float, looks: int, removed: bool, miss: float) -> Condition:
        fetched = Fetched("arm1", np.zeros(3), removed, 1, seconds, seconds, (miss,), looks, 0, False)
        return Condition("way", 0.06, (Outcome((fetched,), (ArmRecord("arm1", np.zeros((1, 4)), seconds, 0.0),)),))

    (way,) = Condition.joined([[done(4.0, 2, True, 1.0)], [done(8.0, 3, False, 5.0)]])
    row = way.to_dict()
    assert (row["seconds_per_fragment"], row["success_rate"], row["miss_mm_mean"]) == (6.0, 0.5, 3.0)
    assert (row["fragments"], row["looks"], row["miss_mm_max"]) == (2, 5, 5.0)
    assert [one["seconds_per_fragment"] for one in row["sets"]] == [4.0, 8.0]


def test_charts_show_removed_and_left_fragments_of_every_way() -> None:
    """Each way is a choice with its own fragments; a way that removes nothing has a bar of no length and says so."""
    scene, _ = stations(1)
    ways = []
    for name, removed in (("good", True), ("bad", False)):
        fetched = Fetched("arm1", scene.T_tracker_box[:3, 3], removed, 1, 4.0, 4.0, (1.0,), 0, 0, False)
        trace = np.column_stack([np.arange(5000.0), np.zeros((5000, 3))])
        ways.append(Condition(name, 0.06, (Outcome((fetched,), (ArmRecord("arm1", trace, 4.0, 0.0),)),)))
    space, above = path_charts(scene, ways)
    assert [{s.name for s in above.choices[way.name][0].series} - {"tool of arm1"} for way in ways] == [
        {"removed"},
        {"left"},
    ]
    assert len(np.asarray(space.choices["good"][0].series[0].x)) <= 1500
    (bars,) = seconds_chart([way.to_dict() for way in ways]).panels[0].series
    assert np.asarray(bars.x2).tolist() == [4.0, 0.0]
    assert list(bars.labels) == ["4.0 s", "never done"]
