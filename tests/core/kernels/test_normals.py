import numpy as np
from scipy import stats
from scipy.special import ndtri

from core.kernels.compiled import jit
from core.kernels.imperfections import (
    CELLS,
    MOST_TAILS,
    QUANTILES,
    _in_tail,
    stream_of,
    uniform,
    write_normals,
)
from core.kernels.lanes import WIDTH, address, aligned

SEED = np.uint64(7)
MASK = 2**64 - 1


@jit
def uniforms(own, out):
    for k in range(len(out)):
        out[k] = uniform(own, k)


@jit
def normals(quantiles, streams, out):
    tails = np.empty(MOST_TAILS, np.int64)
    write_normals(address(quantiles), address(streams), out.shape[0], address(tails), address(out))


def stream(number: int) -> np.uint64:
    return np.uint64(stream_of(SEED, number))


def drawn(first: int, n: int) -> np.ndarray:
    """(n, 8) normal numbers, n even, of eight streams."""
    out = aligned(n * WIDTH).reshape(n, WIDTH)
    normals(QUANTILES, np.array([stream(first + lane) for lane in range(WIDTH)]), out)
    return out


def halves(number: int, n: int) -> np.ndarray:
    """Half words of a stream by splitmix64 in plain integers."""
    words, state = [], int(stream(number))
    for _ in range(n // 2):
        state = (state + 0x9E3779B97F4A7C15) & MASK
        word = ((state ^ state >> 30) * 0xBF58476D1CE4E5B9) & MASK
        word = ((word ^ word >> 27) * 0x94D049BB133111EB) & MASK
        words.append(word ^ word >> 31)
    return np.array([half for word in words for half in (word >> 32, word & 2**32 - 1)])


def test_a_million_normals_pass_kolmogorov_smirnov_and_have_the_moments():
    x = drawn(0, 131_072).ravel()
    n = len(x)
    assert stats.kstest(x, "norm").pvalue > 0.01
    for moment, expected, variance in (
        (x.mean(), 0.0, 1.0),
        (x.var(), 1.0, 2.0),
        (stats.skew(x), 0.0, 6.0),
        (stats.kurtosis(x), 0.0, 24.0),
    ):
        assert abs(moment - expected) < 4 * np.sqrt(variance / n)


def test_tails_hold_to_five_sigma():
    x = np.concatenate([drawn(first, 2**20).ravel() for first in range(0, 32, WIDTH)])
    for z in (2.0, 2.6, 2.7, 3.5, 4.2, 4.6, 5.0):  # the computed tails begin at 2.66
        for side in (x > z, x < -z):
            expected = len(x) * stats.norm.sf(z)
            assert abs(side.sum() - expected) < 4 * np.sqrt(expected), z


def test_a_number_is_the_quantile_of_its_bits():
    for lane in (0, 5):
        bits, out = halves(3 + lane, 4000), drawn(3, 4000)[:, lane]
        expected = ndtri((bits + 0.5) / 2.0**32)
        np.testing.assert_allclose(out, expected, atol=2e-3)
        assert abs(out - expected).mean() < 1e-5
        cell, share = bits >> 21, ((bits & 2**21 - 1) + 0.5) * 2.0**-21
        inside = (cell >= 8) & (cell < CELLS - 8)
        low, high = QUANTILES[cell], QUANTILES[cell + 1]
        np.testing.assert_array_equal(out[inside], (low + share * (high - low))[inside])


def test_the_quantiles_are_those_of_the_normal_distribution():
    quantiles = ndtri(np.arange(CELLS + 1) / CELLS)
    assert QUANTILES[1:-1].tobytes() == quantiles[1:-1].tobytes()


def test_tails_are_exact():
    bits = np.array([0, 5, 10**6, 2**24 - 1, 2**32 - 2**24, 2**32 - 1], np.uint64)
    exact = ndtri((bits + 0.5) / 2.0**32)
    np.testing.assert_allclose([_in_tail(half) for half in bits], exact, rtol=1e-12)


def test_lanes_streams_and_their_numbers_are_independent():
    x = np.concatenate([drawn(first, 400).T for first in range(0, 400, WIDTH)])
    for a, b in ((x[:-1], x[1:]), (x[:, :-1], x[:, 1:]), (x[:, :-2], x[:, 2:])):
        for f in (np.asarray, np.square):
            assert abs(np.corrcoef(f(a).ravel(), f(b).ravel())[0, 1]) < 4 / np.sqrt(a.size)
    between = np.corrcoef(drawn(0, 100_000).T)[np.triu_indices(WIDTH, 1)]
    assert np.abs(between).max() < 4 / np.sqrt(100_000)


def test_a_stream_draws_the_same_in_any_lane():
    np.testing.assert_array_equal(drawn(2, 100)[:, 3], drawn(5, 100)[:, 0])


def test_a_longer_draw_begins_with_the_shorter_one():
    np.testing.assert_array_equal(drawn(2, 100), drawn(2, 900)[:100])


def test_uniform_numbers_fill_their_interval():
    out = np.empty(100_000)
    uniforms(stream(9), out)
    assert 0 <= out.min() < out.max() < 1
    assert stats.kstest(out, "uniform").pvalue > 0.01
