"""Trees of dataclasses survive being taken apart and put together."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest

from gpcorrect.codec import pack, unpack
from gpcorrect.errors import DataError
from gpcorrect.types import FloatArray


@dataclass(frozen=True)
class Leaf:
    weights: FloatArray
    scale: float


@dataclass(frozen=True)
class Bud:
    size: float


class Flower(Bud):
    """A kind of bud."""


@dataclass(frozen=True)
class Tree:
    tip: Leaf | Bud
    bloom: Bud
    leaf: Leaf
    leaves: tuple[Leaf, ...]
    absent: Leaf | None
    pair: tuple[float, str]
    limit: float | None = None


def make_tree() -> Tree:
    leaves = tuple(Leaf(np.arange(i + 1.0), float(i)) for i in range(3))
    return Tree(Bud(0.5), Flower(2.0), leaves[2], leaves, None, (0.1, "x"), 3.5)


def test_a_tree_comes_back_through_json_as_it_was() -> None:
    """Every number, text, None and array is the same after JSON."""
    data, arrays = pack(make_tree(), "tree")
    back = unpack(Tree, json.loads(json.dumps(data)), arrays)
    assert back.pair == (0.1, "x")
    assert back.absent is None
    assert back.limit == 3.5
    assert back.tip == Bud(0.5)
    assert isinstance(back.bloom, Flower)
    assert [leaf.weights.tolist() for leaf in back.leaves] == [[0.0], [0.0, 1.0], [0.0, 1.0, 2.0]]
    assert not back.leaf.weights.flags.writeable


def test_arrays_are_built_row_by_row() -> None:
    """However a file lays an array out, compiled code gets it in the order that it was compiled for."""

    @dataclass(frozen=True)
    class Table:
        weights: FloatArray

    columns = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    back = unpack(Table, {"type": "Table", "weights": "array:w"}, {"w": columns})
    np.testing.assert_array_equal(back.weights, columns)
    assert back.weights.flags.c_contiguous


def test_missing_arrays_and_foreign_fields_are_refused() -> None:
    """Nothing is made up: a lost array or another set of fields is an error."""
    data, arrays = pack(make_tree(), "tree")
    with pytest.raises(DataError, match=r"tree\.leaf\.weights is missing"):
        unpack(Tree, data, {k: v for k, v in arrays.items() if k != "tree.leaf.weights"})
    with pytest.raises(DataError, match="is none of"):
        unpack(Tree, {**data, "tip": {"type": "Root", "size": 1.0}}, arrays)
    with pytest.raises(DataError, match="does not have the fields"):
        unpack(Tree, {**data, "more": 1}, arrays)
    with pytest.raises(DataError, match="does not have the fields"):
        unpack(Tree, {name: value for name, value in data.items() if name != "tip"}, arrays)


def test_a_field_that_files_of_before_lack_has_its_default() -> None:
    """Only where the class has one."""
    data, arrays = pack(make_tree(), "tree")
    assert unpack(Tree, {name: value for name, value in data.items() if name != "limit"}, arrays).limit is None


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("limit", "3.5"),
        ("limit", True),
        ("pair", [0.1, 3]),
        ("pair", [0.1]),
        ("leaves", {}),
        ("leaf", {"type": "Leaf", "weights": "array:tree.leaf.weights", "scale": [1.0]}),
        ("leaf", {"type": "Leaf", "weights": 1.0, "scale": 1.0}),
        ("leaf", None),
    ],
)
def test_what_is_not_of_its_type_is_refused(place: str, value: object) -> None:
    """A number, word, list or array of another type than the hint says never reaches the class."""
    data, arrays = pack(make_tree(), "tree")
    with pytest.raises((DataError, ValueError)):
        unpack(Tree, {**data, place: value}, arrays)


def test_an_integer_that_no_float_holds_is_no_number() -> None:
    """Others become floats: what prints or computes them later meets no integer of 400 digits."""
    assert isinstance(unpack(Bud, {"type": "Bud", "size": 3}, {}).size, float)
    with pytest.raises(DataError, match="floating-point"):
        unpack(Bud, {"type": "Bud", "size": 10**400}, {})


def test_an_array_of_another_type_is_refused() -> None:
    """Text, or single precision, is no array of float64."""
    data, arrays = pack(make_tree(), "tree")
    name = "tree.leaf.weights"
    with pytest.raises(DataError, match="holds <U32, expected float64"):
        unpack(Tree, data, {**arrays, name: arrays[name].astype(str)})
