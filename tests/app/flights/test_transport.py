"""Transport: what is due when, against arithmetic."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.flights.sources.simulated import times
from app.flights.transport import BURST, CATCH_UP_S, Due, Transport, TransportError

DT = 0.05
T = times(41, DT)


def playing(now: float = 100.0, **choices) -> Transport:
    transport = Transport(T, DT, **choices)
    transport.play(now)
    return transport


def samples(transport: Transport, now: float) -> list[int]:
    return [due.sample for due in transport.due_samples(now)]


def test_sample_k_is_due_k_intervals_after_the_start() -> None:
    transport = playing(now=100.0)
    assert list(transport.due_samples(100.0)) == [Due(0, 100.0, False)]
    assert samples(transport, 100.049) == []
    assert transport.next_due(100.049) == pytest.approx(100.05)
    assert samples(transport, 100.12) == [1, 2]
    assert transport.position == T[2]


@given(st.lists(st.floats(0.0, 0.4), min_size=1, max_size=40), st.floats(0.1, 10.0))
def test_late_calls_cause_no_drift_and_lose_nothing(waits: list[float], speed: float) -> None:
    """However late each call comes, the due times are those of the start."""
    transport, now = playing(speed=speed), 100.0
    flown = list(transport.due_samples(now))
    for wait in waits:
        now += wait
        flown += transport.due_samples(now)
    assert [due.sample for due in flown] == list(range(len(flown)))
    for due in flown:
        assert due.due == pytest.approx(100.0 + T[due.sample] / speed, abs=1e-9)
        assert due.due <= now
    assert transport.slipped == 0
    if transport.playing:
        assert len(flown) == min(np.searchsorted(T / speed, now - 100.0, "right"), len(T))


def test_a_flight_that_is_far_behind_slips_and_says_how_far() -> None:
    transport = playing()
    assert samples(transport, 100.0) == [0]
    behind = CATCH_UP_S + 9.0
    assert samples(transport, 100.0 + DT + behind) == [1]
    assert transport.slipped == pytest.approx(behind)
    assert samples(transport, 100.0 + 2 * DT + behind + 1e-6) == [2]


def test_speed_changes_the_wait_not_the_place() -> None:
    transport = playing()
    assert samples(transport, 100.0) == [0]
    transport.set_speed(0.1, 100.025)
    assert transport.next_due(100.025) == pytest.approx(100.025 + 0.25)
    transport.set_speed(10.0, 100.15)
    assert transport.next_due(100.15) == pytest.approx(100.15 + 0.00125)
    assert samples(transport, 100.15 + 0.00125 + 3 * 0.005 + 1e-6) == [1, 2, 3, 4]


@pytest.mark.parametrize("speed", [0.0, 0.099, 10.1, -1.0, np.nan, np.inf])
def test_speed_outside_its_range_is_refused(speed: float) -> None:
    with pytest.raises(TransportError, match=r"between 0\.1 and 10"):
        playing().set_speed(speed, 100.0)


def test_pause_holds_and_play_goes_on_one_interval_later() -> None:
    transport = playing()
    assert samples(transport, 100.1) == [0, 1, 2]
    transport.pause()
    assert samples(transport, 150.0) == []
    assert transport.next_due(150.0) is None
    transport.play(150.0)
    assert samples(transport, 150.04) == []
    assert samples(transport, 150.05 + 1e-9) == [3]


def test_seek_flies_the_sample_at_once_and_restarts() -> None:
    transport = playing()
    assert samples(transport, 100.0) == [0]
    transport.seek(1.0, 100.01)
    assert list(transport.due_samples(100.01)) == [Due(20, 100.01, True)]
    (due,) = transport.due_samples(100.06 + 1e-9)
    assert (due.sample, due.restarts) == (21, False)
    assert due.due == pytest.approx(100.06)
    transport.pause()
    transport.seek(0.51, 110.0)
    assert list(transport.due_samples(110.0)) == [Due(11, 110.0, True)]
    assert not transport.playing
    transport.seek(1e9, 111.0)
    assert samples(transport, 111.0) == [40]
    transport.seek(-5.0, 112.0)
    assert samples(transport, 112.0) == [0]


@given(st.integers(0, 40))
def test_seek_to_the_time_of_a_sample_finds_that_sample(k: int) -> None:
    transport = playing()
    transport.seek(float(T[k]), 100.0)
    assert samples(transport, 100.0) == [k]


def test_step_pauses_and_flies_the_next_samples_without_a_restart() -> None:
    transport = playing()
    assert samples(transport, 100.0) == [0]
    transport.step(1, 100.01)
    transport.step(2, 100.01)
    assert list(transport.due_samples(100.01)) == [Due(k, 100.01, False) for k in (1, 2, 3)]
    assert not transport.playing
    transport.step(-2, 100.02)
    assert list(transport.due_samples(100.02)) == [Due(1, 100.02, True)]
    for n in (0, BURST + 1):
        with pytest.raises(TransportError, match="give 1 to"):
            transport.step(n, 100.0)


def test_at_the_end_it_pauses_and_plays_again_from_the_start() -> None:
    transport = playing()
    transport.seek(1.95, 100.0)
    assert samples(transport, 100.05 + 1e-9) == [39, 40]
    assert transport.playing
    assert samples(transport, 100.11) == []
    assert not transport.playing
    assert transport.at_end
    transport.play(200.0)
    assert list(transport.due_samples(200.0)) == [Due(0, 200.0, True)]


def test_a_loop_goes_round_without_a_pause_or_drift() -> None:
    transport = playing(loop=True)
    flown: list[Due] = []
    for k in range(500):
        flown += transport.due_samples(100.0 + 0.013 * k)
    rounds = len(T)
    assert [due.sample for due in flown] == [k % rounds for k in range(len(flown))]
    assert [due.restarts for due in flown] == [k % rounds == 0 and k > 0 for k in range(len(flown))]
    np.testing.assert_allclose([d.due for d in flown], 100 + DT * np.arange(len(flown)), rtol=1e-12)
    assert len(flown) == int(0.013 * 499 / DT + 1e-9) + 1


def test_one_call_hands_out_a_bounded_burst() -> None:
    transport = Transport(times(5000, 1e-3), 1e-3)
    transport.play(0.0)
    assert samples(transport, 0.99) == list(range(BURST))
    assert transport.next_due(0.99) == pytest.approx(BURST * 1e-3)
    assert samples(transport, 0.99) == list(range(BURST, 991))


@pytest.mark.parametrize("t", [np.nan, np.inf])
def test_seek_to_no_time_is_refused(t: float) -> None:
    with pytest.raises(TransportError, match="give a time in seconds"):
        playing().seek(t, 100.0)
