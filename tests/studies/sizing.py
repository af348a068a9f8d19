"""How large an installation must be: the guide's table for 10 to 100,000 flight-hours a day.

Measured costs of a flight are multiplied, and a day of flights is simulated for how many are in
progress at once.
"""

import argparse
from typing import NamedTuple

import numpy as np

HOURS = (10, 1_000, 100_000)
"""Flight-hours a day."""
WORKING_H, FLIGHT_H, DAYS = 10.0, 1.0, 1_000
"""Flights begin at random in working hours; length of a flight; simulated days."""


class Measured(NamedTuple):
    """Of a flight of 50 Hz, six channels and four screens.

    cpu_us: of a sample sent alone, and shown on each screen.   disk_mb: of a flight-hour.
    flights: that one server carries at once.
    """

    cpu_us: float
    disk_mb: float
    flights: int


class Need(NamedTuple):
    """hours: a day.   at_once: most flights in progress, on all but one day in a hundred."""

    hours: int
    at_once: int
    servers: int
    core_h: float
    tb_a_year: float


def most_at_once(hours: int, rng: np.random.Generator) -> int:
    """Most flights in progress at once on all but one simulated day in a hundred."""
    peaks = np.empty(DAYS)
    for day in range(DAYS):
        starts = np.sort(rng.uniform(0.0, WORKING_H, rng.poisson(hours / FLIGHT_H)))
        before = np.searchsorted(starts, starts - FLIGHT_H, side="right")
        peaks[day] = (np.arange(1, len(starts) + 1) - before).max(initial=0)
    return int(np.quantile(peaks, 0.99, method="higher"))


def need(hours: int, measured: Measured, rng: np.random.Generator) -> Need:
    samples = hours * 3600 * 50
    at_once = most_at_once(hours, rng)
    return Need(
        hours,
        at_once,
        -(-at_once // measured.flights),
        samples * measured.cpu_us / 1e6 / 3600,
        hours * measured.disk_mb * 365 / 1e6,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cpu-us", type=float, required=True, help="of a sample [us]")
    parser.add_argument("--disk-mb", type=float, required=True, help="of a flight-hour [MB]")
    parser.add_argument("--flights", type=int, default=50, help="of one server at once")
    options = parser.parse_args()
    measured, rng = (
        Measured(options.cpu_us, options.disk_mb, options.flights),
        np.random.default_rng(0),
    )
    print("| flight-hours a day | at once | servers | core-hours a day | TB a year |")
    print("|---|---|---|---|---|")
    for hours in HOURS:
        print("| {:,} | {:,} | {:,} | {:,.1f} | {:,.2f} |".format(*need(hours, measured, rng)))


if __name__ == "__main__":
    main()
