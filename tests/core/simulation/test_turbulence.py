import numpy as np
import pytest
from scipy.integrate import quad

from core.simulation.turbulence import (
    FOOT,
    LateralGust,
    intensity,
    scale_length,
    sideslip_gusts,
)

KNOT_IN_FEET = 1.6878


@pytest.mark.parametrize(
    ("feet", "ft"),
    [(10.0, 75.64), (100.0, 505.1), (1000.0, 1000.0), (1500.0, 1375.0), (3e4, 1750.0)],
)
def test_the_scale_is_that_of_the_specification(feet: float, ft: float):
    assert scale_length(feet * FOOT) / FOOT == pytest.approx(ft, rel=2e-3)


@pytest.mark.parametrize(
    ("turbulence", "feet", "ft_s"),
    [
        ("light", 1000.0, 1.5 * KNOT_IN_FEET),  # 0.1 W_20
        ("severe", 20.0, 4.5 * KNOT_IN_FEET / (0.177 + 0.000823 * 20.0) ** 0.4),
        ("moderate", 1500.0, 0.5 * (3.0 * KNOT_IN_FEET + 9.725)),
        ("moderate", 15e3, 8.0),
        ("severe", 35e3, 16.0),
        ("light", 50e3, 0.0),
        ("smooth", 50e3, 0.984),
        ("none", 50e3, 0.0),
    ],
)
def test_the_intensity_is_that_of_the_specification(turbulence, feet: float, ft_s: float):
    assert intensity(turbulence, feet * FOOT) / FOOT == pytest.approx(ft_s, rel=2e-3)


@pytest.mark.parametrize(("step", "time_constant"), [(0.05, 4.0), (0.3, 0.5), (1e-5, 4.0)])
def test_gusts_have_the_autocovariance_of_drydens_form(step: float, time_constant: float):
    n, sigma = 20_000, 0.01
    x = sideslip_gusts(LateralGust(sigma, time_constant), step, n, 42, np.uint64(3)) / sigma
    for lag in (0, 1, 2, 10, 40):
        t = lag * step / time_constant
        for first in (0, 1):  # stationary from the first sample on
            found = np.mean(x[:, first] * x[:, first + lag])
            assert abs(found - (1 - t / 2) * np.exp(-t)) < 4 * np.sqrt(2 / n)
    # increments, which are what moves the aircraft
    t = step / time_constant
    change = np.mean(np.diff(x[:, :2]) ** 2)
    assert change == pytest.approx(2 * (1 - (1 - t / 2) * np.exp(-t)), rel=4 * np.sqrt(2 / n))


def test_the_autocovariance_is_that_of_the_spectrum():
    def spectrum(w: float) -> float:
        return (1 + 3 * w * w) / (1 + w * w) ** 2 / np.pi

    for t in (0.0, 0.4, 2.0):
        found = 2 * quad(spectrum, 0, np.inf, weight=None if t == 0 else "cos", wvar=t or None)[0]
        assert found / 2 == pytest.approx((1 - t / 2) * np.exp(-t), abs=1e-8)


def test_gusts_depend_only_on_seed_and_number():
    gust = LateralGust(0.01, 2.0)
    few, many = (sideslip_gusts(gust, 0.05, n, 20, np.uint64(3)) for n in (5, 3000))
    np.testing.assert_array_equal(few, many[:5])
    assert not np.array_equal(few, sideslip_gusts(gust, 0.05, 5, 20, np.uint64(4)))
    assert len(np.unique(many[:, 0])) == 3000
