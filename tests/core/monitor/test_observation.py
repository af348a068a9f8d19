"""Observations: order, padding, lead and scale."""

from fractions import Fraction
from math import ceil

import numpy as np
import pytest

from core.monitor.observation import (
    Observations,
    OutputsAhead,
    channel_peaks,
    channel_scale,
    lead_steps,
)
from tests.support import plain_twin as twin


def test_observations_equal_the_plain_twin() -> None:
    rng = np.random.default_rng(1)
    y = rng.standard_normal((4, 9, 6))
    times, scale = np.array([rng.choice(9, 5, replace=False) for _ in y]), rng.uniform(1, 2, 6)
    for n_delay in (0, 1, 2, 7):
        expected = [
            twin.observations(flight, n_delay)[t] for flight, t in zip(y, times, strict=True)
        ]
        o = Observations(y, times, n_delay, scale)
        assert (o[:] == np.vstack(expected) / np.tile(scale, n_delay + 1)).all()
        assert o.shape == o[:].shape
        assert all((o[i : i + 4] == o[:][i : i + 4]).all() for i in range(o.shape[0]))


def test_before_the_start_the_first_sample_repeats() -> None:
    y = np.arange(4.0)[None, :, None] * np.ones(6)
    o = Observations(y, np.array([[0, 1, 3]]), 2, np.ones(6))
    assert o[:][:, ::6].tolist() == [[0, 0, 0], [0, 0, 1], [1, 2, 3]]


def test_outputs_ahead_are_nan_where_the_flight_has_ended() -> None:
    y = np.array([0.0, 10.0])[:, None, None] + np.arange(5.0)[:, None] * np.ones(6)
    ahead = OutputsAhead(y, np.array([[0, 2, 3, 4], [0, 1, 2, 4]]), 2, 2 * np.ones(6))
    missing = [False, False, True, True, False, False, False, True]
    np.testing.assert_array_equal(
        ahead[:][:, 0], np.where(missing, np.nan, np.array([2, 4, 0, 0, 12, 13, 14, 0]) / 2)
    )
    assert (np.isnan(ahead[:]).all(axis=1) == missing).all()
    assert ahead.shape == ahead[:].shape
    np.testing.assert_array_equal(ahead[3:6], ahead[:][3:6])


@pytest.mark.parametrize("dt", ["0.01", "0.02", "0.04", "0.05", "0.1", "0.125"])
def test_lead_is_the_least_number_of_samples_that_covers_the_wish(dt: str) -> None:
    for hundredths in range(1, 200):
        wish = Fraction(hundredths, 100)
        assert lead_steps(float(wish), float(dt)) == ceil(wish / Fraction(dt))


def test_scale_is_the_standard_deviation_and_one_for_a_still_channel() -> None:
    y = np.random.default_rng(2).standard_normal((50, 6)) * [1, 2, 1e-9, 0, 5, 6]
    y[:, 4] = 0.1  # sums of 0.1 round: its computed deviation is not zero
    scale = channel_scale(y)
    assert scale[[3, 4]].tolist() == [1, 1]
    moving = [0, 1, 2, 5]
    np.testing.assert_allclose(scale[moving], y.std(axis=0)[moving], rtol=1e-14)
    assert channel_scale(np.zeros((3, 6))).tolist() == [1] * 6


def test_peaks_are_of_the_samples_that_are_numbers() -> None:
    y = np.random.default_rng(3).standard_normal((5, 9, 6))
    y[2, 4:] = np.nan
    assert (channel_peaks(y) == np.nanmax(np.abs(y), axis=(0, 1))).all()
