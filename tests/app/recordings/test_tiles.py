"""At any zoom the extremes of a bin are those of its samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.assessment import sample_type
from app.recordings.tiles import FACTOR, FINEST, make_tiles, window


def samples_of(n: int, seed: int = 0) -> np.ndarray:
    """Samples of which some are missing, some invalid, some alerts."""
    rng = np.random.default_rng(seed)
    samples = np.zeros(n, sample_type(6))
    samples["t"] = 0.1 * np.arange(n)
    samples["y"] = np.where(rng.random((n, 6)) < 0.3, np.nan, rng.standard_normal((n, 6)))
    samples["p_value"] = np.where(rng.random(n) < 0.5, np.nan, rng.random(n))
    samples["withdrawn"] = np.where(rng.random(n) < 0.9, np.nan, rng.random(n))
    samples["state"] = rng.integers(0, 4, n)
    samples["alert"] = rng.random(n) < 0.02
    return samples


@given(st.integers(1, 5000), st.data(), st.integers(1, 300))
def test_a_bin_has_the_extremes_of_its_samples(n, data, bins):
    samples = samples_of(n)
    first = data.draw(st.integers(0, n - 1))
    last = data.draw(st.integers(first, n - 1))
    view = window(samples, make_tiles(samples), first, last, bins)
    assert 0 < len(view.bins) <= bins
    begins = view.first + view.width * np.arange(len(view.bins))
    assert begins[0] <= first
    assert begins[-1] <= last < begins[-1] + view.width
    for begin, tile in zip(begins, view.bins, strict=True):
        part = samples[begin : begin + view.width]
        np.testing.assert_array_equal(tile["low"], np.fmin.reduce(part["y"]))
        np.testing.assert_array_equal(tile["high"], np.fmax.reduce(part["y"]))
        np.testing.assert_array_equal(tile["risk_low"], np.fmin.reduce(part["p_value"]))
        np.testing.assert_array_equal(tile["risk_high"], np.fmax.reduce(part["p_value"]))
        np.testing.assert_array_equal(tile["withdrawn"], np.fmax.reduce(part["withdrawn"]))
        assert tile["state"] == part["state"].max()
        assert tile["alert"] == part["alert"].any()


@pytest.mark.parametrize("bins", [1, 7, 100, 1000])
@pytest.mark.parametrize("length", [10, 999, 20_000, 100_000])
def test_a_window_is_as_fine_as_it_may_be(bins, length):
    samples = samples_of(100_000)
    view = window(samples, make_tiles(samples), 0, length - 1, bins)
    assert len(view.bins) >= min(length, bins) / 2 / (1 + 1 / FACTOR)


def test_any_window_uses_few_tiles(monkeypatch):
    samples = samples_of(200_000)
    tiles = make_tiles(samples)
    assert tiles.nbytes < 0.2 * samples.nbytes
    from app.recordings import tiles as module

    looked_at = []
    joined = module._joined
    monkeypatch.setattr(
        module, "_joined", lambda source, n: looked_at.append(len(source)) or joined(source, n)
    )
    for length in (100, 5_000, 50_000, 200_000):
        window(samples, tiles, 0, length - 1, 50)
    assert max(looked_at) <= 50 * FACTOR * FINEST
