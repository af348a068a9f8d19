"""Withdrawal in flight: a monitor falls silent once the flight is not like those of training."""

import asyncio
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from app.flights.request import FlightRequest
from app.flights.sources.playback import AssessedTrack
from app.flights.sources.simulated import Track
from app.flights.sources.source import Simulated
from app.jobs.training import train_and_test
from app.messages import Frames, Hello, StateChange
from app.recipes.recipes import to_plain
from core.channels import KEYS
from core.monitor import Assessment, Monitor, MonitorRecipe, State, load
from core.monitor.status import Level
from core.monitor.validity.support import LEVEL
from core.planned_test.collection import DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator
from tests.app.flights.test_flights import Hangar
from tests.core.monitor.validity.test_rates import (
    WRONG_SENSORS,
    amplitude,
    flown_as,
    jumbo,
    recipe_of,
)
from tests.core.monitor.validity.test_verdict import supported
from tests.support import oscillator
from tests.support.flying import EPSILON, Flown, T, exact_monitor, failing_flight, track
from tests.support.oscillator import DT, N_SAMPLES, NY, Array

PLANNED = recipe_of("f16")
DELTA_A = KEYS.index("delta_a")


@cache
def checked() -> Monitor:
    """The oscillator's monitor, its validity calibrated."""
    return supported(oscillator.collect(np.random.default_rng(11), n_unsafe=12))


@cache
def planned() -> Monitor:
    """A fighter's monitor for a rudder doublet, its validity calibrated."""
    dataset = collect(PLANNED)
    return train_and_test(dataset, MonitorRecipe(), 0, lambda *_: None).monitor


def rollouts(recipe: DatasetRecipe, n: int) -> tuple[Array, npt.NDArray[np.bool_]]:
    """y (n, n_samples, 6) and whether each flight failed."""
    flights = LateralSimulator(recipe).rollouts(n, np.random.default_rng(8))
    return flights.y, flights.is_unsafe


def everything_said(script: AssessedTrack) -> list[Assessment]:
    return [script.assessment(k) for k in range(len(script.t))]


def assert_silent_from(said: list[Assessment], first: int) -> None:
    for k, one in enumerate(said):
        if k >= first:
            assert one.state is State.INVALID
            assert one.p_value is one.alert is one.y_hat is None
            assert one.reason == said[first].reason
        else:
            assert one.state is State.OK


# --- how often, and why --------------------------------------------------------------------------

WRONG: dict[str, Callable[[], Array]] = {
    "another aircraft": lambda: rollouts(jumbo(PLANNED), 40)[0],
    "the rudder doubled": lambda: rollouts(
        flown_as(PLANNED, amplitude_deg=2 * amplitude(PLANNED)), 40
    )[0],
    "degrees taken for radians": lambda: WRONG_SENSORS["degrees taken for radians"](
        rollouts(PLANNED, 40)[0]
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_flight_of_another_kind_falls_silent_for_good_and_names_the_channel(wrong: str) -> None:
    n_silent = 0
    flights = WRONG[wrong]()
    for y in flights:
        script = AssessedTrack(track(y, PLANNED.dt), planned(), EPSILON)
        said = everything_said(script)
        states = [one.state for one in said]
        if State.INVALID not in states:
            continue
        n_silent += 1
        first = states.index(State.INVALID)
        assert_silent_from(said, first)
        assert set(re.findall(r"\w+", said[first].reason)) & set(KEYS)
        assert script.next_alert(first - 1) is None
    print(f"{wrong}: {n_silent} of {len(flights)} fell silent")
    assert n_silent >= 0.9 * len(flights)


def test_of_flights_like_those_of_training_few_fall_silent() -> None:
    """At most the level of either kind, by more than three standard errors."""
    flights, is_unsafe = rollouts(PLANNED, 1_200)
    t = np.arange(flights.shape[1]) * PLANNED.dt
    fell = [planned().assess(t, y).withdrawal is not None for y in flights]
    for name, kind in (("safe", ~is_unsafe), ("failing", is_unsafe)):
        share, error = np.mean(np.array(fell)[kind]), np.sqrt(LEVEL / kind.sum())
        print(f"{name}: {share:.4f} of {kind.sum()} fell silent")
        assert share <= LEVEL + 3 * error


# --- the one rule, live and of a track -----------------------------------------------------------


def strange(y: Array, first: int) -> Array:
    """The same flight with an aileron that jumps; no limit is reached by that."""
    y = y.copy()
    y[first:, DELTA_A] += 2.0
    return y


def quiet_flight() -> Array:
    """A flight that keeps its limits and does not stray."""
    for y in oscillator.fly(np.random.default_rng(5), 20)[1]:
        if np.abs(y[:, NY]).max() < 0.3:
            return y
    raise AssertionError("no flight is quiet")


def broken(y: Array) -> tuple[Array, Array]:
    """The same flight with missing samples and a gap of a second."""
    t, y = T.copy(), y.copy()
    t[40:] += 1.0
    y[[10, 22], 0] = np.nan
    return t, y


FLIGHTS: dict[str, Callable[[], tuple[Array, Array]]] = {
    "quiet": lambda: (T, quiet_flight()),
    "failing": lambda: (T, failing_flight()),
    "strange": lambda: (T, strange(quiet_flight(), 25)),
    "strange after a gap": lambda: broken(strange(quiet_flight(), 45)),
    "strange before a gap": lambda: broken(strange(quiet_flight(), 30)),
    "strange at once": lambda: (T, strange(quiet_flight(), 0)),
}


@pytest.mark.parametrize("flight", FLIGHTS)
@pytest.mark.parametrize("monitor", [checked, exact_monitor])
def test_live_says_of_each_sample_what_the_track_says(
    monitor: Callable[[], Monitor], flight: str
) -> None:
    t, y = FLIGHTS[flight]()
    script = AssessedTrack(Track(t, y, DT), monitor(), EPSILON)
    stream = monitor().stream(EPSILON)
    said = [stream.update(*sample) for sample in zip(t, y, strict=True)]
    for one, expected in zip(said, everything_said(script), strict=True):
        for name in ("t", "p_value", "alert", "state", "reason"):
            assert getattr(one, name) == getattr(expected, name)
        np.testing.assert_array_equal(one.y_hat, expected.y_hat)
    silent = monitor() is checked() and flight.startswith("strange")
    assert ("nearest safe training sample" in said[-1].reason) == silent


def test_a_monitor_that_is_not_calibrated_says_all_it_ever_said() -> None:
    y = strange(quiet_flight(), 0)
    said = exact_monitor().assess(T, y, EPSILON)
    script = AssessedTrack(track(y), exact_monitor(), EPSILON)
    assert [one.p_value for one in everything_said(script)] == said.p_value.tolist()
    assert not script.is_checked
    assert AssessedTrack(track(y), checked(), EPSILON).is_checked


def test_a_flight_that_broke_a_limit_is_not_called_invalid_for_what_follows() -> None:
    y = strange(quiet_flight(), 30)
    assert_silent_from(everything_said(AssessedTrack(track(y), checked(), EPSILON)), 30)
    flights = oscillator.fly(np.random.default_rng(5), 20)[1]
    fails = oscillator.fail_indices(flights)
    y, exceeding = next((y, at) for y, at in zip(flights, fails, strict=True) if at < N_SAMPLES - 1)
    assert checked().assess(T, y).withdrawal is None
    y = strange(y, exceeding + 1)
    assert checked().assess(T, y).withdrawal is None


def test_a_violation_counts_itself_and_a_missing_value_is_none() -> None:
    y = quiet_flight()
    y[20, NY] = 40.0
    found = checked().assess(T, y).withdrawal
    assert found is not None
    assert found.first == 20
    y = strange(quiet_flight(), 30)
    y[10, NY], y[12, NY] = np.nan, np.inf
    found = checked().assess(T, y).withdrawal
    assert found is not None
    assert found.first == 30


def test_neither_a_gap_nor_a_new_history_takes_it_back() -> None:
    stream, y = checked().stream(EPSILON), quiet_flight()
    y[0, DELTA_A] = 2.0
    t = T + np.where(np.arange(N_SAMPLES) > 20, 100.0, 0.0)
    said = [stream.update(*sample) for sample in zip(t, y, strict=True)]
    assert_silent_from(said, 0)
    assert "at 0.00 s" in said[0].reason


# --- what everyone is told -----------------------------------------------------------------------


def alerted_then_strange() -> tuple[Array, int]:
    """A flight that is alerted on and strays afterwards, before its limit; and where it strays."""
    for y in oscillator.fly(np.random.default_rng(12), 300)[1]:
        said = checked().assess(T, y, EPSILON)
        past = np.abs(y[:, NY]) >= 0.5
        if not past.any() or checked().assess(T, y).withdrawal is not None:
            continue
        if said.alert.any() and said.alert.argmax() + 2 < past.argmax():
            return strange(y, int(said.alert.argmax()) + 2), int(said.alert.argmax()) + 2
    raise AssertionError("no flight is alerted on in time")


def test_a_warning_raised_before_stays_and_only_an_exceedance_raises_one_after() -> None:
    y, first = alerted_then_strange()
    flown = Flown(checked(), y).start()
    flown.advance(N_SAMPLES * DT)
    exceeding = int(np.argmax(np.abs(y[:, NY]) >= 0.5))
    raised = [message["alarm"] for message in flown.seen.of("alarm")]
    assert [(alarm["kind"], alarm["seq"]) for alarm in raised] == [
        ("risk", first - 2),
        ("invalid", first),
        ("limit", exceeding),
    ]
    assert [alarm["level"] for alarm in raised] == ["warning", "caution", "warning"]
    assert "off its forecast" in raised[1]["reason"]
    assert flown.flight.alarms.n_open(Level.WARNING) == 2
    assert [frame["alert"] for frame in flown.seen.frames[first - 2 :]] == [
        True,
        flown.seen.frames[first - 1]["alert"],
        *[None] * (N_SAMPLES - first),
    ]


def test_the_page_is_told_once_with_the_reason_and_at_each_frame() -> None:
    flown = Flown(checked(), strange(quiet_flight(), 25)).start()
    flown.advance(N_SAMPLES * DT)
    assert Hello.model_validate(flown.seen.messages[0]).validity == "checked"
    told = [StateChange.model_validate(message) for message in flown.seen.of("state")]
    assert [one.state for one in told] == ["ok", "invalid"]
    assert "off its forecast" in told[-1].reason
    for message in flown.seen.of("frames"):
        Frames.model_validate(message)
    assert [frame["state"] for frame in flown.seen.frames] == ["ok"] * 25 + ["invalid"] * 36
    assert {frame["reason"] for frame in flown.seen.frames[25:]} == {told[-1].reason}
    unchecked = Flown(exact_monitor(), quiet_flight())
    assert unchecked.seen.messages[0]["validity"] == "not calibrated"


def test_neither_seek_nor_loop_changes_what_is_said_of_a_sample() -> None:
    y = strange(quiet_flight(), 25)
    script = AssessedTrack(track(y), checked(), EPSILON)
    flown = Flown(checked(), y).start()
    flown.flight.act("loop", True)
    for t in (2.0, 1.2, 0.3, 2.9):
        flown.flight.act("seek", t)
        flown.advance(1.0)
    assert len(flown.seen.frames) > 70
    for frame in flown.seen.frames:
        said = script.assessment(int(np.searchsorted(T, frame["t"])))
        assert (frame["state"], frame["reason"]) == (said.state, said.reason)
        assert (frame["p_value"], frame["alert"]) == (said.p_value, said.alert)


def test_the_record_keeps_the_reason(tmp_path: Path) -> None:
    async def fly() -> None:
        hangar = Hangar(tmp_path)
        monitor = hangar.store.monitors.add(planned(), "F-16").id
        doubled = flown_as(PLANNED, amplitude_deg=2 * amplitude(PLANNED))
        source = Simulated(kind="simulated", recipe=to_plain(doubled))
        async with hangar.flights as flights:
            flight = await flights.start(
                FlightRequest(source=source, monitor=monitor, epsilon=EPSILON)
            )
            hangar.clock.advance(2.0)
            flown = await flights.records.frames(flight.id, 0, 1000)
            await flights.stop(flight.id)
            stored = await flights.records.frames(flight.id, 0, 1000)
        told = [(frame["state"], frame["reason"]) for frame in flown]
        assert told == [(frame["state"], frame["reason"]) for frame in stored]
        assert "in forecast delta_r" in told[-1][1]

    asyncio.run(fly())


def test_a_monitor_loaded_from_its_file_withdraws_at_the_same_sample(tmp_path: Path) -> None:
    checked().save(tmp_path / "monitor.fwm")
    again, bare = load(tmp_path / "monitor.fwm"), replace(checked(), support=None)
    y = strange(quiet_flight(), 25)
    found = [m.assess(T, y).withdrawal for m in (checked(), again, bare)]
    assert found[0] == found[1] != found[2] is None
