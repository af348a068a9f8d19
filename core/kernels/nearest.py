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

from core.kernels.compiled import inlined, jit
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
from core.kernels.tree_build import EMPTY, LEAF, WIDTH, pack
from core.types import Array

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
