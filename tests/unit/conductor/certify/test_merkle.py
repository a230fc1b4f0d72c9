"""The tree against RFC 6962's own definition, and known roots of Certificate Transparency."""

from __future__ import annotations

import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from conductor.certify.merkle import leaf_hash, path_of, root_from, root_of

INPUTS = [
    bytes.fromhex(text)
    for text in (
        *("", "00", "10", "2021", "3031", "40414243", "5051525354555657"),
        "606162636465666768696a6b6c6d6e6f",
    )
]
"""Leaves of the test vectors of Certificate Transparency (google/certificate-transparency)."""
ROOTS = {
    1: "6e340b9cffb37a989ca544e6bb780a2c78901d3fb33738768511a30617afa01d",
    2: "fac54203e7cc696cf0dfcb42c92a1d9dbaf70ad9e621f4bd8d98662f00e3c125",
    3: "aeb6bcfe274b70a14fb067a5e5578264db0fa9b51af5e0ba159158f329e06e77",
    8: "5dc9da79a70659a9ad559cb701ded9a2ab9d823aad2f4960cfe370eff4604328",
}


def defined(data: list[bytes]) -> bytes:
    """MTH of RFC 6962, section 2.1, as it stands there."""
    if not data:
        return hashlib.sha256(b"").digest()
    if len(data) == 1:
        return hashlib.sha256(b"\x00" + data[0]).digest()
    k = 1
    while k * 2 < len(data):
        k *= 2
    return hashlib.sha256(b"\x01" + defined(data[:k]) + defined(data[k:])).digest()


@pytest.mark.parametrize("count", ROOTS)
def test_known_roots(count):
    assert root_of([leaf_hash(data) for data in INPUTS[:count]]).hex() == ROOTS[count]


@given(st.lists(st.binary(max_size=4), max_size=70))
def test_the_root_is_that_of_the_definition(data):
    assert root_of([leaf_hash(each) for each in data]) == defined(data)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 13, 64, 65])
def test_every_leaf_has_a_path_and_no_other_place_takes_it(count):
    leaves = [leaf_hash(bytes([number])) for number in range(count)]
    root = root_of(leaves)
    for index in range(count):
        path = path_of(leaves, index)
        assert root_from(leaves[index], index, count, path) == root
        others = [n for n in range(count) if n != index]
        assert all(root_from(leaves[index], n, count, path) != root for n in others)
        assert root_from(leaf_hash(b"other"), index, count, path) != root
        assert root_from(leaves[index], index, count, [*path, root]) is None
        if path:
            assert root_from(leaves[index], index, count, path[:-1]) is None


def test_places_outside_of_the_tree():
    assert root_from(leaf_hash(b""), 1, 1, []) is None
    assert root_from(leaf_hash(b""), -1, 1, []) is None
    with pytest.raises(IndexError):
        path_of([], 0)


def test_a_node_is_no_leaf():
    leaves = [leaf_hash(b"a"), leaf_hash(b"b")]
    assert leaf_hash(leaves[0] + leaves[1]) != root_of(leaves)
