from time import perf_counter

import numpy as np
import pytest
from numba import njit
from scipy.spatial import KDTree

from core.kernels.nearest import build, nearest, nearest_batch

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


@njit(nogil=True)
def repeat(tree, z, hint, times):
    total = 0.0
    for _ in range(times):
        total += nearest(tree, z, -1, hint)[0]
    return total


def shortest(task, times=5):
    taken = []
    for _ in range(times):
        begin = perf_counter()
        task()
        taken.append(perf_counter() - begin)
    return min(taken)


def each_query(tree, z, index, n=3_000):
    """ns of single queries, the hint being the winner before: median, 99 %."""
    pick = np.random.default_rng(2).integers(1, len(z), n)
    taken = [shortest(lambda i=i: repeat(tree, z[i], index[i - 1], 10), 3) / 10 for i in pick]
    return np.percentile(np.array(taken) * 1e9, [50, 99])


@pytest.mark.parametrize(
    ("n", "d"),
    [(50, 6), (5_000, 6), (14_600, 6), (500_000, 6), (1_000_000, 6), (5_000, 18), (500_000, 18)],
)
def test_nearest_against_scipy_on_an_hour_of_flight(flown, n, d):
    points, z = sampled(flown[0], n, d), np.ascontiguousarray(flown[1][..., -d:].reshape(-1, d))
    tree, peer = build(points), KDTree(points)
    d2, index = np.empty(len(z)), np.empty(len(z), np.int64)
    stream(tree, z[:2], d2, index)
    one = shortest(lambda: stream(tree, z, d2, index))
    two = shortest(lambda: nearest_batch(tree, z))
    some = slice(0, len(z), 1) if n < 100_000 else slice(0, 30_050, 1)
    share = len(z[some]) / len(z)
    their_one = shortest(lambda: peer.query(z[some]), 2) / share
    their_two = shortest(lambda: peer.query(z[some], workers=2), 2) / share
    median, high = each_query(tree, z, index)
    print(
        f"\n{n:>9,} points, d {d:>2}: {one / len(z) * 1e9:5.0f} ns a sample in a stream"
        f" (single: median {median:.0f}, 99 % {high:.0f});"
        f" hour on one thread {one:.3f} s (KDTree x{their_one / one:.1f}),"
        f" on all {two:.3f} s (KDTree x{their_one / two:.1f}, workers=2 x{their_two / two:.1f})"
    )
    np.testing.assert_allclose(np.sqrt(d2[some]), peer.query(z[some])[0], rtol=1e-12, atol=1e-15)
    np.testing.assert_array_equal(nearest_batch(tree, z)[1], index)


def test_build_against_scipy(flown):
    points = sampled(flown[0], 1_000_000, 6)
    build(points[:10])
    ours = shortest(lambda: build(points), 3)
    theirs = shortest(lambda: KDTree(points), 3)
    tree = build(points)
    size = sum(a.nbytes for a in tree) / points.nbytes
    print(
        f"\nbuild of {len(points):,} points: {ours:.2f} s (KDTree {theirs:.2f} s);"
        f" {size:.2f} times the memory of the points"
    )
    np.testing.assert_array_equal(nearest_batch(tree, points[:1000])[0], 0.0)
