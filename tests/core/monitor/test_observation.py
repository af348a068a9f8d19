"""Observations: order, padding, lead and scale."""

from fractions import Fraction
from math import ceil

import numpy as np
import pytest

from core.monitor.observation import channel_scale, lead_steps, observations_at, outputs_ahead
from tests.support import plain_twin as twin


def test_observations_equal_the_plain_twin() -> None:
    rng = np.random.default_rng(1)
    y = rng.standard_normal((4, 9, 6))
    times = np.array([rng.choice(9, 5, replace=False) for _ in y])
    for n_delay in (0, 1, 2, 7):
        expected = [
            twin.observations(flight, n_delay)[t] for flight, t in zip(y, times, strict=True)
        ]
        assert (observations_at(y, times, n_delay) == np.vstack(expected)).all()


def test_before_the_start_the_first_sample_repeats() -> None:
    y = np.arange(4.0)[None, :, None] * np.ones(6)
    o = observations_at(y, np.array([[0, 1, 3]]), n_delay=2)
    assert o[:, ::6].tolist() == [[0, 0, 0], [0, 0, 1], [1, 2, 3]]


def test_outputs_ahead_are_nan_where_the_flight_has_ended() -> None:
    y = np.arange(5.0)[None, :, None] * np.ones(6)
    ahead = outputs_ahead(y, np.array([[0, 2, 3, 4]]), h=2)
    np.testing.assert_array_equal(ahead[:, 0], [2, 4, np.nan, np.nan])
    assert np.isnan(ahead[2:]).all()


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
