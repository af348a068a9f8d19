from time import perf_counter
from typing import Any

import numpy as np
import pytest
from llvmlite import ir
from numba import extending, njit, types
from pykdtree.kdtree import KDTree as PyKDTree  # pyright: ignore[reportMissingTypeStubs]
from scipy.spatial import KDTree
from threadpoolctl import threadpool_limits

from core.kernels.compiled import in_chunks
from core.kernels.nearest import build, nearest
from tests.benchmarks.pairs import in_turns

# F-16, 502 ft/s at sea level (Stevens & Lewis, Example 5.3-1), rows beta, p, r.
A = np.array([[-0.322, 0.0364, -0.9917], [-30.6492, -3.6784, 0.6646], [8.5396, -0.0254, -0.4764]])
B = np.array([[0.017189, 0.045837], [-42.014995, 7.534395], [-1.827735, -3.552338]])
NY = np.array([-5.024, -0.0078, 0.1189, 0.2682, 0.7152])

pytestmark = pytest.mark.benchmark


def flights(n, rng, dt):
    """Rudder doublets of 6 s with random derivatives, Euler steps of 2.5 ms: (n, samples, 6)."""
    a = A * (1 + 0.15 * rng.standard_normal((n, 3, 3)))
    b = B * (1 + 0.2 * rng.standard_normal((n, 3, 2)))
    step, every = 0.0025, round(dt / 0.0025)
    x, u, pedal, y = np.zeros((n, 3)), np.zeros((n, 2)), 0.0, []
    for i in range(2401):
        if i % every == 0:
            xu = np.hstack([x, u])
            y.append(np.hstack([x, (xu @ NY)[:, None], u]))
        t = i * step
        wish = 0.07 * ((0.5 <= t < 1.5) - float(1.5 <= t < 2.5))
        pedal += step * 10 * (wish - pedal)
        command = np.stack([0.05 * x[:, 1], pedal + 0.3 * x[:, 2]], axis=1)
        x = x + step * (np.einsum("nij,nj->ni", a, x) + np.einsum("nij,nj->ni", b, u))
        u = u + step * 20.2 * (command - u)
    return np.stack(y, axis=1)


def observations(y, lag):
    """Present sample and two before it, `lag` samples apart: (n, samples, 18)."""
    past = [np.pad(y, ((0, 0), (s, 0), (0, 0)), "edge")[:, : y.shape[1]] for s in (2 * lag, lag)]
    return np.concatenate([*past, y], axis=2)


@pytest.fixture(scope="module")
def flown():
    """Observations of 10,000 flights at 20 Hz, and of an hour of other flights at 100 Hz."""
    rng = np.random.default_rng(0)
    return observations(flights(10_000, rng, 0.05), 1), observations(flights(600, rng, 0.01), 5)


def sampled(o, n, d):
    """Random samples, 50 of each flight (100 if there are too few); d = 6 keeps the present."""
    rng = np.random.default_rng(1)
    each = 50 if n <= 50 * len(o) else 100
    pick = np.stack([np.sort(rng.permutation(o.shape[1])[:each]) for _ in range(n // each)])
    return np.ascontiguousarray(o[np.arange(len(pick))[:, None], pick, -d:].reshape(-1, d))


@njit(nogil=True)
def stream(tree, z, d2, index):
    hint = -1
    for i in range(len(z)):
        d2[i], hint = nearest(tree, z[i], -1, hint)
        index[i] = hint


intrinsic: Any = extending.intrinsic  # its functions lose the context when called


@intrinsic
def cycles(_context):
    """Cycles of the processor so far."""

    def generate(_generator, builder, _signature, _arguments):
        counter = ir.FunctionType(ir.IntType(64), [])
        function = builder.module.declare_intrinsic("llvm.readcyclecounter", (), counter)
        return builder.call(function, [])

    return types.int64(), generate


@njit(nogil=True)
def clocked_stream(tree, z, taken):
    hint = -1
    for i in range(len(z)):
        begin = cycles()
        hint = nearest(tree, z[i], -1, hint)[1]
        taken[i] = cycles() - begin


def search(tree, z):
    """Squared distances and neighbours of all samples, on one thread."""
    d2, index = np.empty(len(z)), np.empty(len(z), np.int64)
    stream(tree, z, d2, index)
    return d2, index


def search_on_threads(tree, z):
    """`search` on all threads; the hint starts again in each part."""
    d2, index = np.empty(len(z)), np.empty(len(z), np.int64)
    in_chunks(len(z), 4_096, lambda a, b: stream(tree, z[a:b], d2[a:b], index[a:b]))
    return d2, index


def each_search(tree, z):
    """ns of each search of a stream: median, 99 %."""
    taken = np.empty(len(z), np.int64)
    begin = perf_counter()
    clocked_stream(tree, z, taken)
    whole = perf_counter() - begin
    return np.percentile(taken * (whole * 1e9 / taken.sum()), [50, 99])


@pytest.mark.parametrize(
    ("n", "d"),
    [(50, 6), (5_000, 6), (14_600, 6), (500_000, 6), (1_000_000, 6), (5_000, 18), (500_000, 18)],
)
def test_nearest_against_public_trees_on_an_hour_of_flight(flown, n, d):
    """The peers get the distinct points only, as our tree stores them."""
    points = np.unique(sampled(flown[0], n, d), axis=0)
    z = np.ascontiguousarray(flown[1][..., -d:].reshape(-1, d))
    tree, scipy_tree, py_tree = build(points), KDTree(points), PyKDTree(points)
    d2, _ = search(tree, z)
    np.testing.assert_array_equal(search_on_threads(tree, z)[0], d2)
    part = z[: len(z) if n < 100_000 else 30_050]
    expected = scipy_tree.query(part)[0]
    np.testing.assert_allclose(np.sqrt(d2[: len(part)]), expected, rtol=1e-12, atol=1e-15)
    clocked_stream(tree, z[:1], np.empty(1, np.int64))
    untouched, few = build(points), z[:12_000]
    at_first, again = each_search(untouched, few), each_search(untouched, few)
    one = in_turns(lambda: search(tree, part), lambda: scipy_tree.query(part))
    two = in_turns(lambda: search_on_threads(tree, part), lambda: scipy_tree.query(part, workers=2))
    with threadpool_limits(1):
        py = in_turns(lambda: search(tree, part), lambda: py_tree.query(part))
    print(
        f"\n{len(points):>9,} distinct points, d {d:>2}: {one.ours.min() / len(part) * 1e9:5.0f} ns"
        f" a sample in a stream (median {again[0]:.0f}, 99 % {again[1]:.0f} of the second pass,"
        f" {at_first[0]:.0f} and {at_first[1]:.0f} of the first);\n"
        f"  one thread: KDTree {one}, pykdtree {py}; on two: KDTree {two}"
    )


def test_build_against_public_trees(flown):
    points = np.unique(sampled(flown[0], 1_000_000, 6), axis=0)
    scipy_pair = in_turns(lambda: build(points), lambda: KDTree(points))
    with threadpool_limits(1):
        py_pair = in_turns(lambda: build(points), lambda: PyKDTree(points))
    tree = build(points)
    size = sum(a.nbytes for a in tree) / points.nbytes
    print(
        f"\nbuild of {len(points):,} points: {scipy_pair.ours.min():.2f} s; KDTree {scipy_pair};"
        f" pykdtree {py_pair}; {size:.2f} times the memory of the points"
    )
    np.testing.assert_array_equal(search(tree, points[:1000])[0], 0.0)
