"""Bounding volume hierarchies with four or eight children per node, built on the host.

Binary trees are grown level by level with the binned surface area heuristic (Wald 2007), all nodes
of a level at once, with the finer bins the larger they are. Wide nodes are those of all choices
whose areas add up to the least (Wald, Benthin, Boulos 2008). Child boxes lie side by side, so that
one vector instruction meets all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class BvhWidth:
    """Width of a hierarchy."""

    width: int
    """Children of a node."""
    leaf_max: int
    """Triangles of a leaf."""
    packed: bool
    """Leaves are ``leaf_max`` triangles side by side, otherwise runs of single triangles."""


CPU = BvhWidth(8, 8, packed=True)
"""What :mod:`twin.render.trace.traverse` meets with vector instructions."""
CUDA = BvhWidth(4, 2, packed=False)
"""What it meets one by one."""
NOBODY = np.int32(-(2**31))
"""No child."""
_BINS, _BINS_MAX = 32, 128
"""Bins along an axis: as many as the nodes of a level have faces, within these limits."""
_PAD_M, _PAD = 1e-4, 2e-6
"""Child boxes are larger by this, absolute and relative to the farthest coordinate."""
_SAH_LEVELS = 24
"""Deeper nodes are halved, so that no tree is deeper than the traversals' stacks."""


@dataclass(frozen=True, slots=True)
class Bvh:
    """Words of a hierarchy; integers stand in them bit by bit."""

    nodes: np.ndarray
    """float32 [N, 7, width], root first: low x, y, z and high x, y, z of every child, then the
    children: a node (>= 0), a leaf (< 0), or :data:`NOBODY`."""
    leaves: np.ndarray
    """float32, packed [L, 10, leaf_max]: x, y, z of the first, second and third corners, then the
    faces (-1: none), and leaf i is child -1 - i; otherwise [F, 3, 4]: a corner per row, the face
    behind the first, room for a mark behind the second (of holes, in worlds that have them), and n
    faces from i on are child -1 - (16 i + n)."""

    def words(
        self, first_node: int, first_leaf: int, shape: BvhWidth
    ) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and leaves as flat arrays, to stand behind others with so many nodes and leaf
        rows."""
        nodes = self.nodes.copy()
        links = nodes.view(np.int32)[:, 6]
        inner, leaf = links >= 0, (links < 0) & (links != NOBODY)
        links[inner] += first_node
        links[leaf] -= first_leaf * (1 if shape.packed else 16)
        return nodes.ravel(), self.leaves.ravel()


@dataclass(slots=True)
class _Tree:
    """A binary tree; children of inner nodes are ``left`` and ``left + 1``."""

    low: np.ndarray
    high: np.ndarray
    left: np.ndarray
    """-1: a leaf."""
    start: np.ndarray
    count: np.ndarray
    order: np.ndarray
    """Faces; a leaf's stand side by side."""


def build_bvh(points_m: np.ndarray, faces: np.ndarray, shape: BvhWidth) -> Bvh:
    """The hierarchy over ``faces`` [F, 3] of ``points_m`` [V, 3]."""
    corners = points_m[faces].astype(np.float32)
    tree = _grow(corners.min(axis=1), corners.max(axis=1), shape.leaf_max)
    nodes, leaves = _widen(tree, shape.width)
    start, count = tree.start[leaves], tree.count[leaves]
    links = nodes.view(np.int32)[:, 6]
    if shape.packed:
        return Bvh(nodes, _packed(tree.order, start, count, corners, shape.leaf_max))
    used = (links < 0) & (links != NOBODY)
    leaf = -1 - links[used]
    links[used] = -1 - (16 * start[leaf] + count[leaf])
    return Bvh(nodes, _single(tree.order, corners))


def _area(size: np.ndarray) -> np.ndarray:
    size = np.maximum(size, 0.0)
    return size[..., 0] * (size[..., 1] + size[..., 2]) + size[..., 1] * size[..., 2]


def _grow(low: np.ndarray, high: np.ndarray, leaf_max: int) -> _Tree:
    count = len(low)
    order = np.arange(count)
    middle = (low.astype(float) + high) / 2
    lows, highs, lefts = [low.min(axis=0)[None]], [high.max(axis=0)[None]], []
    starts, counts = [np.zeros(1, np.int64)], [np.array([count])]
    nodes = 1
    while True:
        start, size = starts[-1], counts[-1]
        inner = size > leaf_max
        left = np.full(len(size), -1)
        left[inner] = nodes + 2 * np.arange(inner.sum())
        lefts.append(left)
        if not inner.any():
            break
        nodes += 2 * int(inner.sum())
        a, n = start[inner], size[inner]
        spread = middle if len(lefts) <= _SAH_LEVELS else np.zeros_like(middle)
        right_count = _split(order, low, high, spread, a, n, leaf_max)
        starts.append(np.stack([a, a + n - right_count], 1).ravel())
        counts.append(np.stack([n - right_count, right_count], 1).ravel())
        member, first = _members(starts[-1], counts[-1])
        faces = order[member]
        lows.append(np.minimum.reduceat(low[faces], first))
        highs.append(np.maximum.reduceat(high[faces], first))
    return _Tree(*map(np.concatenate, (lows, highs, lefts, starts, counts)), order)


def _members(start: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places in the order of all members of some nodes, and where each node's begin among them."""
    first = np.cumsum(count) - count
    return np.arange(count.sum()) - np.repeat(first - start, count), first


def _split(
    order: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    middle: np.ndarray,
    start: np.ndarray,
    count: np.ndarray,
    leaf_max: int,
) -> np.ndarray:
    """Reorder the members of nodes so that their right children come last; returns their counts."""
    member, first = _members(start, count)
    faces = order[member]
    node = np.repeat(np.arange(len(start)), count)
    bin_count = min(_BINS_MAX, max(_BINS, len(member) // len(start)))
    centre = middle[faces]
    base = np.minimum.reduceat(centre, first)
    extent = np.maximum.reduceat(centre, first) - base
    scale = np.where(extent > 0, bin_count * (1 - 1e-6) / np.where(extent > 0, extent, 1), 0)
    bins = ((centre - base[node]) * scale[node]).astype(np.int64)
    best = np.full(len(start), np.inf)
    axis = np.zeros(len(start), np.int64)
    cut = np.zeros(len(start), np.int64)
    for k in range(3):
        key = node * bin_count + bins[:, k]
        shape = (len(start), bin_count)
        number = np.bincount(key, minlength=len(start) * bin_count).reshape(shape)
        box_low = np.full((len(start) * bin_count, 3), np.inf)
        box_high = np.full((len(start) * bin_count, 3), -np.inf)
        # Much faster than ufunc.at: faces sorted by bin, then one reduction per bin.
        sorted_ = np.argsort(key, kind="stable")
        used = np.flatnonzero(number.ravel())
        begin = (np.cumsum(number.ravel()) - number.ravel())[used]
        box_low[used] = np.minimum.reduceat(low[faces[sorted_]], begin)
        box_high[used] = np.maximum.reduceat(high[faces[sorted_]], begin)
        box_low, box_high = box_low.reshape(*shape, 3), box_high.reshape(*shape, 3)
        size_left = np.maximum.accumulate(box_high, 1) - np.minimum.accumulate(box_low, 1)
        back_low = np.minimum.accumulate(box_low[:, ::-1], 1)[:, ::-1]
        back_high = np.maximum.accumulate(box_high[:, ::-1], 1)[:, ::-1]
        before = np.cumsum(number, axis=1)[:, :-1]
        after = count[:, None] - before
        # A leaf costs as much as one face.
        packs = -(-before // leaf_max) * _area(size_left[:, :-1])
        packs = packs + -(-after // leaf_max) * _area((back_high - back_low)[:, 1:])
        cost = np.where((before == 0) | (after == 0), np.inf, packs)
        choice = cost.argmin(axis=1)
        found = cost[np.arange(len(start)), choice]
        better = found < best
        best[better], axis[better], cut[better] = found[better], k, choice[better]
    right = bins[np.arange(len(member)), axis[node]] > cut[node]
    # Faces with one common centre: halve them as they stand.
    stuck = np.isinf(best)
    place = np.arange(len(member)) - first[node]
    right = np.where(stuck[node], place >= count[node] // 2, right)
    order[member] = faces[np.lexsort((right, node))]
    return np.bincount(node[right], minlength=len(start))


def _levels(tree: _Tree) -> list[slice]:
    """The nodes of each level of a tree, root first."""
    levels, start, stop = [], 0, 1
    while start < stop:
        levels.append(slice(start, stop))
        start, stop = stop, stop + 2 * int((tree.left[start:stop] >= 0).sum())
    return levels


def _choices(tree: _Tree, area: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Choices by which binary nodes become wide ones whose areas add up to the least.

    Returns:
        For each node and number of places: how many of them go to its left child [N, width + 1];
        and whether it takes just one of them as a wide node of its own [N, width + 1].
    """
    nodes = len(area)
    least = np.zeros((nodes, width + 1))  # of what is below a node that has so many places
    to_left = np.ones((nodes, width + 1), np.int64)
    alone = np.ones((nodes, width + 1), np.bool_)
    for level in reversed(_levels(tree)):
        inner = np.flatnonzero(tree.left[level] >= 0) + level.start
        left, right = least[tree.left[inner]], least[tree.left[inner] + 1]
        opened = np.full((len(inner), width + 1), np.inf)
        for places in range(2, width + 1):
            sums = left[:, 1:places] + right[:, places - 1 : 0 : -1]
            to_left[inner, places] = 1 + sums.argmin(axis=1)
            opened[:, places] = sums.min(axis=1)
        whole = (area[inner] + opened[:, width])[:, None]
        alone[inner] = whole <= opened
        least[inner] = np.minimum(whole, opened)
    return to_left, alone


def _children(tree: _Tree, to_left: np.ndarray, alone: np.ndarray, node: int) -> list[int]:
    """Nodes of the binary tree that a wide node at ``node`` has for children, leaves last."""
    width = to_left.shape[1] - 1
    inner, closed = [], []
    waiting = [(node, width)]
    while waiting:
        at, places = waiting.pop()
        if tree.left[at] < 0:
            closed.append(at)
        elif at != node and alone[at, places]:
            inner.append(at)
        else:
            left = int(to_left[at, places])
            waiting += [(int(tree.left[at]) + 1, places - left), (int(tree.left[at]), left)]
    return inner + closed


def _widen(tree: _Tree, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes with children -1 - i for leaf i, and the tree's nodes that became leaves."""
    to_left, alone = _choices(tree, _area(tree.high - tree.low), width)
    # A traversal's arithmetic moves a plane by the rounding of its place and of the ray's.
    pad = _PAD_M + _PAD * max(np.abs(tree.low[0]).max(), np.abs(tree.high[0]).max())
    rows: list[np.ndarray] = []
    leaves: list[int] = []
    queue = [0]
    while len(rows) < len(queue):
        row = np.zeros((7, width), np.float32)
        row[:3], row[3:6] = np.inf, -np.inf
        links = row[6].view(np.int32)
        links[:] = NOBODY
        for i, child in enumerate(_children(tree, to_left, alone, queue[len(rows)])):
            row[:3, i], row[3:6, i] = tree.low[child] - pad, tree.high[child] + pad
            if tree.left[child] < 0:
                links[i] = -1 - len(leaves)
                leaves.append(child)
            else:
                links[i] = len(queue)
                queue.append(child)
        rows.append(row)
    return np.array(rows), np.array(leaves)


def _packed(
    order: np.ndarray, start: np.ndarray, count: np.ndarray, corners: np.ndarray, width: int
) -> np.ndarray:
    place = np.arange(width)
    used = place < count[:, None]
    face = order[np.where(used, start[:, None] + place, start[:, None])]
    packed = np.zeros((len(start), 10, width), np.float32)
    packed[:, :9] = corners[face].reshape(len(start), width, 9).transpose(0, 2, 1)
    # A face that is not there is a point: no ray meets it.
    packed[:, :9] = np.where(used[:, None], packed[:, :9], np.tile(packed[:, :3], (1, 3, 1)))
    packed[:, 9] = np.where(used, face, -1).astype(np.int32).view(np.float32)
    return packed


def _single(order: np.ndarray, corners: np.ndarray) -> np.ndarray:
    rows = np.zeros((len(order), 3, 4), np.float32)
    rows[:, :, :3] = corners[order]
    rows[:, 0, 3] = order.astype(np.int32).view(np.float32)
    return rows
