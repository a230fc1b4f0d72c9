"""A hash tree over the rows of a certificate, as RFC 6962 and RFC 9162 (section 2.1) define it.

A leaf is SHA-256 of ``0x00`` and its bytes, an inner node SHA-256 of ``0x01`` and its two children,
so that no leaf can be taken for a node. Every hash has 32 bytes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence


def leaf_hash(data: bytes) -> bytes:
    """Hash of a leaf with the content ``data``."""
    return hashlib.sha256(b"\0" + data).digest()


def root_of(leaves: Sequence[bytes]) -> bytes:
    """Root over the hashes of leaves, in their order; of none SHA-256 of nothing."""
    level = list(leaves)
    if not level:
        return hashlib.sha256().digest()
    while len(level) > 1:
        level = _above(level)
    return level[0]


def path_of(leaves: Sequence[bytes], index: int) -> list[bytes]:
    """The hashes that lead from leaf ``index`` to the root, from below.

    Raises:
        IndexError: there is no such leaf.
    """
    if not 0 <= index < len(leaves):
        raise IndexError(index)
    level, path = list(leaves), []
    while len(level) > 1:
        beside = index ^ 1
        if beside < len(level):  # the last one of an odd level has nothing beside it
            path.append(level[beside])
        level, index = _above(level), index >> 1
    return path


def root_from(leaf: bytes, index: int, count: int, path: Sequence[bytes]) -> bytes | None:
    """The root that follows from a leaf and its path (RFC 9162, 2.1.3.2).

    Args:
        leaf: hash of the leaf.
        index: its place among ``count`` leaves.
        count: number of leaves.
        path: as :func:`path_of` gives it.

    Returns:
        None: no tree of ``count`` leaves has a path of this length there.
    """
    if not 0 <= index < count:
        return None
    node, last = leaf, count - 1
    for beside in path:
        if last == 0:
            return None
        if index & 1 or index == last:
            node = _node(beside, node)
            while not index & 1 and index:
                index, last = index >> 1, last >> 1
        else:
            node = _node(node, beside)
        index, last = index >> 1, last >> 1
    return node if last == 0 else None


def _above(level: Sequence[bytes]) -> list[bytes]:
    """The next level; the last node of an odd level goes up as it is."""
    pairs = [_node(level[at], level[at + 1]) for at in range(0, len(level) - 1, 2)]
    return [*pairs, level[-1]] if len(level) % 2 else pairs


def _node(left: bytes, right: bytes) -> bytes:
    return hashlib.sha256(b"\1" + left + right).digest()
