"""Every exceedance of a flight is told, channel by channel, to who watches and who joins late."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from app.flights.ended import records
from app.messages import Hello
from core.channels import KEYS
from core.limits.exceedance import (
    ChannelExceedances,
    Exceedances,
    Exceeded,
    MeasuredExceedance,
    exceedance,
)
from core.limits.limits import Limits
from tests.app.flights.test_flight_limits import Range
from tests.app.flights.test_flight_limits import run as run_range
from tests.support.flying import T, exact_monitor
from tests.support.oscillator import DT, N_SAMPLES
from tests.support.stored import alarm

NY, P = KEYS.index("Ny"), KEYS.index("p")
LIMITS = Limits(Ny=0.5, p=1.0).envelope
run = run_range


def sampled(*values: tuple[float, float]) -> Exceedances:
    """Samples of (Ny, p), a second each."""
    log = Exceedances(dict.fromkeys(KEYS, 0.0))
    for t, (ny, p) in enumerate(values):
        y = np.zeros(6)
        y[[NY, P]] = ny, p
        log.update(float(t), y, LIMITS, exceedance(KEYS, LIMITS, y, y))
    return log


def test_each_channel_tells_how_many_the_newest_and_the_worst() -> None:
    log = sampled((0.5, 0), (0.9, 2), (0, 2), (-0.6, 0), (0, 0), (0.7, 0))
    ny, p = log.of_channels
    assert (ny.channel, ny.n, ny.first_t, ny.last_t) == ("Ny", 3, 0.0, 5.0)
    assert (ny.worst, ny.worst_t, ny.limit) == (0.9, 1.0, 0.5)
    assert (p.channel, p.n, p.first_t, p.last_t, p.worst) == ("p", 1, 1.0, 1.0, 2.0)


def test_what_a_seek_comes_to_again_is_counted_once() -> None:
    log = sampled((0, 0), (0.6, 0), (0, 0))
    log.restart()
    y = np.array([0, 0, 0, 0.6, 0, 0])
    log.update(1.0, y, LIMITS, exceedance(KEYS, LIMITS, y, y))
    assert [one.n for one in log.of_channels] == [1]


def test_received_samples_and_those_of_the_grid_count_alike_in_any_order() -> None:
    over = MeasuredExceedance("Ny", 0.6, 0.5, "both")
    received = [0.02 * k for k in (*range(50, 70), *range(90, 110))]
    on_grid = [(0.05 * k, 20 <= k < 28 or 36 <= k < 44) for k in range(60)]

    def add(log: Exceedances) -> None:
        for t in received:
            log.add(Exceeded(t, over), np.zeros(6))

    def update(log: Exceedances) -> None:
        for t, is_over in on_grid:
            y = np.where(np.arange(6) == NY, 0.6 * is_over, 0.0)
            log.update(t, y, LIMITS, over if is_over else None)

    counts = []
    for way in ((add, update), (update, add)):
        log = Exceedances(dict.fromkeys(KEYS, 0.0), near=0.1)
        for act in way:
            act(log)
        counts += [one.n for one in log.of_channels]
    assert counts == [2, 2]


def test_a_sample_of_the_grid_beside_received_ones_changes_no_time_and_no_value() -> None:
    log = Exceedances(dict.fromkeys(KEYS, 0.0), near=0.1)
    over = MeasuredExceedance("Ny", 0.6, 0.5, "both")
    received, on_grid = (np.where(np.arange(6) == NY, ny, 0.0) for ny in (0.6, 0.9))
    log.add(Exceeded(1.02, over), received, LIMITS)
    log.update(0.95, on_grid, LIMITS, exceedance(KEYS, LIMITS, on_grid, on_grid))
    (of_channel,), (latched,) = log.of_channels, log.latched
    assert (of_channel.n, of_channel.first_t, of_channel.worst) == (1, 1.02, 0.6)
    assert latched.t == log.first_t == 1.02


def test_the_worst_value_is_one_from_trim_and_a_further_one_as_recorded_is_beside_it() -> None:
    log = Exceedances(dict.fromkeys(KEYS, 0.0))
    for t, ny in ((7.4, 0.31), (7.65, 0.49), (7.7, 0.504), (7.75, 0.503), (7.8, 0.45)):
        y, recorded = (np.where(np.arange(6) == NY, value, 0.0) for value in (ny, ny + 0.225))
        named = exceedance(KEYS, LIMITS, y, recorded)
        log.update(t, y, LIMITS, named, recorded)
        if t < 7.7:
            assert [one.worst for one in log.of_channels] == [pytest.approx(ny + 0.225)]
            assert [one.value for one in log.latched] == [pytest.approx(ny + 0.225)]
        assert log.is_first_as_recorded
    (of_ny,), (latched,) = log.of_channels, log.latched
    assert (of_ny.n, of_ny.first_t, of_ny.worst, of_ny.worst_t) == (1, 7.4, 0.504, 7.7)
    assert (of_ny.recorded, of_ny.recorded_t) == (pytest.approx(0.729), 7.7)
    assert (latched.t, latched.value, latched.recorded) == (7.4, 0.504, pytest.approx(0.729))
    log = sampled((0.6, 0))
    assert not log.is_first_as_recorded
    assert [one.recorded for one in log.latched] == [None]


def test_a_value_of_unknown_trim_is_latched_as_recorded() -> None:
    log = Exceedances(dict.fromkeys(KEYS, 0.0))
    for t, ny in ((1.0, 0.56), (1.1, 0.92), (1.2, 0.1)):
        recorded = np.where(np.arange(6) == NY, ny, 0.0)
        y = np.where(np.arange(6) == NY, np.nan, recorded)
        log.update(t, y, LIMITS, exceedance(KEYS, LIMITS, y, recorded), recorded)
        (latched,) = log.latched
        assert latched.over == (ny > 0.5)
    assert (latched.t, latched.value, latched.recorded) == (1.0, 0.92, None)


def test_a_latched_value_as_recorded_grows_with_the_samples_received_later() -> None:
    """It is never called one from trim; N_y is at a trim of 0.3 g."""
    log = Exceedances(dict.fromkeys(KEYS, 0.0), near=0.1)
    for t, ny in ((1.0, 0.56), (1.05, 0.6), (1.1, 0.3), (1.15, 0.3)):
        recorded, y = (np.where(np.arange(6) == NY, value, 0.0) for value in (ny, ny - 0.3))
        named = exceedance(KEYS, LIMITS, y, recorded)
        if named is not None:
            log.add(Exceeded(t, named), y, LIMITS, recorded)
        earlier = np.where(np.arange(6) == NY, 0.56, 0.0) if t == 1.05 else recorded
        on_grid = exceedance(KEYS, LIMITS, earlier - (recorded - y), earlier)
        log.update(t - 0.05, earlier - (recorded - y), LIMITS, on_grid, earlier)
    (latched,) = log.latched
    assert (latched.t, latched.value, latched.recorded) == (1.0, 0.6, None)
    assert latched.as_recorded


def test_a_latched_value_is_the_largest_of_all_exceedances_until_acknowledged() -> None:
    log = sampled((0.9, 0), (0, 0), (0.6, 0), (0, 0))
    (latched,) = log.latched
    assert (latched.t, latched.value) == (0.0, 0.9)


def test_an_exceedance_is_latched_until_it_was_acknowledged_and_is_over() -> None:
    log = sampled((0.6, 0), (0.8, 0), (0, 0))
    (latched,) = log.latched
    assert (latched.t, latched.value, latched.over) == (0.0, 0.8, False)
    log.acknowledge()
    assert log.latched == []
    log = sampled((0.6, 0))
    log.acknowledge()
    assert [one.acknowledged for one in log.latched] == [True]
    log.update(1.0, np.zeros(6), LIMITS, None)
    assert log.latched == []


def test_who_joins_late_is_told_what_the_others_saw_and_the_record_counts_it(
    run: Callable[..., None],
) -> None:
    """Limits by Mach: 0.5 g, from sample 20 on 0.4 g, and 0.45 g four times, twice beyond it."""

    async def test(place: Range) -> None:
        asked: dict[str, Any] = {"monitor": place.add(exact_monitor(), "oscillator")}
        asked |= {"source": {"kind": "live", "trim": "none"}}
        async with place.flights() as flights:
            flight = await place.fly(flights, **asked)
            for k in range(40):
                place.clock.advance(DT)
                sample = {"t": T[k], "mach": 0.7 if k < 20 else 0.9} | dict.fromkeys(KEYS, 0.01)
                sample["Ny"] = 0.45 if k in (5, 10, 25, 30, 31) else 0.01
                await flight.receive(json.dumps(sample), "rest").stored
            hello = Hello.model_validate_json(flight.watch().next_message() or "")
            assert [(one.t, one.limits and one.limits["Ny"]) for one in hello.held] == [
                (None, 0.5),
                (None, None),
                (T[0], 0.5),
                (T[20], 0.4),
            ]
            (latched,) = hello.latched
            assert (latched.channel, latched.t, latched.over) == ("Ny", T[25], False)
            await flights.stop(flight.id)
            info = place.store.flights.info(flight.id)
        (told,) = records(place.store, [info])[flight.id].exceedances
        expected = {"n": 2, "first_t": T[25], "last_t": T[30], "worst": 0.45, "worst_t": T[25]}
        assert told == ChannelExceedances(channel="Ny", limit=0.4, **expected)
        assert hello.exceedances == [told]

    run(test)


@pytest.mark.parametrize("kept", [True, False])
def test_of_a_flight_that_was_cut_short_its_alarms_tell(
    kept: bool, run: Callable[..., None]
) -> None:
    async def test(place: Range) -> None:
        own = place.add(exact_monitor(), "oscillator")
        flight = place.store.flights.add({"kind": "live"}, own, 0.3)
        named = MeasuredExceedance("Ny", 0.6, 0.5, "from_trim")
        kept_ = [{"channel": "Ny", "n": 4, "first_t": 1.0, "last_t": 9.0}]
        kept_[0] |= {"worst": 0.9, "worst_t": 2.0, "limit": 0.5}
        for number, t in ((1, 2.0), (2, 4.0)):
            place.store.alarms.add(flight, alarm(number, number, t, "limit", exceedance=named))
        place.store.flights.end(flight, "interrupted", 2.0, kept_ if kept else None)
        (told,) = records(place.store, [place.store.flights.info(flight)])[flight].exceedances
        assert (told.n, told.last_t, told.worst) == ((4, 9.0, 0.9) if kept else (2, 4.0, 0.6))

    run(test)


def test_of_a_flight_that_was_cut_short_every_recorded_exceedance_counts(
    run: Callable[..., None],
) -> None:
    """Two passes over an exceedance of each sign, of which the alarm names the first alone."""

    async def test(place: Range) -> None:
        own = place.add(exact_monitor(), "oscillator")
        flight = place.store.flights.add({"kind": "simulated"}, own, 0.3)
        y = np.zeros((N_SAMPLES, 6))
        y[5:8, NY], y[20:24, NY] = -0.53, 0.609
        for first in (0, N_SAMPLES):
            none = np.zeros(N_SAMPLES)
            place.store.flights.append(flight, first, T, y, none, none.astype(bool), none)
        named = MeasuredExceedance("Ny", -0.53, -0.5, "both")
        place.store.alarms.add(flight, alarm(1, 5, T[5], "limit", exceedance=named))
        place.store.flights.recover()
        (told,) = records(place.store, [place.store.flights.info(flight)])[flight].exceedances
        expected = {"n": 2, "first_t": T[5], "last_t": T[20], "worst": 0.609, "worst_t": T[20]}
        assert told == ChannelExceedances(channel="Ny", limit=0.5, **expected)

    run(test)
