"""The simulated day of the sizing study, against what is known of it."""

import numpy as np

from tests.studies.sizing import FLIGHT_H, WORKING_H, Measured, most_at_once, need


def test_many_flights_at_once_are_the_mean_and_little_more() -> None:
    peak, mean = most_at_once(10_000, np.random.default_rng(1)), 10_000 * FLIGHT_H / WORKING_H
    assert mean < peak < mean + 8.0 * np.sqrt(mean)


def test_costs_are_proportional_to_the_hours() -> None:
    measured = Measured(cpu_us=400.0, disk_mb=50.0, flights=50)
    needed = need(10, measured, np.random.default_rng(0))
    assert needed.core_h == 10 * 180_000 * 400e-6 / 3600
    assert needed.tb_a_year == 10 * 50 * 365 / 1e6
