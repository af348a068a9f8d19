"""The lag of a source: the age of its newest sample less the best of the flight, drift removed."""

import numpy as np
import pytest

from app.assessment.lag import MOST_DRIFT, PART_S, PARTS, Lag

LATE = 0.4
HOUR = np.arange(0.0, 3600.0, 0.5)


def flown(ages: np.ndarray) -> Lag:
    """An hour of samples with these ages [s]."""
    lag = Lag(LATE)
    for arrived, age in zip(HOUR.tolist(), ages.tolist(), strict=True):
        lag.note(arrived, arrived - age)
    return lag


def test_latency_that_grows_for_an_hour_is_late_not_forgotten() -> None:
    lag = flown(0.1 + 2.8e-3 * HOUR)
    assert lag.now == pytest.approx(2.8e-3 * HOUR[-1], abs=MOST_DRIFT * HOUR[-1] + 0.01)
    assert lag.drift == MOST_DRIFT
    assert lag.reason
    assert lag.taken(100.0) == pytest.approx(100.1 + MOST_DRIFT * HOUR[-1], abs=0.01)


@pytest.mark.parametrize("drift", [-8e-5, 0.0, 5e-5])
def test_the_drift_of_a_clock_is_no_lag(drift: float) -> None:
    jitter = np.random.default_rng(2).exponential(0.02, len(HOUR))
    jitter[-1] = 0.0
    lag = flown(0.3 + drift * HOUR + jitter)
    assert lag.drift == pytest.approx(drift, abs=2e-6)
    assert lag.now == pytest.approx(0.0, abs=0.01)
    assert not lag.reason


def test_a_late_sample_after_hours_is_compared_with_the_best_arrival_of_the_flight() -> None:
    ages = np.full(len(HOUR), 0.5)
    ages[10] = 0.0
    lag = flown(ages)
    assert lag.now == pytest.approx(0.5, abs=MOST_DRIFT * HOUR[-1])


def test_short_flights_have_no_drift() -> None:
    lag = Lag(LATE)
    arrivals = np.arange(0.0, PARTS * PART_S, 1.0).tolist()
    for arrived in arrivals:
        lag.note(arrived, 0.99 * arrived)
    assert lag.drift == 0.0
    assert lag.now == pytest.approx(0.01 * arrivals[-1])


def test_the_intervals_of_late_samples_are_kept_from_the_last_in_time_to_the_next() -> None:
    lag = flown(np.where((HOUR > 100.0) & (HOUR < 120.0), 119.5 - HOUR, 0.0).clip(0.0) + 0.1)
    (late,) = lag.intervals
    assert late.start == pytest.approx(100.0 - 0.1)
    assert late.end == pytest.approx(119.5 - LATE, abs=0.5)
    lag.note(3700.0, 3600.0)
    assert lag.intervals[-1].end is None
