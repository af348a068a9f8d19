"""The band of a forecast: how wide it is, and when it and its mean first exceed a limit."""

import numpy as np
import pytest
from scipy.stats import norm

from core.monitor.peak_forecast import BAND, ForecastAhead, PeakAhead


def of_lateral_acceleration(mean: list[float], limit: float) -> ForecastAhead:
    """With a deviation of 0.1 g."""
    means, limits = np.zeros((len(mean), 6)), np.full(6, np.inf)
    means[:, 3], limits[3] = mean, limit
    t = np.linspace(2.0, 1.5 + 0.5 * len(mean), len(mean))
    return ForecastAhead(1.5, t, means, np.full_like(means, 0.1), limits)


def test_the_band_holds_its_share_of_a_normal_forecast():
    ahead = of_lateral_acceleration([0.0, 0.3, -0.4], limit=0.5)
    held = norm.cdf(ahead.high, ahead.mean, 0.1) - norm.cdf(ahead.low, ahead.mean, 0.1)
    assert held == pytest.approx(np.full((3, 6), BAND))
    peak = PeakAhead(1.5, mean=0.8, deviation=0.1)
    assert norm.cdf(peak.high, 0.8, 0.1) - norm.cdf(peak.low, 0.8, 0.1) == pytest.approx(BAND)


def test_the_band_of_a_peak_begins_at_zero_at_the_least():
    assert PeakAhead(1.5, mean=0.1, deviation=0.1).low == 0


@pytest.mark.parametrize("sign", [1, -1])
def test_the_band_exceeds_a_limit_of_either_sign_before_the_mean_does(sign: int):
    ahead = of_lateral_acceleration([0.3 * sign, 0.4 * sign, 0.6 * sign], limit=0.5)
    assert (ahead.possible(3), ahead.predicted(3)) == (2.5, 3.0)
    assert ahead.possible(0) is ahead.predicted(0) is None
