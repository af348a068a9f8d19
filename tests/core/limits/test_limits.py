"""Limits: the limit itself is unsafe, and so is a diverged flight."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.channels import KEYS
from core.limits.exceedance import exceedance
from core.limits.limits import SPECIFICATIONS, Envelope, Limits


@pytest.mark.parametrize("sign", [1, -1])
def test_the_limit_itself_is_unsafe(sign: int) -> None:
    y = np.zeros((1, 5, 6))
    y[0, 2:, 3] = sign * 0.5
    assert Limits().first_exceedance(y).tolist() == [2]
    y[0, 2, 3] = sign * np.nextafter(0.5, 0)
    assert Limits().first_exceedance(y).tolist() == [3]


def test_a_flight_within_limits_has_its_length_as_failure_index() -> None:
    y = np.full((3, 7, 6), 100.0)
    y[..., 3] = 0.499
    assert Limits().first_exceedance(y).tolist() == [7, 7, 7]
    assert Limits().first_exceedance(y[:, :0]).tolist() == [0, 0, 0]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_limited_channel_that_is_not_finite_exceeds(value: float) -> None:
    y = np.zeros((1, 5, 6))
    y[0, 3, 3] = value
    assert Limits().first_exceedance(y).tolist() == [3]


@given(st.integers(0, 2**32), st.sets(st.sampled_from(KEYS), min_size=1))
def test_first_exceedance_equals_a_loop_over_samples(seed: int, limited: set[str]) -> None:
    rng = np.random.default_rng(seed)
    y = rng.integers(-4, 5, (4, 6, 6)).astype(float)
    limits = {key: float(rng.integers(2, 5)) for key in limited}
    expected = [
        next(
            (
                k
                for k, sample in enumerate(flight)
                if any(abs(sample[KEYS.index(key)]) >= limit for key, limit in limits.items())
            ),
            6,
        )
        for flight in y
    ]
    specification = Limits(**{"Ny": None} | limits)
    assert specification.first_exceedance(y).tolist() == expected


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan"), float("inf")])
def test_a_limit_that_is_not_a_positive_magnitude_is_refused(limit: float) -> None:
    with pytest.raises(ValueError, match=r"limit beta=.* was given: a limit is a positive, finite"):
        Limits(beta=limit)


def test_a_specification_without_limits_is_refused() -> None:
    with pytest.raises(ValueError, match="no limit was given: set at least one"):
        Limits(Ny=None)


@pytest.mark.parametrize("name", SPECIFICATIONS)
def test_every_specification_distinguishes_rest_from_a_violent_flight(name: str) -> None:
    y = np.stack([np.zeros((9, 6)), np.full((9, 6), 1e6)])
    assert SPECIFICATIONS[name].first_exceedance(y).tolist() == [9, 0]


def test_the_largest_of_numbers_is_an_exceedance_like_any_other() -> None:
    limits = Envelope.of_magnitudes(np.array([np.inf, 0.5]))
    y = np.array([0.0, -1.7e308])
    named = exceedance(("beta", "Ny"), limits, y, y)
    assert named is not None
    assert (named.channel, named.value) == ("Ny", -1.7e308)
