"""What the service lets through to a corrector, and what it lets out to a robot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from service_support import REGION

from gpcorrect_service import ServiceError
from gpcorrect_service.protocol.limits import (
    LIMITS,
    check_command,
    checked_path,
    checked_pose,
    checked_twist,
    position_limit,
)

LIMIT = position_limit({"training_region": REGION})
GOOD = (0.05, -0.02, -0.1, 1.0, 0.0, 0.0, 0.0)

metre = st.floats(-1, 1)
component = st.floats(-1, 1)


@given(position=st.tuples(metre, metre, metre), quaternion=st.tuples(*[component] * 4))
def test_any_unit_quaternion_and_its_negative_pass(position: tuple[float, ...], quaternion: tuple[float, ...]) -> None:
    """Q and -q are the same rotation: both are accepted and neither is changed."""
    norm = math.hypot(*quaternion)
    assume(norm > 1e-3)
    unit = tuple(c / norm for c in quaternion)
    for sign in (1, -1):
        pose = (*position, *(sign * c for c in unit))
        np.testing.assert_array_equal(checked_pose(pose, LIMIT), pose)


@pytest.mark.parametrize("norm", [0.0, 0.5, 1.01, 1.5])
def test_quaternion_norm(norm: float) -> None:
    """A quaternion further than 1e-3 from norm one is refused, zero included."""
    with pytest.raises(ServiceError, match="norm"):
        checked_pose((0.0, 0.0, 0.0, norm, 0.0, 0.0, 0.0), LIMIT)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("index", range(7))
def test_not_finite(bad: float, index: int) -> None:
    """One number that is not finite, wherever it stands, is refused."""
    pose = [*GOOD]
    pose[index] = bad
    with pytest.raises(ServiceError, match="not finite"):
        checked_pose(pose, LIMIT)


@pytest.mark.parametrize("length", [0, 1, 2, 4, 5, 6, 8, 100])
def test_length(length: int) -> None:
    """Only seven numbers, or three, are a pose."""
    with pytest.raises(ServiceError, match=f"got {length}"):
        checked_pose((0.0,) * length, LIMIT)


@given(
    position=st.tuples(*[st.floats(-0.2, 0.2)] * 3).filter(lambda p: math.hypot(*p) > 0.01),
)
def test_millimetres_are_recognised(position: tuple[float, float, float]) -> None:
    """A workspace position over a centimetre from the origin, sent in mm, is refused as millimetres."""
    with pytest.raises(ServiceError) as caught:
        checked_pose([1000 * v for v in position] + [1.0, 0.0, 0.0, 0.0], LIMIT)
    assert caught.value.status == "BAD_INPUT"
    assert "millimetres" in caught.value.hint


@given(reach=st.floats(0.01, 100))
def test_limit_admits_the_training_region(reach: float) -> None:
    """In whatever frame a model was trained, its region lies well inside the limit, and mm of it outside."""
    corner = [reach / math.sqrt(3)] * 3
    limit = position_limit({"training_region": {"position_min": corner, "position_max": corner}})
    assert limit >= 9 * reach
    assert limit < max(1000 * reach, 5.1)


def test_limit_without_region() -> None:
    """A model that does not tell its region is held to the size of a room."""
    assert position_limit({}) == 5.0


@pytest.mark.parametrize("twist", [(0.0,) * 5, (math.nan, *(0.0,) * 5), (50.0, *(0.0,) * 5), (*(0.0,) * 5, 500.0)])
def test_bad_twist(twist: tuple[float, ...]) -> None:
    """Wrong length, not finite, mm/s or deg/s of a fast move: refused."""
    with pytest.raises(ServiceError, match="BAD_INPUT"):
        checked_twist(twist)


def test_no_twist_stays_none() -> None:
    """An unknown twist is not a twist of zero: the corrector decides what it means."""
    assert checked_twist(None) is None


def test_path_names_the_bad_row() -> None:
    """A path is refused with the row that is at fault."""
    with pytest.raises(ServiceError, match="pose 1 of the path"):
        checked_path((GOOD, (*GOOD[:3], 2.0, 0.0, 0.0, 0.0)), (0.0, 0.1), LIMIT)


@pytest.mark.parametrize(
    ("poses", "times"),
    [
        ((), ()),
        ((GOOD, GOOD), (0.0,)),
        ((GOOD, GOOD), (0.0, 0.0)),
        ((GOOD, GOOD), (1.0, 0.5)),
        ((GOOD, GOOD), (0.0, math.nan)),
        ((GOOD, GOOD[:3]), (0.0, 1.0)),
        ((GOOD,) * (LIMITS.rows + 1), tuple(float(i) for i in range(LIMITS.rows + 1))),
    ],
    ids=["empty", "a time missing", "same time", "backwards", "nan time", "mixed lengths", "too long"],
)
def test_bad_path(poses: tuple[tuple[float, ...], ...], times: tuple[float, ...]) -> None:
    """A path is one to 5000 poses of one length with as many finite, increasing times."""
    with pytest.raises(ServiceError, match="BAD_INPUT"):
        checked_path(poses, times, LIMIT)


@pytest.mark.parametrize(
    ("position", "quaternion"),
    [
        ([math.nan, 0, 0], None),
        ([0, 0, 0], [math.inf, 0, 0, 0]),
        ([0, 0, 0], [1.1, 0, 0, 0]),
        ([99, 0, 0], None),
    ],
)
def test_unsafe_answer_is_withheld(position: list[float], quaternion: list[float] | None) -> None:
    """A command that is not finite, not a rotation, or outside any workspace never leaves the server."""
    with pytest.raises(ServiceError, match="INTERNAL"):
        check_command(position, quaternion, LIMIT, lambda: (0.0, 0.0, 0.0))
