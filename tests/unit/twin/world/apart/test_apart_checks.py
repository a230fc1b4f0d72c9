"""twin.world.apart.checks and frames: declared answers there and back."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from twin.world.apart import frames
from twin.world.apart.checks import (
    AnswerError,
    Array,
    Flag,
    ListOf,
    Number,
    Record,
    Text,
    pack,
    unpack,
)
from twin.world.apart.frames import FrameReader, write_frame


@dataclass
class Leaf:
    """Something with one field of each sort."""

    values: np.ndarray
    indices: np.ndarray | None = None
    share: float | None = None
    count: int = 0
    wrap: str = "repeat"
    solid: bool = False
    wraps: tuple[str, str] = ("repeat", "clamp")


WRAP = Text(allowed=("repeat", "clamp"))
LEAF = Record(
    Leaf,
    {
        "indices": Array("int32", ("n",), optional=True, below="V"),
        "values": Array("float32", ("V", 2)),
        "share": Number(0.0, 1.0, optional=True),
        "count": Number(0, 9, whole=True),
        "wrap": WRAP,
        "solid": Flag(),
        "wraps": ListOf(WRAP, 2, least=2, as_tuple=True),
    },
)
LEAVES = ListOf(LEAF, 3)


def leaf(**changes: Any) -> Leaf:
    """A leaf as declared, but for ``changes``."""
    return Leaf(**{"values": np.ones((4, 2), np.float32), **changes})


def there_and_back(value: Any, check: Any) -> Any:
    """What arrives of a value that goes through a pipe."""
    memory = os.memfd_create("pipe")
    try:
        write_frame(lambda data: os.write(memory, data), *pack(value, check))
        os.lseek(memory, 0, os.SEEK_SET)
        head, arrays = FrameReader(memory, time.monotonic() + 60.0, 1 << 20).frame()
        assert not head.error
        return unpack(head.tree, check, arrays)
    finally:
        os.close(memory)


def test_every_sort_of_field_arrives() -> None:
    sent = leaf(indices=np.array([3, 0], np.int32), share=0.25, count=np.int64(7), solid=True)
    (found,) = there_and_back([sent], LEAVES)
    assert found.values.tolist() == [[1.0, 1.0]] * 4
    assert found.indices.tolist() == [3, 0]
    assert (found.share, found.count, found.wrap, found.solid) == (0.25, 7, "repeat", True)
    assert found.wraps == ("repeat", "clamp")
    assert there_and_back([leaf()], LEAVES)[0].indices is None


def test_an_array_in_two_places_is_sent_once_and_stays_one() -> None:
    shared = np.ones((4, 2), np.float32)
    first, second, third = there_and_back(
        [leaf(values=shared), leaf(values=shared), leaf()], LEAVES
    )
    assert first.values is second.values
    assert first.values is not third.values
    assert len(pack([leaf(values=shared), leaf(values=shared)], LEAVES)[1]) == 1


def test_a_view_of_an_array_arrives_in_its_order() -> None:
    turned = np.arange(8, dtype=np.float32).reshape(2, 4).T
    assert there_and_back([leaf(values=turned)], LEAVES)[0].values.tolist() == turned.tolist()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"indices": np.array([4], np.int32)}, "indices names what is not there"),
        ({"values": np.ones((4, 3), np.float32)}, "values of type float32, shape"),
        ({"share": 1.5}, "share is not as declared"),
        ({"share": True}, "share is not as declared"),
        ({"count": 1.0}, "count is not as declared"),
        ({"count": None}, "count is missing"),
        ({"wrap": "mirror"}, "wrap is not as declared"),
        ({"solid": 1}, "solid is not as declared"),
        ({"wraps": ("repeat",)}, "wraps is no list of 2 to 2"),
        ({"wraps": ("repeat", 7)}, "wraps is not as declared"),
    ],
)
def test_what_is_not_as_declared_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(AnswerError, match=words):
        there_and_back([leaf(**changes)], LEAVES)


@pytest.mark.parametrize("tree", [{}, {"values": 0}, 7, [[]], [{"values": 0, "other": 1}], "x"])
def test_another_form_is_refused(tree: Any) -> None:
    with pytest.raises(AnswerError):
        unpack(tree, LEAVES, [np.ones((4, 2), np.float32)])


@pytest.mark.parametrize("number", [-1, 1, True, 0.0, "0", 1 << 70])
def test_an_array_that_is_not_there_is_refused(number: Any) -> None:
    tree = {**pack(leaf(), LEAF)[0], "values": number}
    with pytest.raises(AnswerError):
        unpack(tree, LEAF, [np.ones((4, 2), np.float32)])


def test_a_field_without_a_row_is_a_bug_of_ours() -> None:
    short = Record(Leaf, {name: row for name, row in LEAF.rows.items() if name != "wrap"})
    with pytest.raises(AssertionError, match=r"Leaf: fields without a check.*'wrap'"):
        pack(leaf(), short)


def test_more_than_is_read_is_refused_by_who_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "ARRAYS_MAX", 2)
    with pytest.raises(AnswerError, match="more than 2 parts"):
        there_and_back([leaf(), leaf(), leaf()], LEAVES)
