"""Layout of the points of a nearest-neighbour search: distinct, split, packed by leaf."""

import numpy as np
import numpy.typing as npt

from core.kernels.compiled import in_chunks, jit
from core.kernels.lanes import address, prefetch
from core.types import Array, Indices

Indices32 = npt.NDArray[np.int32]

LEAF = 32
WIDTH = 8
SAMPLED = 128
"""Minimum sample of points for finding the longest side; no result depends on it."""
AHEAD = 16
"""How many points ahead memory is prefetched."""
POINTS_A_TASK = 32_768
EMPTY = 2**31 - 1
"""Original index of an unused lane: above all points, so that it never wins a tie."""


def pack(points: Array) -> tuple[Array, Indices32, Array, Indices32]:
    """Fields of a Tree. points: (n, d) finite, C-contiguous."""
    order, first = _distinct(points)
    leaves, original, boxes, lane_of = pack_rows(points, order)
    return leaves, original, boxes, lane_of[first]


def pack_rows(points: Array, order: Indices32) -> tuple[Array, Indices32, Array, Indices32]:
    """The first three fields of a Tree of some rows of points, and the lane of each row.

    order: (m,) rows; sorted into the leaves here.   Returns lanes (n,).
    """
    n, d = points.shape
    n_leaves = (len(order) + LEAF - 1) // LEAF
    n_nodes = (n_leaves + WIDTH - 3) // (WIDTH - 1)
    owned = _split_all(points, order, n_nodes, n_leaves)
    leaves, original = np.empty((n_leaves, d, LEAF)), np.empty(n_leaves * LEAF, np.int32)
    boxes = np.empty((n_nodes, 2, d, WIDTH))
    boxes[:, 0], boxes[:, 1] = np.inf, -np.inf
    lane_of = np.empty(n, np.int32)
    in_chunks(
        n_leaves,
        POINTS_A_TASK // LEAF,
        lambda a, b: _fill_some(
            points, order, owned, n_nodes, a, b, leaves, original, boxes, lane_of
        ),
    )
    _enclose(boxes)
    return leaves.reshape(-1), original, boxes.reshape(-1), lane_of


@jit
def _fill_some(points, order, owned, n_nodes, start, stop, leaves, original, boxes, lane_of):
    d, rows = points.shape[1], address(points)
    for leaf in range(start, stop):
        node = n_nodes + leaf
        lo, hi = owned[node]
        for j in range(hi - lo):
            row = order[lo + j]
            prefetch(rows, np.int64(order[min(lo + j + AHEAD, len(order) - 1)]) * d)
            original[leaf * LEAF + j] = row
            lane_of[row] = leaf * LEAF + j
            for k in range(d):
                leaves[leaf, k, j] = points[row, k]
        leaves[leaf, :, hi - lo :] = np.inf
        original[leaf * LEAF + hi - lo : (leaf + 1) * LEAF] = EMPTY
        if node > 0:
            above, j = (node - 1) // WIDTH, (node - 1) % WIDTH
            for k in range(d):
                low, high = _extent(points, order, lo, hi, np.int64(1), k)
                boxes[above, 0, k, j], boxes[above, 1, k, j] = low, high


@jit
def _enclose(boxes):
    """Write each node's box into its parent."""
    for node in range(len(boxes) - 1, 0, -1):
        above, j = (node - 1) // WIDTH, (node - 1) % WIDTH
        for k in range(boxes.shape[2]):
            boxes[above, 0, k, j] = boxes[node, 0, k].min()
            boxes[above, 1, k, j] = boxes[node, 1, k].max()


@jit
def _distinct(points):
    """Points with at most two copies each, and for each point the first equal point.

    The two lowest numbered copies stay, so that leaving one out still finds the other.
    """
    n = len(points)
    bits = points.view(np.uint64)
    size = 16
    while size < 2 * n:
        size *= 2
    table = np.full(size, -1, np.int32)
    twice = np.zeros(n, np.bool_)
    first, stored, n_stored = np.empty(n, np.int32), np.empty(n, np.int32), 0
    slots, lies_at = np.empty(AHEAD, np.uint64), address(table)
    for i in range(-AHEAD, n):  # each point is hashed AHEAD turns before its own
        at = slots[i % AHEAD]
        if i + AHEAD < n:
            slot = _hash(bits, i + AHEAD) & np.uint64(size - 1)
            slots[i % AHEAD] = slot
            prefetch(lies_at, np.int64(slot) // 2)
        if i < 0:
            continue
        while table[at] >= 0 and not _equal(bits, i, table[at]):
            at = (at + np.uint64(1)) & np.uint64(size - 1)
        new = table[at] < 0
        if new:
            table[at] = i
        first[i] = table[at]
        if new or not twice[first[i]]:
            twice[first[i]] = not new
            stored[n_stored] = i
            n_stored += 1
    return stored[:n_stored].copy(), first


@jit
def _hash(bits, i):
    h = np.uint64(0)
    for k in range(bits.shape[1]):
        h = (h ^ bits[i, k]) * np.uint64(0x9E3779B97F4A7C15)
        h ^= h >> np.uint64(32)
    return h


@jit
def _equal(bits, i, j):
    same = True
    for k in range(bits.shape[1]):
        same &= bits[i, k] == bits[j, k]
    return same


def _split_all(points: Array, order: Indices32, n_nodes: int, n_leaves: int) -> Indices:
    """Sort `order` so that each node of the heap has a contiguous range, evenly filled.

    Returns (n_nodes + n_leaves, 2): first and past-the-last position of each node's points.
    """
    leaves = _leaves_below(n_nodes, n_leaves)
    owned = np.zeros((len(leaves), 2), np.int64)
    owned[0, 1] = len(order)
    key = np.empty(len(order))
    first, stop = 0, min(1, n_nodes)
    while first < stop:  # nodes of one depth, with disjoint points
        n = stop - first
        in_chunks(
            n,
            max(1, n * POINTS_A_TASK // len(order)),
            lambda a, b, first=first: _split_some(
                leaves, owned, first + a, first + b, points, order, key
            ),
        )
        first, stop = WIDTH * first + 1, min(WIDTH * stop + 1, n_nodes)
    return owned


@jit
def _leaves_below(n_nodes, n_leaves):
    # Numbers up to the last node's last child; those after the last leaf have no points.
    leaves = np.zeros(max(WIDTH * n_nodes + 1, n_nodes + n_leaves), np.int64)
    leaves[n_nodes : n_nodes + n_leaves] = 1
    for node in range(n_nodes - 1, -1, -1):
        leaves[node] = leaves[WIDTH * node + 1 : WIDTH * node + 1 + WIDTH].sum()
    return leaves


@jit
def _split_some(leaves, owned, start, stop, points, order, key):
    """Split nodes start..stop among their children. key: (m,) workspace."""
    edge = np.empty(WIDTH + 1, np.int64)
    for node in range(start, stop):
        child = WIDTH * node + 1
        edge[0], edge[WIDTH] = owned[node]
        half = WIDTH // 2
        while half > 0:
            for a in range(0, WIDTH, 2 * half):
                lo, hi = edge[a], edge[a + 2 * half]
                left = leaves[child + a : child + a + half].sum()
                right = leaves[child + a + half : child + a + 2 * half].sum()
                edge[a + half] = lo + (hi - lo) * left // max(left + right, 1)
                if left > 0 and right > 0:
                    _split(points, order[lo:hi], key[lo:hi], edge[a + half] - lo)
            half //= 2
        for j in range(WIDTH):
            owned[child + j, 0], owned[child + j, 1] = edge[j], edge[j + 1]


@jit
def _split(points, order, key, middle):
    """Move the `middle` lowest points along the (sampled) longest side to the front."""
    axis, longest, step = 0, -1.0, max(1, len(order) // SAMPLED)
    for k in range(points.shape[1]):
        low, high = _extent(points, order, np.int64(0), len(order), step, k)
        if high - low > longest:
            axis, longest = k, high - low
    for i in range(len(order)):
        key[i] = points[order[i], axis]
    _select(key, order, middle)


@jit
def _extent(points, order, start, stop, step, k):
    """Lowest and highest coordinate k of the rows order[start:stop:step]."""
    low, high = np.inf, -np.inf
    for i in range(start, stop, step):
        x = points[order[i], k]
        low = x if x < low else low
        high = x if x > high else high
    return low, high


@jit
def _select(key, order, middle):
    """Quickselect: afterwards key[:middle] <= key[middle:len(order)]; `order` moves along."""
    lo, hi = np.int64(0), len(order)
    for _ in range(64):
        if hi - lo < 2:
            return
        third = (hi - lo) // 3
        low = _median(key[lo], key[lo + third // 2], key[lo + third])
        mid = _median(key[lo + third + third // 2], key[(lo + hi) // 2], key[hi - 1 - third])
        high = _median(key[hi - 1 - third // 2], key[hi - 1 - third // 4], key[hi - 1])
        pivot = _median(low, mid, high)
        j = _below(key, order, lo, hi, pivot, np.bool_(False))
        if middle < j:
            hi = j
        elif middle > j > lo:
            lo = j
        else:
            if middle > j:
                # none is below the pivot: put those equal to it first
                lo = _below(key, order, lo, hi, pivot, np.bool_(True))
            if middle <= lo or middle == j:
                return
    # If pivots keep failing, sort the rest, so that it stays O(n log n).
    _merge_sort(key[lo:hi], order[lo:hi])


@jit
def _median(a, b, c):
    return max(min(a, b), min(max(a, b), c))


@jit
def _below(key, order, lo, hi, pivot, equal):
    """Move keys below the pivot to the front of lo..hi, without a branch; returns their end.

    equal: also keys equal to the pivot.
    """
    j = lo
    for i in range(lo, hi):
        x, row = key[i], order[i]
        key[i], order[i] = key[j], order[j]
        key[j], order[j] = x, row
        j += (x < pivot) | (equal & (x <= pivot))
    return j


@jit
def _merge_sort(key, order):
    """Sort `order` by key; equal keys keep their order.

    np.argsort(key, kind="mergesort") gives the same, but takes seconds to compile.
    """
    n, width = len(key), 1
    keys, rows = key.copy(), order.copy()
    while width < n:
        for lo in range(0, n, 2 * width):
            i, j = lo, min(lo + width, n)
            middle, hi = j, min(lo + 2 * width, n)
            for at in range(lo, hi):
                if j < hi and (i == middle or key[j] < key[i]):
                    keys[at], rows[at] = key[j], order[j]
                    j += 1
                else:
                    keys[at], rows[at] = key[i], order[i]
                    i += 1
        key[:], order[:] = keys, rows
        width *= 2
