"""Exact nearest neighbour among many points, fast enough for every sample of a live flight.

The tree is an 8-way heap of bounding boxes over leaves of 32 points, both stored lane by lane, so
that one instruction serves eight children or points. One bit each then marks which are near enough.
The search is exact to the last bit: rounding is monotone, so a box's bound, summed in the order of
a distance, never exceeds a distance inside.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.np.numpy_support import carray

from core.kernels.compiled import in_chunks, inlined, jit
from core.kernels.lanes import (
    add,
    address,
    at_most,
    load,
    lowest_bit,
    multiply,
    pointer_to,
    prefetch,
    read,
    splat,
    store,
    subtract,
    where_greater,
    write,
)
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
STACK = 128  # 7 waiting siblings per level, and 9 levels hold 2^31 points
MOST = 2**30  # points, so that 32-bit lane numbers suffice

# Kernels call intrinsics without the first argument, the typing context.
intrinsic: Any = extending.intrinsic

# Signed indices may be negative and count from the end, which prevents vectorisation.
U = np.uint64
_int32s = pointer_to(types.int32)


class Tree(NamedTuple):
    """Points packed for `nearest`, as returned by `build`. Distances use all d columns.

    points: leaf by leaf, (d, LEAF) each, unused lanes at infinity.
    original: (LEAF * n_leaves,) original index of each lane, EMPTY if unused.
    boxes: node by node, (2, d, WIDTH) each: lowest and highest corner of every child. Children of
        node k are nodes 8k+1 .. 8k+8; higher numbers than the last node are leaves.
    slot: (n,) lane of each original point, or of the first point equal to it.
    """

    points: Array
    original: npt.NDArray[np.int32]
    boxes: Array
    slot: npt.NDArray[np.int32]


def build(points: Array) -> Tree:
    """Pack points, O(n log n). Of equal points, at most two are stored.

    points: (n, d) finite, n >= 0, d >= 1.   ValueError on anything else.
    """
    points = np.ascontiguousarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] == 0 or len(points) > MOST:
        raise ValueError(
            f"points have shape {points.shape}: give (n, d) with d >= 1 and n <= {MOST}"
        )
    if not np.isfinite(points).all():
        row = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise ValueError(f"point {row} is {points[row]}: give finite points only")
    return Tree(*pack(points))


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
    # Pivots that keep failing would take O(n^2): sort the rest.
    order[lo:hi] = order[lo:hi][np.argsort(key[lo:hi])]


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


@inlined
def locate(tree):
    """Addresses of a tree's arrays; called before a loop, it avoids reference counting inside."""
    return (
        address(tree.points),
        address(tree.original),
        address(tree.boxes),
        address(tree.slot),
        tree.original.shape[0] // LEAF,
        tree.slot.shape[0],
    )


@jit
def nearest(tree, z, skip, hint):
    """`nearest_at` for a single search, also from Python."""
    return nearest_at(locate(tree), z, skip, hint)


@inlined
def nearest_at(place, z, skip, hint):
    """Squared distance and original index of the nearest point; the lowest index for ties.

    place: see `locate`; the tree must outlive the call.   z: (d,) C-contiguous float64.
    skip: original index of a point to leave out, -1 for none.
    hint: original index of a point likely to be near, -1 for none; it never changes the result.
    The distance is bit for bit min_i sum_k (z_k - x_ik)^2 summed in the order k = 0 .. d-1.
    (+inf, -1) if there is no point; (nan, -1) if z is not finite.
    """
    return _search(
        place[0],
        place[1],
        place[2],
        place[3],
        place[4],
        place[5],
        address(z),
        z.shape[0],
        np.int64(skip),  # a literal compiles the search again
        np.int64(hint),
    )


@inlined
def squared_distance_at(place, z, i):
    """Squared distance from z to original point i, 0 <= i < n; bit for bit as `nearest_at`."""
    return _squared_distance(place[0], place[3], address(z), z.shape[0], np.int64(i))


@jit
def _squared_distance(points, slot, z, d, i):
    return _distance(points, np.int64(carray(_int32s(slot), (1,))[U(i)]), z, d)


@intrinsic
def scratch(_context):
    """Address of LEAF + 2 * STACK floats on the machine stack, without allocation."""

    def generate(_generator, builder, _signature, _arguments):
        room = cgutils.alloca_once(builder, ir.DoubleType(), size=LEAF + 2 * STACK)
        return builder.ptrtoint(room, ir.IntType(64))

    return types.intp(), generate


@jit
def _search(points, original, boxes, slot, n_leaves, n, z, d, skip, hint):
    # scratch: one bound or distance per lane, then a stack of bounds and a stack of nodes
    room = scratch()
    original, slot = carray(_int32s(original), (1,)), carray(_int32s(slot), (1,))
    for k in range(d):
        if not np.isfinite(read(z, k)):
            return np.nan, -1
    n_nodes = (n_leaves + WIDTH - 3) // (WIDTH - 1)
    best, winner, warm, top = np.inf, np.int64(EMPTY), -1, 0
    if n_leaves > 0:
        top = _push(room, top, 0.0, 0)
    if 0 <= hint < n:
        lane = np.int64(slot[U(hint)])
        if original[U(lane)] != skip:
            best, winner = _distance(points, lane, z, d), np.int64(original[U(lane)])
        warm = n_nodes + lane // LEAF
        top = _push(room, top, 0.0, warm)
    fresh = True
    while top > 0:
        top -= 1
        if read(room, LEAF + top) > best:
            continue
        node = np.int64(read(room, LEAF + STACK + top))
        if node < n_nodes:
            child = WIDTH * node + 1
            near = bounds(boxes, node, z, d, best, room)
            n_children = n_nodes + n_leaves - child
            if n_children < WIDTH:
                near &= (U(1) << U(n_children)) - U(1)
            if child >= n_nodes:
                _fetch(points, child - n_nodes, near, d)
            if near != U(0):
                top = _push_children(room, top, near, child)
        elif node != warm or fresh:
            fresh = fresh and node != warm
            leaf = node - n_nodes
            near = distances(points, leaf, z, d, best, room)
            while near != U(0):
                j = np.int64(lowest_bit(near))
                near &= near - U(1)
                i = np.int64(original[U(leaf * LEAF + j)])
                distance = read(room, j)
                if i != skip and (distance < best or (distance == best and i < winner)):
                    best, winner = distance, i
    return best, (winner if winner != EMPTY else -1)


@inlined
def _fetch(points, first, near, d):
    """Prefetch the leaves whose bit is set, because in flight the cache is cold."""
    while near != U(0):
        leaf = first + np.int64(lowest_bit(near))
        near &= near - U(1)
        for at in range(leaf * LEAF * d, (leaf + 1) * LEAF * d, WIDTH):
            prefetch(points, at)


@inlined
def _push(room, top, bound, node):
    """Push a node; returns the new top."""
    write(room, LEAF + top, bound)
    write(room, LEAF + STACK + top, np.float64(node))
    return top + 1


@inlined
def _push_children(room, top, near, child):
    """Push the children whose bit is set, the nearest on top; returns the new top."""
    closest = top
    while near != U(0):
        j = np.int64(lowest_bit(near))
        near &= near - U(1)
        bound = read(room, j)
        closest = top if bound < read(room, LEAF + closest) else closest
        top = _push(room, top, bound, child + j)
    for at in (LEAF, LEAF + STACK):
        last = read(room, at + top - 1)
        write(room, at + top - 1, read(room, at + closest))
        write(room, at + closest, last)
    return top


@inlined
def _distance(points, lane, z, d):
    at = lane // LEAF * LEAF * d + lane % LEAF
    total = 0.0
    for k in range(d):
        e = read(z, k) - read(points, at + k * LEAF)
        total += e * e
    return total


@inlined
def distances(points, leaf, z, d, most, room):
    """Write the squared distance from z to each point of a leaf to `room`.

    Returns one bit per point: whether it is within `most`.
    """
    near = U(0)
    for first in range(0, LEAF, WIDTH):
        total = splat(0.0)
        for k in range(d):
            e = subtract(splat(read(z, k)), load(points, (leaf * d + k) * LEAF + first))
            total = add(total, multiply(e, e))
        store(room, first, total)
        near |= at_most(total, splat(most)) << U(first)
    return near


@inlined
def bounds(boxes, node, z, d, most, room):
    """Write the squared distance from z to each child's box, 0 inside, to `room`.

    Returns one bit per child: whether its box is within `most`.
    """
    low = 2 * d * WIDTH * node
    high = low + d * WIDTH
    total, zero = splat(0.0), splat(0.0)
    for k in range(d):
        x = splat(read(z, k))
        below = subtract(load(boxes, low + k * WIDTH), x)
        above = subtract(x, load(boxes, high + k * WIDTH))
        e = where_greater(below, above, below, above)
        e = where_greater(e, zero, e, zero)
        total = add(total, multiply(e, e))
    store(room, 0, total)
    return at_most(total, splat(most))
