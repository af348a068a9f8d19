"""One sample of a stream by a call from Python, with its arrays in one table of addresses.

Unpacking the nested tuples of a monitor in each call would take longer than the computation.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.np.numpy_support import carray

from core.kernels import peak_ridge
from core.kernels.assessing import OK, Fitted, update
from core.kernels.compiled import brief, inlined
from core.kernels.deviation import Deviation, Innovation, Reference, update_deviation
from core.kernels.lanes import pointer_to
from core.kernels.nearest import Tree
from core.kernels.p_value import CalibrationTree, Transduction, simple_p
from core.kernels.peak_ridge import LOST, PeakHistory, PeakWeights
from core.types import Array, Indices


class LiveCall(NamedTuple):
    """Arguments of a kernel except the sample; for `update_at`:

    table: (29, 2) address and length of each array.
    counts: (5,) columns of the calibration's points, entries of a point, channel, failures too
    early for a warning, whether flights are scored by their lowest score so far.
    numbers: (3,) weights of the unsafe and of the safe distance, sample interval [s].
    """

    table: Indices
    counts: Indices
    numbers: Array


def live_call(
    fitted: Fitted,
    exact: Transduction,
    buffer: Array,
    status: Indices,
    clock: Array,
    point: Array,
    dt: float,
) -> LiveCall:
    """Lay out the arguments of `assessing.update`. The arrays must outlive it.

    ValueError for an array that is not C-contiguous.
    """
    arrays = (
        *(fitted.matrix, fitted.offset, *fitted.unsafe, *fitted.safe, fitted.alphas),
        *(exact.points, exact.unsafe, exact.safe, exact.start, exact.alphas, *exact.tree),
        *(buffer, status, clock, point),
    )
    return LiveCall(
        _table_of(arrays),
        np.array(
            [exact.points.shape[1], fitted.d, fitted.channel, exact.always, int(exact.running)]
        ),
        np.array([fitted.unsafe_weight, fitted.safe_weight, dt]),
    )


def deviation_call(reference: Reference, deviation: Deviation, history: Array) -> LiveCall:
    """Lay out the arguments of `update_deviation`: table (18, 2), counts (7,), numbers (1,).

    The arrays must outlive it.   ValueError for an array that is not C-contiguous.
    """
    innovation = reference.innovation
    arrays = (
        *(reference.matrix, reference.offset, *reference.safe, reference.scale, reference.sigma),
        *(innovation.matrix, innovation.offset, innovation.sigma, *deviation, history),
    )
    counts = (
        *(reference.d, reference.h, reference.n_delay, int(reference.has_residuals)),
        *(innovation.n_past, innovation.spacing, innovation.window),
    )
    return LiveCall(_table_of(arrays), np.array(counts), np.array([reference.dt]))


def peaks_call(
    parts: Sequence[tuple[PeakWeights, PeakHistory, Array]], near_alphas: Array, dt: float
) -> LiveCall:
    """Lay out the arguments of `peaks_at`: table (1 + 7 n_parts, 2), counts (5 n_parts,).

    parts: weights, memory of the flight and sorted calibration scores of each part.
    near_alphas: (n,) sorted calibration scores of the neighbours.
    numbers: (1 + 2 n_parts,) sample interval [s]; threshold and rest of each part.
    The arrays must outlive it.   ValueError for an array that is not C-contiguous.
    """
    arrays, counts, numbers = [near_alphas], [], [dt]
    for peaks, history, alphas in parts:
        arrays += [peaks.weights, peaks.offset, *history, alphas]
        counts += [peaks.weights.shape[1], peaks.every, peaks.stride, peaks.surface]
        counts += [int(peaks.mirrored)]
        numbers += [peaks.threshold, peaks.rest]
    return LiveCall(_table_of(tuple(arrays)), np.array(counts), np.array(numbers))


def _table_of(arrays: tuple[Any, ...]) -> Indices:
    if not all(array.flags.c_contiguous for array in arrays):
        raise ValueError("an array of the monitor is not C-contiguous: use np.ascontiguousarray")
    return np.array([(array.ctypes.data, len(array)) for array in arrays])


@brief
def deviation_at(table, counts, numbers, y, t, code, distance):
    """`update_deviation` with the arrays in the table."""
    n_channels = y.shape[0]
    reference = Reference(
        carray(_floats(table[0, 0]), (table[0, 1], table[1, 1])),
        _numbers(table, 1),
        Tree(_numbers(table, 2), _lanes(table, 3), _numbers(table, 4), _lanes(table, 5)),
        _numbers(table, 6),
        _numbers(table, 7),
        counts[0],
        counts[1],
        counts[2],
        numbers[0],
        counts[3] != 0,
        Innovation(
            carray(_floats(table[8, 0]), (table[8, 1], table[9, 1])),
            _numbers(table, 9),
            _numbers(table, 10),
            counts[4],
            counts[5],
            counts[6],
        ),
    )
    deviation = Deviation(
        carray(_floats(table[11, 0]), (table[11, 1], n_channels + 2)),
        _whole(table, 12),
        _numbers(table, 13),
        carray(_floats(table[14, 0]), (table[14, 1], counts[0])),
        carray(_floats(table[15, 0]), (table[15, 1], table[9, 1])),
        _numbers(table, 16),
    )
    history = carray(_floats(table[17, 0]), (table[17, 1], n_channels))
    return update_deviation(reference, deviation, history, y, t, code, distance)


@brief
def peaks_at(table, counts, numbers, t, y, code, near):
    """Scores of the peaks to come, see `peak_ridge.update`, with the arrays in the table.

    code: state before.   near: score by the neighbours.
    Returns the first part's score and state, whether it is lost, and the highest p-value of the
    neighbours and of the parts that have a score; NaN unless the state before is OK.
    """
    risk = simple_p(_numbers(table, 0), near) if code == OK else np.nan
    first, first_code, lost = np.nan, code, False
    for k in range(counts.shape[0] // 5):
        row, n_past = 1 + 7 * k, counts[5 * k]
        peaks = PeakWeights(
            carray(_floats(table[row, 0]), (table[row, 1], n_past, y.shape[0])),
            _numbers(table, row + 1),
            counts[5 * k + 1],
            counts[5 * k + 2],
            counts[5 * k + 3],
            numbers[1 + 2 * k],
            numbers[2 + 2 * k],
            counts[5 * k + 4] != 0,
        )
        history = PeakHistory(
            carray(_floats(table[row + 2, 0]), (table[row + 2, 1], y.shape[0])),
            _whole(table, row + 3),
            _whole(table, row + 4),
            _numbers(table, row + 5),
        )
        s, state = peak_ridge.update(peaks, history, numbers[0], t, y, code)
        if not np.isnan(s):
            risk = max(risk, simple_p(_numbers(table, row + 6), s))
        if k == 0:
            first, first_code, lost = s, state, history.counts[LOST] != 0
    return first, first_code, lost, risk


@brief
def update_at(table, counts, numbers, t, y):
    """`assessing.update` with the arrays in the table."""
    width = table[1, 1]
    fitted = Fitted(
        carray(_floats(table[0, 0]), (table[0, 1], width)),
        _numbers(table, 1),
        counts[1],
        Tree(_numbers(table, 2), _lanes(table, 3), _numbers(table, 4), _lanes(table, 5)),
        Tree(_numbers(table, 6), _lanes(table, 7), _numbers(table, 8), _lanes(table, 9)),
        numbers[0],
        numbers[1],
        counts[2],
        _numbers(table, 10),
    )
    exact = Transduction(
        carray(_floats(table[11, 0]), (table[11, 1], counts[0])),
        _numbers(table, 12),
        _numbers(table, 13),
        _whole(table, 14),
        _numbers(table, 15),
        counts[3],
        counts[4] != 0,
        CalibrationTree(
            _numbers(table, 16),
            _numbers(table, 17),
            _lanes(table, 18),
            _numbers(table, 19),
            _numbers(table, 20),
            _numbers(table, 21),
            _numbers(table, 22),
            _numbers(table, 23),
            _numbers(table, 24),
        ),
    )
    buffer = carray(_floats(table[25, 0]), (table[25, 1], y.shape[0]))
    status, clock, point = _whole(table, 26), _numbers(table, 27), _numbers(table, 28)
    return update(fitted, exact, buffer, status, clock, numbers[2], t, y, point)


@inlined
def _numbers(table, k):
    return carray(_floats(table[k, 0]), (table[k, 1],))


@inlined
def _whole(table, k):
    return carray(_int64s(table[k, 0]), (table[k, 1],))


@inlined
def _lanes(table, k):
    return carray(_int32s(table[k, 0]), (table[k, 1],))


_floats, _int64s, _int32s = map(pointer_to, (types.float64, types.int64, types.int32))
