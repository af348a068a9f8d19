import numpy as np
from scipy import stats
from scipy.special import ndtri

from core.kernels.compiled import jit
from core.kernels.imperfections import (
    _QUANTILES,
    CELLS,
    _half,
    _in_tail,
    fill_normals,
    stream_of,
    uniform,
)

SEED = np.uint64(7)


@jit
def uniforms(own, out):
    for k in range(len(out)):
        out[k] = uniform(own, k)


def stream(number: int) -> np.uint64:
    return np.uint64(stream_of(SEED, number))


def drawn(number: int, n: int) -> np.ndarray:
    out = np.empty(n)
    fill_normals(stream(number), out)
    return out


def test_normals_are_standard_normal_to_the_tails():
    x = np.concatenate([drawn(number, 200_000) for number in (0, 1)])
    assert stats.kstest(x, "norm").pvalue > 0.01
    for z in (2.0, 2.6, 2.7, 3.5, 4.2):  # the computed tails begin at 2.66
        count, expected = (np.abs(x) > z).sum(), len(x) * 2 * stats.norm.sf(z)
        assert abs(count - expected) < 4 * np.sqrt(expected), z
    assert abs(stats.kurtosis(x)) < 4 * np.sqrt(24 / len(x))


def test_a_number_is_the_quantile_of_its_bits():
    out, own = drawn(3, 4000), stream(3)
    halves = np.array([_half(own, k) for k in range(len(out))])
    expected = ndtri((halves + 0.5) / 2.0**32)
    np.testing.assert_allclose(out, expected, atol=2e-3)
    assert abs(out - expected).mean() < 1e-5


def test_the_quantiles_are_those_of_the_normal_distribution():
    quantiles = ndtri(np.arange(CELLS + 1) / CELLS)
    assert _QUANTILES[1:-1].tobytes() == quantiles[1:-1].tobytes()


def test_tails_are_exact():
    halves = np.array([0, 5, 10**6, 2**24 - 1, 2**32 - 2**24, 2**32 - 1], np.uint64)
    exact = ndtri((halves + 0.5) / 2.0**32)
    np.testing.assert_allclose([_in_tail(half) for half in halves], exact, rtol=1e-12)


def test_streams_and_their_numbers_are_independent():
    x = np.array([drawn(number, 400) for number in range(400)])
    for a, b in ((x[:-1], x[1:]), (x[:, :-1], x[:, 1:]), (x[:, :-2], x[:, 2:])):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 4 / np.sqrt(a.size)


def test_a_longer_draw_begins_with_the_shorter_one():
    np.testing.assert_array_equal(drawn(2, 100), drawn(2, 900)[:100])


def test_uniform_numbers_fill_their_interval():
    out = np.empty(100_000)
    uniforms(stream(9), out)
    assert 0 <= out.min() < out.max() < 1
    assert stats.kstest(out, "uniform").pvalue > 0.01
