import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.errors import TypingError

from core.kernels import nearest as kernel
from core.kernels.compiled import jit
from core.kernels.nearest import (
    LEAF,
    _select,
    build,
    locate,
    nearest,
    squared_distance_at,
)
from tests.support.repetition import examples


@jit
def distance(tree, z, i):
    return squared_distance_at(locate(tree), z, i)


def brute_force(points, z, skip=-1):
    total = np.zeros(len(points))
    with np.errstate(over="ignore"):
        for k in range(points.shape[1]):
            e = z[k] - points[:, k]
            total += e * e
    left = np.flatnonzero(np.arange(len(points)) != skip)
    if len(left) == 0:
        return np.inf, -1
    i = left[np.argmin(total[left])]
    return total[i], i


def assert_exact(points, z, skip=-1, hint=-1):
    assert nearest(build(points), z, skip, hint) == brute_force(points, z, skip)


@st.composite
def clouds(draw):
    """Points and queries: grids full of ties, curves, or scattered over sixteen decades."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    n, d = draw(st.integers(1, 700)), draw(st.integers(1, 20))
    kind = draw(st.sampled_from(["grid", "curves", "decades"]))
    if kind == "grid":
        points = rng.integers(-2, 3, (n, d)).astype(float)
        z = rng.integers(-4, 5, (20, d)) / 2
    elif kind == "curves":
        t, phase = rng.uniform(0, 6, (n + 20, 1)), rng.uniform(0, 6, d)
        both = np.sin(t + phase) + 1e-3 * rng.standard_normal((n + 20, d))
        points, z = both[:n], both[n:]
    else:
        scale, offset = 10.0 ** rng.uniform(-8, 8, (2, d))
        both = offset + scale * rng.standard_normal((n + 20, d))
        points, z = both[:n], both[n:]
    if draw(st.booleans()):
        points = points[rng.integers(0, n, n)]
    if draw(st.booleans()):
        z[:10] = points[rng.integers(0, n, 10)]
    return np.ascontiguousarray(points), np.ascontiguousarray(z), rng


def flown(tree, z):
    """Neighbours of one sample after the other, each hinted by the last."""
    neighbours, hint = [], -1
    for row in z:
        neighbours.append(nearest(tree, row, -1, hint))
        hint = neighbours[-1][1]
    return neighbours


@settings(deadline=None, max_examples=examples(300))
@given(clouds())
def test_nearest_is_the_brute_force_minimum_bit_for_bit_whatever_is_skipped_or_hinted(cloud):
    points, z, rng = cloud
    n, tree = len(points), build(points)
    for row in z:
        skip, hint = rng.integers(-1, n, 2)
        closest = brute_force(points, row)
        assert nearest(tree, row, -1, -1) == closest
        assert nearest(tree, row, -1, hint) == closest
        for left_out in (skip, closest[1]):
            assert nearest(tree, row, left_out, hint) == brute_force(points, row, left_out)
        assert nearest(tree, row, skip, skip) == brute_force(points, row, skip)


@settings(deadline=None, max_examples=examples(50))
@given(clouds())
def test_a_flight_hinted_by_each_last_neighbour_gives_what_single_queries_give(cloud):
    points, z, _ = cloud
    tree = build(points)
    assert flown(tree, z) == [nearest(tree, row, -1, -1) for row in z]


@settings(deadline=None, max_examples=examples(50))
@given(clouds())
def test_squared_distance_is_the_sum_in_order_of_the_coordinates(cloud):
    points, z, rng = cloud
    tree = build(points)
    for row in z:
        i = int(rng.integers(len(points)))
        assert distance(tree, row, i) == brute_force(points[i : i + 1], row)[0]


def test_many_points_agree_with_brute_force():
    rng = np.random.default_rng(2)
    points = np.sin(rng.uniform(0, 6, (100_000, 1)) + rng.uniform(0, 6, 6)) + 0.01 * (
        rng.standard_normal((100_000, 6))
    )
    tree = build(points)
    for z in points[::5_000] + 0.003:
        assert nearest(tree, z, -1, 7) == brute_force(points, z)


def test_each_copy_of_a_point_finds_the_lowest_other_copy():
    points = np.zeros((5, 3))
    tree = build(points)
    assert [nearest(tree, points[i], i, i) for i in range(5)] == [(0.0, 1)] + [(0.0, 0)] * 4


@pytest.mark.parametrize("n", [1, 2, 31, 32, 33, 64, 65, 256, 257, 2_049, 2_081])
def test_every_point_finds_itself_at_the_edges_of_leaves_and_levels(n):
    points = np.random.default_rng(n).uniform(size=(n, 2))
    d2, index = zip(*flown(build(points), points), strict=True)
    np.testing.assert_array_equal(d2, 0.0)
    np.testing.assert_array_equal(index, np.arange(n))


def test_constant_columns_and_signed_zeros_are_no_obstacle():
    points = np.zeros((500, 6))
    points[:, 2] = np.arange(500) % 83
    points[100:200, 0] = -0.0
    for z in (points[150] + 0.5, points[3], -points[400]):
        assert_exact(points, z)
        assert_exact(points, z, skip=150, hint=499)


def test_a_distance_too_large_for_a_float_is_infinite_and_still_has_an_index():
    points = np.full((100, 2), 1e200)
    points[:, 1] = np.arange(100)
    assert_exact(points, np.array([-1e200, 0.0]))
    assert_exact(points, np.array([-1e200, 0.0]), skip=0, hint=99)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("n", [0, 1, 400])
def test_a_sample_that_is_not_finite_never_gets_a_distance(bad, n):
    tree = build(np.arange(n * 6.0).reshape(n, 6))
    for k in range(6):
        z = np.zeros(6)
        z[k] = bad
        d2, index = nearest(tree, z, -1, 0)
        assert np.isnan(d2)
        assert index == -1


def test_after_a_bad_sample_a_flight_goes_on():
    points = np.arange(600.0).reshape(100, 6)
    z = np.array([points[3], points[4] * np.nan, points[5]])
    d2, index = zip(*flown(build(points), z), strict=True)
    np.testing.assert_array_equal(d2, [0.0, np.nan, 0.0])
    np.testing.assert_array_equal(index, [3, -1, 5])


def test_no_point_is_infinitely_far():
    z = np.zeros(6)
    assert nearest(build(np.empty((0, 6))), z, -1, -1) == (np.inf, -1)
    assert nearest(build(np.empty((0, 6))), z, 0, 0) == (np.inf, -1)
    assert nearest(build(np.zeros((1, 6))), z, 0, 0) == (np.inf, -1)


def test_a_hint_that_is_no_point_is_no_hint():
    points = np.arange(600.0).reshape(100, 6)
    for hint in (-7, 100, 2**40):
        assert_exact(points, points[40] + 0.1, hint=hint)


def test_the_same_points_make_the_same_tree():
    points = np.random.default_rng(3).integers(0, 9, (5_000, 6)).astype(float)
    for one, other in zip(build(points), build(points.copy()), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("points", "said"),
    [
        (np.zeros(6), r"shape \(6,\)"),
        (np.zeros((3, 0)), r"shape \(3, 0\)"),
        (np.array([[0.0], [np.nan]]), "point 1 is"),
        (np.array([[0.0, np.inf]]), "point 0 is"),
    ],
)
def test_points_that_make_no_tree_are_refused(points, said):
    with pytest.raises(ValueError, match=said):
        build(points)


def test_a_strided_query_is_refused():
    with pytest.raises(TypingError, match="C-contiguous"):
        nearest(build(np.zeros((9, 6))), np.zeros((6, 2))[:, 0], -1, -1)


def killer(n, middle):
    """Keys for which every pivot is among the lowest left (McIlroy's adversary)."""
    value = np.full(n, np.inf)
    candidate = -1

    class Key:
        def __init__(self, i: int) -> None:
            self.i = i

        def __lt__(self, other: "Key") -> bool:
            nonlocal candidate
            if np.isinf(value[self.i]) and np.isinf(value[other.i]):
                value[self.i if self.i == candidate else other.i] = np.isfinite(value).sum()
            if np.isinf(value[self.i]):
                candidate = self.i
            elif np.isinf(value[other.i]):
                candidate = other.i
            return bool(value[self.i] < value[other.i])

        def __gt__(self, other: "Key") -> bool:
            return other < self

        def __le__(self, other: "Key") -> bool:
            return not other < self

    with pytest.MonkeyPatch.context() as patch:
        for name in ("_median", "_below"):  # compiled they take no Key
            patch.setattr(kernel, name, getattr(kernel, name).py_func)
        _select.py_func([Key(i) for i in range(n)], np.arange(n), middle)
    return np.minimum(value, n)


@pytest.mark.parametrize("n", [10, 1_000])
def test_selection_survives_keys_made_to_defeat_it(n):
    for key in (killer(n, n // 2), np.zeros(n), np.arange(n)[::-1] * 1.0, np.arange(n) % 7 * 1.0):
        order = np.arange(n, dtype=np.int32)
        _select(key.copy(), order, n // 2)
        assert sorted(order) == [*range(n)]
        assert key[order[: n // 2]].max() <= key[order[n // 2 :]].min()


def test_a_tree_packed_on_many_threads_is_the_same(monkeypatch):
    points = np.random.default_rng(5).standard_normal((3_000, 4)).round(1)
    alone = build(points)
    monkeypatch.setattr(kernel, "POINTS_A_TASK", LEAF)
    for ours, expected in zip(build(points), alone, strict=True):
        np.testing.assert_array_equal(ours, expected)
