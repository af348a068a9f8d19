"""Conformal p-values of single scores, compiled: the simple one and the exact one.

A point z added to the unsafe points lowers the score of a failure's sample only if it is nearer
than the sample's nearest unsafe point: only samples whose ball contains z count. The samples are in
boxes as in `core.kernels.nearest`, with the largest ball of each box.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from core.kernels.compiled import inlined, jit
from core.kernels.lanes import address, read, write
from core.kernels.nearest import EMPTY, LEAF, WIDTH, U, bounds, distances, pack_rows, scratch
from core.types import Array, Indices


class CalibrationTree(NamedTuple):
    """Samples of the failures' histories, packed for `n_lowered`.

    points: leaf by leaf, (d, LEAF) each.   boxes: node by node, (2, d, WIDTH) each; see `Tree`.
    failure: (LEAF * n_leaves,) failure of the sample in each lane.
    safe, level: (LEAF * n_leaves,) weighted squared distance to the nearest safe point, and the
    calibration score of the failure; -inf in unused lanes.
    node_unsafe, node_safe, node_level: (WIDTH * n_nodes,) largest weighted squared distances, and
    largest calibration score, in each child of each node.
    levels: (n_failures,) sorted calibration scores.
    """

    points: Array
    boxes: Array
    failure: npt.NDArray[np.int32]
    safe: Array
    level: Array
    node_unsafe: Array
    node_safe: Array
    node_level: Array
    levels: Array


NOTHING = CalibrationTree(
    *(np.empty(0), np.empty(0), np.empty(0, np.int32)), *(np.empty(0) for _ in range(6))
)


def build_calibration_tree(
    points: Array, unsafe: Array, safe: Array, start: Indices, alphas: Array
) -> CalibrationTree:
    """Pack the samples of the failures' histories.

    points: (n, d) finite.   unsafe, safe: (n,) weighted squared distances, without own failure.
    start: (n_failures + 1,) failure i has rows start[i]:start[i+1].   alphas: (n_failures,).
    """
    owner = np.repeat(np.arange(len(alphas)), np.diff(start))
    score = alphas.copy()
    np.fmin.at(score, owner, unsafe - safe)
    packed, original, boxes, _ = pack_rows(
        np.ascontiguousarray(points), np.arange(len(points), dtype=np.int32)
    )
    used = original != EMPTY
    row = np.where(used, original, 0)
    lanes = (np.where(used, lane[row], -np.inf) for lane in (unsafe, safe, score[owner]))
    unsafe_lane, safe_lane, level = lanes
    return CalibrationTree(
        packed,
        boxes,
        owner[row].astype(np.int32),
        safe_lane,
        level,
        *(_largest_of_children(lane) for lane in (unsafe_lane, safe_lane, level)),
        levels=np.sort(score),
    )


def _largest_of_children(lanes: Array) -> Array:
    """(WIDTH * n_nodes,) largest value in each child of each node; -inf for none."""
    of_leaves = lanes.reshape(-1, LEAF).max(axis=1)
    n_nodes = (len(of_leaves) + WIDTH - 3) // (WIDTH - 1)
    largest = np.full(max(WIDTH * n_nodes + 1, n_nodes + len(of_leaves)), -np.inf)
    largest[n_nodes : n_nodes + len(of_leaves)] = of_leaves
    for node in range(n_nodes - 1, -1, -1):
        largest[node] = largest[WIDTH * node + 1 : WIDTH * node + 1 + WIDTH].max()
    return largest[1 : WIDTH * n_nodes + 1]


@inlined
def n_staying(tree, weight, z, s):
    """Number of failures whose calibration score stays at least s with z among the unsafe points.

    weight: of squared distances to unsafe points.   z: (d,).
    """
    active = tree.levels.shape[0]
    if not np.isnan(s):
        active -= np.searchsorted(tree.levels, s)
    return active - (_n_lowered(tree, weight, z, s) if active > 0 else 0)


@jit
def _n_lowered(tree, weight, z, s):
    n_leaves = tree.failure.shape[0] // LEAF
    n_nodes = tree.node_level.shape[0] // WIDTH
    room, d = scratch(), z.shape[0]
    points, boxes, z = address(tree.points), address(tree.boxes), address(z)
    is_lowered = np.zeros(0, np.bool_)
    lowered, top = 0, 0
    if n_leaves > 0:
        write(room, LEAF, 0.0)
        top = 1
    while top > 0:
        top -= 1
        node = np.int64(read(room, LEAF + top))
        if node < n_nodes:
            bounds(boxes, node, z, d, np.inf, room)
            for j in range(WIDTH):
                child = U(node * WIDTH + j)
                away = weight * read(room, j)
                lowers = away < tree.node_unsafe[child] and away - tree.node_safe[child] < s
                if lowers and tree.node_level[child] >= s:
                    write(room, LEAF + top, np.float64(WIDTH * node + 1 + j))
                    top += 1
        else:
            first = (node - n_nodes) * LEAF
            distances(points, node - n_nodes, z, d, np.inf, room)
            hits = 0
            for j in range(LEAF):
                lane = U(first + j)
                hits |= (weight * read(room, j) - tree.safe[lane] < s) & (tree.level[lane] >= s)
            if hits:
                if is_lowered.shape[0] == 0:
                    is_lowered = np.zeros(tree.levels.shape[0], np.bool_)
                for j in range(LEAF):
                    lane = U(first + j)
                    if weight * read(room, j) - tree.safe[lane] < s and tree.level[lane] >= s:
                        failure = tree.failure[lane]
                        lowered += not is_lowered[failure]
                        is_lowered[failure] = True
    return lowered


class Transduction(NamedTuple):
    """Arrays of the exact p-value, which recalibrates with the test point among the unsafe points.

    points: (n, d) mapped samples of the failures' histories; failure i has start[i]:start[i+1].
    unsafe, safe: (n,) their weighted squared distances, without own failure.
    alphas: (n_failures,) in the order of `start`.
    always: failures too early for a warning.   running: score a flight by its lowest so far.
    tree: search tree of the samples, see `indexed`.
    Empty arrays select the simple p-value (SIMPLE).
    """

    points: Array
    unsafe: Array
    safe: Array
    start: Indices
    alphas: Array
    always: int
    running: bool
    tree: CalibrationTree = NOTHING

    def indexed(self) -> "Transduction":
        """Copy with the search tree, which p-values need."""
        tree = build_calibration_tree(self.points, self.unsafe, self.safe, self.start, self.alphas)
        return self._replace(tree=tree)


SIMPLE = Transduction(
    np.empty((0, 1)), np.empty(0), np.empty(0), np.empty(0, np.int64), np.empty(0), 0, False
)


@inlined
def _simple_p(alphas, s):
    n = alphas.shape[0]
    if np.isnan(s):
        return np.nan
    return (n - np.searchsorted(alphas, s) + 1) / (n + 1)


@jit
def simple_p(alphas, s):
    """Simple p-value of a score; NaN for none."""
    return _simple_p(alphas, s)


@inlined
def _exact_p(fitted, exact, z, s):
    """p-value with z added to the unsafe points; never above the simple one at the same s."""
    staying = n_staying(exact.tree, fitted.unsafe_weight, z, s)
    return (exact.always + staying + 1) / (fitted.alphas.shape[0] + 1)


@inlined
def p_value_of(fitted, exact, z, s, lowest):
    """p-value of point z with score s; NaN for none.

    fitted: has `alphas` and `unsafe_weight`.
    lowest: the flight's lowest score so far, this one included.
    """
    if exact.start.shape[0] == 0:
        return _simple_p(fitted.alphas, s)
    return _exact_p(fitted, exact, z, lowest if exact.running else s)
