"""A live flight on a scripted clock, the record of it, and the scoring of its journal."""

import asyncio
import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from app.assessment import ScoredRecording, ScoringRecipe, score
from app.assessment.limits_history import SetHistory
from app.flights.ended import Record, records
from app.flights.flights import Flights
from app.flights.request import FlightRequest
from app.recordings.flown_journal import FlownJournal
from app.recordings.mapped_recording import MappedRecording
from app.recordings.scored import set_in_use
from app.store.store import open_store
from app.telemetry.journal import Journals
from app.telemetry.reading import columns_of
from core.channels import KEYS
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.monitor_set import MonitorCase, MonitorSet
from core.planned_test.collection import DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator
from core.types import Array
from tests.support.flying import ScriptedClock

RECIPE = DatasetRecipe(n_unsafe=12, n_obs=10, seed=3)
DT, NY, LEAD_IN_S = RECIPE.dt, KEYS.index("Ny"), 3.0


@cache
def slow_monitor() -> Monitor:
    return train(collect(RECIPE), MonitorRecipe(epsilon=0.3))


@cache
def fast_monitor() -> Monitor:
    return train(collect(replace(RECIPE, seed=4)), MonitorRecipe(epsilon=0.2))


@cache
def doublets(*, fail: bool) -> list[Array]:
    """Doublets after three seconds of rest; failing ones end a little after their exceedance."""
    longer = replace(RECIPE.maneuver, lead_in_s=LEAD_IN_S, duration_s=9.0)
    simulator = LateralSimulator(replace(RECIPE, maneuver=longer))
    flights = simulator.rollouts(80, np.random.default_rng(1))
    pairs = zip(flights.y, flights.fail_index, flights.is_unsafe, strict=True)
    return [y[: k + 8] if fail else y for y, k, is_unsafe in pairs if is_unsafe == fail]


class Arrival(NamedTuple):
    """A sample and when it arrives. arrived, t: [s].   y: (6,).   mach: None if not sent."""

    arrived: float
    t: float
    y: Array
    mach: float | None = None


def in_order(y: Array, mach: Sequence[float] | None = None) -> list[Arrival]:
    sent = [None] * len(y) if mach is None else mach
    return [Arrival(k * DT, k * DT, *each) for k, each in enumerate(zip(y, sent, strict=True))]


class FlownAndScored(NamedTuple):
    """A flight, its record, the scoring of its recording, and the record of its replay, if any."""

    record: Record
    scored: ScoredRecording
    replayed: Record | None = None


def flown_and_scored(
    root: Path,
    arrivals: Sequence[Arrival],
    *,
    by_set: bool = False,
    trim: str = "detected",
    calls: Sequence[float] = (),
    monitor: Monitor | None = None,
    replay: bool = False,
) -> FlownAndScored:
    """calls: times of ABORT [s].   monitor: the slow one unless given.   replay: as shown."""
    flown_by = monitor or slow_monitor()
    root.mkdir(exist_ok=True)
    store, clock, journals = open_store(root / "store.db"), ScriptedClock(), Journals(root / "live")
    known = {"slow": flown_by, "fast": fast_monitor()}
    ids = {name: store.monitors.add(monitor, name).id for name, monitor in known.items()}
    ends: dict[str, Any] = {"slow": (None, 0.8), "fast": (0.8, 1.2)}
    info = store.monitors.info
    cases = [MonitorCase(name, {"mach": ends[name]}, info(ids[name])) for name in ids]
    set_id = store.monitor_sets.add("doublet", MonitorSet(tuple(cases)), "Ann").id
    by = {"monitor_set": set_id} if by_set else {"monitor": ids["slow"]}

    async def fly() -> list[str]:
        async with Flights(store, clock=clock, journals=journals) as flights:
            request = {"source": {"kind": "live", "trim": trim}} | by
            flight: Any = await flights.start(FlightRequest.model_validate(request), "Ann")
            now, waiting = 0.0, sorted(calls)
            receipts: list[Any] = []
            for arrived, t, y, mach in arrivals:
                clock.advance(max(arrived - now, 0.0))
                now = max(arrived, now)
                values = [None if np.isnan(value) else value for value in y.tolist()]
                sent = {"t": t, **dict(zip(KEYS, values, strict=True))}
                sent |= {} if mach is None else {"mach": mach}
                receipts.append(flight.receive(json.dumps(sent), "rest"))
                if len(receipts) % 10 == 0:
                    await receipts[-1].stored
                while waiting and waiting[0] <= t:
                    await flights.mark(flight.id, "abort", "Ann", None, waiting.pop(0))
            for receipt in receipts:
                await receipt.stored
            clock.advance(0.2)
            await flights.stop(flight.id)
            if not replay:
                return [flight.id]
            source = {"source": {"kind": "journal", "flight_id": flight.id}} | by
            again: Any = await flights.start(FlightRequest.model_validate(source), "Ann")
            for _ in range(round(again.duration / DT) + 10):
                clock.advance(DT)
            await flights.stop(again.id)
        return [flight.id, again.id]

    flight, *again = asyncio.run(fly())
    record, *replayed = (
        records(store, [store.flights.info(each)])[each] for each in (flight, *again)
    )
    with columns_of(journals.path(flight)) as columns:
        mapping = FlownJournal(flight, journals.path(flight), "flight").mapping_for(columns)
        recorded = MappedRecording.of(columns, mapping).scorable()
        history = None
        if by_set:
            in_use = set_in_use(store, store.monitor_sets.info(set_id), {})
            history = SetHistory.of(columns, mapping, in_use)
        scored = score(flown_by, recorded, ScoringRecipe(), history)
    store.close()
    return FlownAndScored(record, scored, *replayed)
