"""Monitors for display: each says what it says alone, and one monitor alone raises alarms."""

import asyncio
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from app.assessment.grid import Sample
from app.assessment.scorer import CausalScorer, TrimRule
from app.flights.display_monitors import DisplayMonitor, check_alike
from app.flights.flights import Flights
from app.flights.request import FlightRequest
from app.flights.sources.live import LiveFlight
from app.flights.sources.simulated import SourceError
from app.store.repository import InUse
from app.store.store import open_store
from app.telemetry.journal import Journals
from core.monitor import Assessment, Monitor, MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect
from tests.support import oscillator
from tests.support.flying import ScriptedClock, T, exact_monitor, failing_flight
from tests.support.live_server import assessed_again
from tests.support.oscillator import N_SAMPLES

LEADS = (0.5, 0.75)
SIMULATED = DatasetRecipe(n_unsafe=12, n_obs=10, seed=3)


@cache
def longer(t_early: float, n_delay: int = 1) -> Monitor:
    """A monitor of the oscillator that looks further ahead, over another history."""
    dataset = oscillator.collect(np.random.default_rng(11), n_unsafe=12)
    return train(dataset, MonitorRecipe(t_early=t_early, n_delay=n_delay, epsilon=0.2))


@cache
def simulated(t_early: float) -> Monitor:
    return train(collect(SIMULATED), MonitorRecipe(t_early=t_early, epsilon=0.3))


def said(assessment: Assessment) -> tuple[Any, ...]:
    return assessment.p_value, assessment.alert, assessment.state, assessment.reason


@pytest.mark.parametrize("trim", ["none", "detected"])
def test_each_says_of_a_live_source_what_it_says_alone(trim: TrimRule) -> None:
    rng, y = np.random.default_rng(5), failing_flight().copy()
    monitors = [(exact_monitor(), 0.3), *((longer(t), 0.2) for t in LEADS)]
    if trim == "detected":
        y = collect(SIMULATED).safe[0].copy()
        monitors = [(simulated(t), 0.3) for t in (0.25, *LEADS)]
    n, dt = len(y), monitors[0][0].dt
    y[-21, 0], y[-25] = np.nan, np.nan
    together = CausalScorer(*monitors[0], None, trim, monitors[1:])
    alone = [CausalScorer(monitor, epsilon, None, trim) for monitor, epsilon in monitors]
    arrival, n_ok = 0.0, 0
    for step, k in enumerate(np.argsort(np.arange(n) + rng.uniform(0, 2, n))):
        arrival += float(rng.exponential(dt))
        sample = Sample(float(k * dt), y[k])
        if step == 10:
            assert {scorer.begin() for scorer in (together, *alone)} == {trim == "detected"}
        shown = together.push(arrival, sample) + together.advance(arrival)
        of_each = [one.push(arrival, sample) + one.advance(arrival) for one in alone]
        for one, *others in zip(shown, *of_each, strict=True):
            expected = [said(other.assessment) for other in others]
            assert [said(a) for a in (one.assessment, *one.display)] == expected
            n_ok += all(value[0] is not None for value in expected)
    assert n_ok > 10


def test_a_sample_may_wait_less_than_the_shortest_lead() -> None:
    with pytest.raises(ValueError, match=r"lead of 0\.1 s"):
        CausalScorer(exact_monitor(), 0.3, 0.1, "none", [(longer(0.1), 0.2)])


def test_several_monitors_are_no_alarm_authority() -> None:
    source = {"kind": "simulated"}
    with pytest.raises(ValidationError, match="no calibrated miss rate"):
        FlightRequest.model_validate({"source": source, "monitor": ["a", "b"]})
    for monitors in (["a"], ["b", "b"]):
        with pytest.raises(ValidationError, match="given twice"):
            FlightRequest.model_validate({"source": source, "monitor": "a", "monitors": monitors})


def test_monitors_of_one_flight_are_of_one_test() -> None:
    own = simulated(0.25)
    plain = own.dataset_recipe
    for change, words in (
        ({"dt": 2 * own.dt}, "sample interval"),
        ({"dataset_recipe": plain | {"aircraft": {"type": "other"}}}, "another aircraft"),
        ({"dataset_recipe": plain | {"maneuver": {"type": "other"}}}, "another manoeuvre"),
    ):
        with pytest.raises(SourceError, match=words):
            check_alike(own, [DisplayMonitor("m", "other", replace(own, **change), 0.3)])
    check_alike(own, [DisplayMonitor("m", "longer", simulated(0.5), 0.3)])


def test_what_is_shown_is_recorded_and_only_the_authority_alarms(tmp_path: Path) -> None:
    async def run() -> None:
        store = open_store(tmp_path / "store.db")
        ids = [store.monitors.add(simulated(t), f"{t} s ahead").id for t in (0.25, *LEADS)]
        clock = ScriptedClock()
        async with Flights(store, clock=clock) as flights:
            source = {"kind": "simulated", "outcome": "unsafe", "seed": 4}
            asked = {"source": source, "monitor": ids[0], "monitors": ids[1:]}
            flight = await flights.start(FlightRequest.model_validate(asked))
            assert [one.id for one in flight.monitors] == ids
            assert [one.authority for one in flight.monitors] == [True, False, False]
            assert [one.lead for one in flight.monitors] == [0.25, 0.5, 0.75]
            clock.advance(3.0)
            waiting = await flights.records.frames(flight.id, 0, 1000)
            clock.advance(9.0)
            await flights.stop(flight.id)
            frames = await flights.records.frames(flight.id, 0, 1000)
            assert [f["display"] for f in frames[: len(waiting)]] == [f["display"] for f in waiting]
            y = np.array([frame["y"] for frame in frames])
            t = np.array([frame["t"] for frame in frames])
            for m, lead in enumerate(LEADS):
                alone = simulated(lead).assess(t, y)
                shown = [frame["display"][m] for frame in frames]
                assert [one["p_value"] for one in shown] == alone.columns()["p_value"]
                assert [one["alert"] for one in shown] == alone.columns()["alert"]
                assert [one["reason"] for one in shown] == alone.columns()["reason"]
            own = simulated(0.25).assess(t, y)
            risks = [a for a in await flights.records.alarms(flight.id) if a.kind == "risk"]
            first = t[own.alert.argmax()]
            assert risks[0].t == first
            assert any(frame["display"][1]["alert"] for frame in frames if frame["t"] < first)
            assert [user[0] for user in _users(store, ids[1])] == ["ended flight"]

    asyncio.run(run())


def _users(store: Any, monitor_id: str) -> list[tuple[str, str]]:
    with pytest.raises(InUse) as refusal:
        store.monitors.delete(monitor_id)
    return [*refusal.value.users]


def test_a_live_flight_goes_on_with_its_monitors_and_is_replayed_with_them(tmp_path: Path) -> None:
    async def run() -> None:
        store = open_store(tmp_path / "store.db")
        monitors = exact_monitor(), longer(0.5)
        ids = [store.monitors.add(monitor, "oscillator").id for monitor in monitors]
        clock, y = ScriptedClock(), failing_flight()
        keys = "beta", "p", "r", "Ny", "delta_a", "delta_r"

        def flights() -> Flights:
            return Flights(store, clock=clock, journals=Journals(tmp_path / "live"))

        def push(flight: LiveFlight, k: int) -> Any:
            clock.advance(0.05)
            sample = dict(zip(keys, y[k].tolist(), strict=True))
            return flight.receive(json.dumps({"t": T[k], **sample}), "rest")

        async with flights() as first:
            source = {"kind": "live", "trim": "none"}
            asked = {"source": source, "monitor": ids[0], "monitors": ids[1:]}
            flight = await first.start(FlightRequest.model_validate(asked))
            assert isinstance(flight, LiveFlight)
            for k in range(25):
                await push(flight, k).stored
        async with flights() as second:
            again = await second.live(flight.id)
            for k in range(25, N_SAMPLES):
                await push(again, k).stored
            await second.stop(flight.id)
            frames = await second.records.frames(flight.id, 0, 1000)
            expected = monitors[1].assess(T, y).columns()
            shown = [frame["display"][0] for frame in frames]
            assert [one["p_value"] for one in shown] == expected["p_value"]
            replayed = {"kind": "journal", "flight_id": flight.id}
            asked = {"source": replayed, "monitor": ids[0], "monitors": ids[1:]}
            replay = await second.start(FlightRequest.model_validate(asked))
            source_frames = replay.source_frames(0, N_SAMPLES)
            assert [frame["display"][0] for frame in source_frames] == shown
            assert len(assessed_again(again._setup, flight.id)[0].display) == 1

    asyncio.run(run())
