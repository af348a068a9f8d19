"""Exact nearest neighbour among many points, fast enough for every sample of a live flight.

The tree is an 8-way heap of bounding boxes over leaves of 32 points, both stored lane by lane so
that one instruction serves eight children or points. It is exact to the last bit: rounding is
monotone, so a box's bound, summed in the order of a distance, never exceeds a distance inside.
"""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import extending, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.np.numpy_support import carray

from core.kernels.compiled import inlined, jit
from core.kernels.tree_build import EMPTY, LEAF, WIDTH, pack
from core.types import Array

BLOCK = 6  # coordinates summed in registers at a time: one observation's channels
STACK = 128  # 7 siblings wait at each level, and 9 levels hold 2^31 points
MOST = 2**30  # points, so that 32-bit lanes suffice

# Kernels call what follows without the typing context that its Python signature starts with.
intrinsic: Any = extending.intrinsic

# Signed indices may be negative and then count from the end, which no compiler can vectorise.
U = np.uint64


class Tree(NamedTuple):
    """Points packed for `nearest`; what `build` returns. Distances are between the d columns.

    points: leaf by leaf, (d, LEAF) each, unused lanes at infinity.
    original: (LEAF * n_leaves,) original index of each lane, EMPTY where unused.
    boxes: node by node, (2, d, WIDTH) each: lowest and highest corner of every child. Children of
        node k are nodes 8k+1 .. 8k+8; numbers past the last node are leaves.
    slot: (n,) lane of each original point, or of the first point equal to it.
    """

    points: Array
    original: npt.NDArray[np.int32]
    boxes: Array
    slot: npt.NDArray[np.int32]


def build(points: Array) -> Tree:
    """Pack points, O(n log n). Equal points to the third and further are not stored.

    points: (n, d) finite, n >= 0, d >= 1.   ValueError on anything else.
    """
    points = np.ascontiguousarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] == 0 or len(points) > MOST:
        raise ValueError(
            f"points have shape {points.shape}: a tree needs (n, d), d >= 1, n <= {MOST}"
        )
    if not np.isfinite(points).all():
        row = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise ValueError(f"point {row} is {points[row]}: a tree needs finite points; leave it out")
    return Tree(*pack(points))


@inlined
def locate(tree):
    """Where a tree's arrays lie; taken once before a loop, it saves counting references in it."""
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
    """Squared distance to, and original index of, the nearest point; equal distances: the lowest.

    place: of a tree that outlives the call, see `locate`.   z: (d,) C-contiguous float64.
    skip: original index of a point left out, -1 for none.
    hint: original index of a point likely to be near, -1 for none; it never changes the answer.
    The distance is bit for bit min_i sum_k (z_k - x_ik)^2 summed in the order k = 0 .. d-1.
    (+inf, -1) where no point is left; (nan, -1) where z is not finite.
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
        np.int64(skip),  # literal numbers would compile the search once more for each
        np.int64(hint),
    )


@inlined
def squared_distance_at(place, z, i):
    """Squared distance from z to original point i, 0 <= i < n: the bits `nearest_at` gives."""
    return _squared_distance(place[0], place[3], address(z), z.shape[0], np.int64(i))


@jit
def _squared_distance(points, slot, z, d, i):
    lane = np.int64(carray(slot, (1,))[U(i)])
    return _distance(carray(points, (1,)), lane, carray(z, (1,)), d)


@intrinsic
def address(_context, array):
    """Where an array's numbers lie. Counting references to five arrays costs more than a search."""
    if array.layout != "C":
        raise TypingError("nearest needs C-contiguous arrays: pass np.ascontiguousarray(z)")

    def generate(context, builder, _signature, arguments):
        return context.make_array(array)(context, builder, arguments[0]).data

    return types.CPointer(array.dtype)(array), generate


@intrinsic
def scratch(_context):
    """LEAF + 2 * STACK floats on the machine's stack: nothing to allocate, nothing aliases it."""

    def generate(_generator, builder, _signature, _arguments):
        return cgutils.alloca_once(builder, ir.DoubleType(), size=LEAF + 2 * STACK)

    return types.CPointer(types.float64)(), generate


@jit
def _search(points, original, boxes, slot, n_leaves, n, z, d, skip, hint):
    # A bound or distance a lane; then a stack of (bound, node), each family's nearest on top.
    total = carray(scratch(), (1,))
    points, original = carray(points, (1,)), carray(original, (1,))
    boxes, slot, z = carray(boxes, (1,)), carray(slot, (1,)), carray(z, (1,))
    for k in range(d):
        if not np.isfinite(z[k]):
            return np.nan, -1
    n_nodes = (n_leaves + WIDTH - 3) // (WIDTH - 1)
    best, winner, warm, top = np.inf, np.int64(EMPTY), -1, 0
    if n_leaves > 0:
        top = _push(total, top, top, 0.0, 0)
    if 0 <= hint < n:
        lane = np.int64(slot[U(hint)])
        if original[U(lane)] != skip:
            best, winner = _distance(points, lane, z, d), np.int64(original[U(lane)])
        warm = n_nodes + lane // LEAF
        top = _push(total, top, top, 0.0, warm)
    fresh = True
    while top > 0:
        top -= 1
        if total[U(LEAF + top)] > best:
            continue
        node = np.int64(total[U(LEAF + STACK + top)])
        if node < n_nodes:
            bounds(boxes, node, z, d, total)
            child, base = WIDTH * node + 1, top
            for j in range(min(WIDTH, n_nodes + n_leaves - child)):
                if total[j] <= best:
                    top = _push(total, base, top, total[j], child + j)
        elif node != warm or fresh:
            fresh = fresh and node != warm
            leaf = node - n_nodes
            distances(points, leaf, z, d, total)
            hits = 0
            for j in range(LEAF):
                hits |= total[j] <= best
            if hits:
                for j in range(LEAF):
                    if total[j] <= best:
                        i = np.int64(original[U(leaf * LEAF + j)])
                        if i != skip and (total[j] < best or i < winner):
                            best, winner = total[j], i
    return best, (winner if winner != EMPTY else -1)


@inlined
def _push(total, base, top, bound, node):
    """Put a node on the stack, above those after `base` that are farther; returns the new top."""
    at = U(LEAF + top)
    while at > U(LEAF + base) and total[at - U(1)] < bound:
        total[at] = total[at - U(1)]
        total[at + U(STACK)] = total[at + U(STACK - 1)]
        at -= U(1)
    total[at] = bound
    total[at + U(STACK)] = node
    return top + 1


@inlined
def _distance(points, lane, z, d):
    at = U(lane // LEAF * LEAF * d + lane % LEAF)
    total = 0.0
    for k in range(U(d)):
        e = z[k] - points[at + k * U(LEAF)]
        total += e * e
    return total


@inlined
def distances(points, leaf, z, d, total):
    """Squared distance from z to each point of a leaf."""
    at, blocks_end = U(leaf * LEAF * d), U(d - d % BLOCK)
    _clear(total, LEAF)
    for k in range(U(0), blocks_end, U(BLOCK)):
        _add_squares(points, at + k * U(LEAF), z, k, BLOCK, total)
    for k in range(blocks_end, U(d)):
        _add_squares(points, at + k * U(LEAF), z, k, 1, total)


@inlined
def bounds(boxes, node, z, d, total):
    """Squared distance from z to each child's box: 0 inside."""
    at, blocks_end = U(node * 2 * WIDTH * d), U(d - d % BLOCK)
    _clear(total, WIDTH)
    for k in range(U(0), blocks_end, U(BLOCK)):
        _add_gaps(boxes, at + k * U(WIDTH), U(WIDTH * d), z, k, BLOCK, total)
    for k in range(blocks_end, U(d)):
        _add_gaps(boxes, at + k * U(WIDTH), U(WIDTH * d), z, k, 1, total)


@inlined
def _clear(total, n):
    for j in range(n):
        total[j] = 0.0


@inlined
def _add_squares(points, at, z, first, n, total):
    for j in range(U(LEAF)):
        s = total[j]
        for k in range(U(n)):
            e = z[first + k] - points[at + k * U(LEAF) + j]
            s += e * e
        total[j] = s


@inlined
def _add_gaps(boxes, low, side, z, first, n, total):
    for j in range(U(WIDTH)):
        s = total[j]
        for k in range(U(n)):
            below = boxes[low + k * U(WIDTH) + j] - z[first + k]
            above = z[first + k] - boxes[low + side + k * U(WIDTH) + j]
            e = below if below > above else above
            e = e if e > 0.0 else 0.0
            s += e * e
        total[j] = s
