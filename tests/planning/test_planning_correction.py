from dataclasses import replace

import numpy as np
import pytest
from planning_support import Moves

from gpcorrect import se3
from gpcorrect.correction import Reason
from gpcorrect.errors import DataError
from gpcorrect.planning import DesiredPath, Margins, circle, corrected, first_trusted, reach
from gpcorrect.sim.reaching import Pace

SHIFT = se3.exp(np.array([0.01, -0.02, 0.005, 0.2, -0.1, 0.3]))
PACE = Pace(0.05, 0.5, 1.5)


def path(seed: int = 0, stops: int = 3) -> DesiredPath:
    """Return a path through random poses a few centimetres apart."""
    rng = np.random.default_rng(seed)
    return reach(se3.exp(0.05 * rng.standard_normal((stops, 6)) * [1, 1, 1, 4, 4, 4]), PACE)


def test_full_correction_asks_for_every_pose():
    """In full, every pose of the path is what the corrector says of it."""
    wanted = path()
    command = corrected(Moves(SHIFT), wanted)
    np.testing.assert_allclose(command.T, se3.compose(SHIFT, wanted.T), atol=1e-12)
    assert len(command.interval95) == len(wanted.times)


def test_endpoints_are_corrected_exactly():
    """At its endpoints only, a path begins and ends where the corrector says, and asks for two poses."""
    wanted = path()

    class Bends(Moves):
        """Moves poses further, the further out they are."""

        def correct_path(self, poses, times):
            answer = super().correct_path(poses, times)
            return replace(answer, position=answer.position * 1.1)

    command = corrected(Bends(SHIFT), wanted, "endpoints")
    ends = Bends(SHIFT).correct_path(wanted.poses[[0, -1]], wanted.times[[0, -1]])
    np.testing.assert_allclose(command.T[[0, -1], :3, 3], ends.position, atol=1e-12)
    assert len(command.interval95) == 2
    assert len(command.T) == len(wanted.T)


def test_both_ways_agree_where_the_correction_is_rigid():
    """A correction that moves everything alike gives the same path in full and at its endpoints."""
    wanted = path(3)
    full, ends = (corrected(Moves(SHIFT), wanted, mode).T for mode in ("full", "endpoints"))
    np.testing.assert_allclose(full, ends, atol=1e-9)


NAN = np.full((4, 4), np.nan)
STILL = np.eye(4)[None].repeat(3, axis=0)


@pytest.mark.parametrize(
    ("planned", "said"),
    [
        (lambda: reach(STILL[:0], PACE), "start and a goal"),
        (lambda: reach(STILL[:1], PACE), "start and a goal"),
        (lambda: reach(np.eye(4), PACE), "start and a goal"),
        (lambda: reach(np.stack([np.eye(4), NAN]), PACE), "finite poses"),
        (lambda: reach(STILL, Pace(turn_rate=0.0)), "rates above 0"),
        (lambda: reach(STILL, Pace(law="minimum-jerk", speed=np.nan)), "rates above 0"),
        (lambda: reach(STILL, Pace(pause=np.nan)), "a rest of at least 0"),
        (lambda: circle(np.eye(4), 0.0, 0.1), "above 0 and finite"),
        (lambda: circle(np.eye(4), 0.1, np.inf), "above 0 and finite"),
        (lambda: circle(np.eye(4), np.nan, 0.1), "above 0 and finite"),
        (lambda: circle(np.eye(4), 0.1, 0.1, rate_hz=0.0), "above 0 and finite"),
        (lambda: circle(NAN, 0.1, 0.1), "centre of a circle"),
        (lambda: circle(np.zeros(3), 0.1, 0.1), "centre of a circle"),
        (lambda: DesiredPath(np.arange(3.0), NAN[None].repeat(3, axis=0)), "finite times and poses"),
        (lambda: DesiredPath(np.array([0.0, np.nan, 1.0]), STILL), "finite times and poses"),
        (lambda: DesiredPath(np.array([0.0, 1.0, 1.0]), STILL), "times of a path increase"),
        (lambda: DesiredPath(np.empty(0), STILL[:0]), "one pose"),
        (lambda: DesiredPath(np.float64(1.0), STILL), "one pose"),
    ],
)
def test_what_is_no_path_is_refused_in_words(planned, said):
    """No poses, one pose, no size, no number: what was expected is said, and no bare error comes."""
    with pytest.raises(DataError, match=said):
        planned()


def test_another_mode_is_refused():
    with pytest.raises(DataError, match="full or at its endpoints"):
        corrected(Moves(SHIFT), path(), "middle")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("corrector", "margins", "cause"),
    [
        (Moves(SHIFT, interval=0.003), Margins(position=0.002), "position interval"),
        (Moves(SHIFT, interval=0.003), Margins(position=0.01, rotation=0.002), "rotation interval"),
        (Moves(SHIFT, interval=np.nan), Margins(), "position interval"),
        (Moves(SHIFT, domain=0.0), Margins(), "out of domain"),
        (Moves(SHIFT, interval=0.001), Margins(position=0.002), None),
    ],
)
def test_a_doubt_names_what_went_beyond_its_margin(corrector, margins, cause):
    """A command is doubted for its domain first, then its position, then its rotation, and not without reason."""
    doubt = margins.doubt(corrected(corrector, path()))
    assert (doubt.cause if doubt else None) == cause


def test_a_command_that_was_cut_is_doubted_however_sure_it_was():
    """Its interval is of the correction that was not made: an arm of 34 mm corrected by 1 mm was trusted to 5 mm."""

    class Cut(Moves):
        """Moves poses no further than an operator allows."""

        def correct_path(self, poses, times):
            return super().correct_path(poses, times).because(Reason.BOUNDED, np.ones(len(poses), dtype=bool))

    planned = first_trusted(Cut(SHIFT, interval=0.001), [path()], Margins())
    assert not planned.trusted
    assert [doubt.cause for doubt in planned.doubts] == ["cut"]
    assert "status" in str(planned.doubts[0])


@pytest.mark.parametrize("wrong", [{"position": np.nan}, {"rotation": 0.0}, {"outside": 1.5}])
def test_margins_that_are_none_are_refused(wrong):
    with pytest.raises(DataError, match="margins"):
        Margins(**wrong)


def test_a_goal_out_of_domain_is_doubted_however_good_the_way():
    """The fraction that may lie outside is for the way, not for its end."""
    wanted = reach(np.stack([np.eye(4), se3.pose(np.eye(3), np.array([0.1, 0.0, 0.0]))]), PACE)
    doubt = Margins(outside=0.9).doubt(corrected(Moves(SHIFT, domain=0.0999), wanted))
    assert doubt is not None
    assert doubt.cause == "out of domain"


def test_replanning_takes_the_first_way_that_is_sure():
    """Ways are tried in order until one is within the margins; what was wrong with the others is returned."""
    far, near = (reach(np.stack([np.eye(4), se3.pose(np.eye(3), np.array([x, 0, 0]))]), PACE) for x in (0.09, 0.02))
    chosen = first_trusted(Moves(SHIFT, domain=0.05), [far, near, far], Margins())
    assert (chosen.number, chosen.trusted, len(chosen.doubts)) == (1, True, 1)
    none = first_trusted(Moves(SHIFT, domain=0.05), [far, far], Margins())
    assert (none.number, none.trusted, len(none.doubts)) == (1, False, 2)
    with pytest.raises(DataError, match="no path"):
        first_trusted(Moves(SHIFT), [], Margins())
