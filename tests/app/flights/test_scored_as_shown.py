"""Scoring the recording of a live flight gives what the flight showed, sample by sample."""

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from app.assessment import ScoredRecording, ScoringRecipe, score
from app.assessment.batches import ChannelReader
from app.assessment.scorer import TrimRule
from app.flights.sources.live import LiveFlight, LiveSetup
from app.recordings.flown_journal import FlownJournal
from app.recordings.mapped_recording import MappedRecording
from app.telemetry.journal import Journals
from app.telemetry.reading import columns_of
from core.channels import KEYS
from core.monitor import Monitor
from tests.support.attas import TEST, fly
from tests.support.flying import ScriptedClock, SilentRecorder, plan
from tests.support.oscillator import Array

EPSILON, DT, NY = 0.1, TEST.dt, KEYS.index("Ny")


class Arrival(NamedTuple):
    """A sample and its arrival. arrived, t: [s].   y: (6,)."""

    arrived: float
    t: float
    y: Array


def in_order(t: Array, y: Array) -> Iterator[Arrival]:
    for when, sample in zip(t.tolist(), y, strict=True):
        yield Arrival(when, when, sample)


def with_gaps(t: Array, y: Array) -> Iterator[Arrival]:
    lost = (np.arange(len(t)) % 47 < 1) | ((t > 4.5) & (t < 4.9))
    yield from in_order(t[~lost], y[~lost])


def late_and_out_of_order(t: Array, y: Array) -> Iterator[Arrival]:
    late = np.random.default_rng(1).exponential(0.02, len(t))
    late[90] = 2.0
    for k in np.argsort(t + late, kind="stable").tolist():
        yield Arrival(float(t[k] + late[k]), float(t[k]), y[k])


def with_clock_steps(t: Array, y: Array) -> Iterator[Arrival]:
    for arrival in in_order(t, y):
        step = 1000.0 if 4.0 < arrival.t < 6.0 else -3.0 if arrival.t > 8.0 else 0.0
        yield arrival._replace(t=arrival.t + step)


def finer(t: Array, y: Array, rate: float) -> tuple[Array, Array]:
    fine = np.arange(0.0, t[-1], 1.0 / rate)
    return fine, np.column_stack([np.interp(fine, t, column) for column in y.T])


def five_times_faster(t: Array, y: Array) -> Iterator[Arrival]:
    yield from in_order(*finer(t, y, 5.0 / DT))


def a_little_slower(t: Array, y: Array) -> Iterator[Arrival]:
    yield from in_order(*finer(t, y, 0.87 / DT))


def with_a_change_of_rate(t: Array, y: Array) -> Iterator[Arrival]:
    fast_t, fast_y = finer(t, y, 4.0 / DT)
    yield from in_order(t[t < 4.0], y[t < 4.0])
    yield from in_order(fast_t[fast_t >= 4.0], fast_y[fast_t >= 4.0])


def with_a_missing_channel(t: Array, y: Array) -> Iterator[Arrival]:
    y = y.copy()
    y[100:110, 0] = np.nan
    yield from in_order(t, y)


def beyond(t: Array, y: Array, *parts: float) -> Iterator[Arrival]:
    """Two seconds of rest at each of these values of N_y, then the flight."""
    rest = y[: round(2.0 / DT)]
    parts_y = [rest + ny * (np.arange(6) == NY) for ny in parts]
    y = np.concatenate([*parts_y, y])
    yield from in_order(DT * np.arange(len(y), dtype=np.float64), y)


def after_a_steady_exceedance(t: Array, y: Array) -> Iterator[Arrival]:
    yield from beyond(t, y, 0.0, 0.8, 0.8)


def starting_beyond_the_limit(t: Array, y: Array) -> Iterator[Arrival]:
    yield from beyond(t, y, 0.8, 0.8)


def beyond_the_limit_throughout(t: Array, y: Array) -> Iterator[Arrival]:
    yield from beyond(t, y + 0.8 * (np.arange(6) == NY), 0.0, 0.8)


def to_the_other_side(t: Array, y: Array) -> Iterator[Arrival]:
    yield from in_order(t, -y)


def with_little_input(t: Array, y: Array) -> Iterator[Arrival]:
    yield from in_order(t, 0.2 * y)


Way = Callable[[Array, Array], Iterator[Arrival]]
WAYS: tuple[Way, ...] = (
    in_order,
    with_gaps,
    late_and_out_of_order,
    with_clock_steps,
    five_times_faster,
    a_little_slower,
    with_a_change_of_rate,
    with_a_missing_channel,
    after_a_steady_exceedance,
    starting_beyond_the_limit,
    beyond_the_limit_throughout,
    to_the_other_side,
    with_little_input,
)


def flown(
    monitor: Monitor,
    root: Path,
    arrivals: Iterator[Arrival],
    begun: float | None = None,
    trim: TrimRule = "detected",
) -> tuple[SilentRecorder, Path]:
    """Push arrivals as they are due; returns the record and the journal of the flight."""
    clock, journals = ScriptedClock(), Journals(root)
    recorder = SilentRecorder(clock)

    async def run() -> Path:
        setup = LiveSetup(monitor, EPSILON, ChannelReader(), journals, 0.0, trim=trim)
        order = plan(monitor)
        order.source["trim"] = trim
        flight = LiveFlight(order, setup, recorder, clock, lambda *_: None)
        flight.start()
        now = 0.0
        for arrived, t, y in arrivals:
            clock.advance(arrived - now)
            now = arrived
            if begun is not None and arrived >= begun > arrived - DT:
                flight.begin_manoeuvre("FTE")
            known = [None if np.isnan(value) else value for value in y.tolist()]
            flight.receive(json.dumps({"t": t, **dict(zip(KEYS, known, strict=True))}), "rest")
        clock.advance(1.0)
        await flight.stop("enough")
        journals.close()
        return journals.path(flight.id)

    return recorder, asyncio.run(run())


def scored(monitor: Monitor, journal: Path) -> ScoredRecording:
    with columns_of(journal) as columns:
        mapping = FlownJournal("f", journal, "flight").mapping_for(columns)
        recorded = MappedRecording.of(columns, mapping).scorable()
        return score(monitor, recorded, ScoringRecipe(epsilon=EPSILON))


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
@pytest.mark.parametrize("seed", [5, 6])
def test_a_scoring_of_a_flight_is_what_it_showed(
    attas: Monitor, tmp_path: Path, way: Way, seed: int
) -> None:
    y = fly(1, seed).y[0]
    t = DT * np.arange(len(y), dtype=np.float64)
    recorder, journal = flown(attas, tmp_path, way(t, y))
    check(attas, recorder, scored(attas, journal))


def test_a_scoring_tells_why_in_the_words_of_the_flight(attas: Monitor, tmp_path: Path) -> None:
    y = fly(1, 5).y[0]
    y[:, :3] *= 1.6
    recorder, journal = flown(attas, tmp_path, in_order(DT * np.arange(len(y), dtype=float), y))
    shown = [sample.assessment for sample in recorder.waiting(0, 100_000)]
    first = next(each for each in shown if each.state == "invalid")
    (manoeuvre,) = scored(attas, journal).manoeuvres
    assert "sigma" in first.reason
    assert manoeuvre.withdrawn_t == first.t
    assert (manoeuvre.withdrawn_reason, *manoeuvre.validity.reasons) == (first.reason,) * 2
    assert first.reason in manoeuvre.guarantee


def test_a_manoeuvre_begun_by_hand_is_scored_as_shown(attas: Monitor, tmp_path: Path) -> None:
    y = fly(1, 5).y[0]
    t = DT * np.arange(len(y), dtype=np.float64)
    recorder, journal = flown(attas, tmp_path, in_order(t, y), begun=2.0)
    again = scored(attas, journal)
    check(attas, recorder, again)
    assert again.samples["t"][again.samples["p_value"] >= 0.0][0] == pytest.approx(2.0)


def test_a_flight_from_trim_is_scored_as_one(attas: Monitor, tmp_path: Path) -> None:
    y = fly(1, 5).y[0]
    t = DT * np.arange(len(y), dtype=np.float64)
    recorder, journal = flown(attas, tmp_path, in_order(t, y), trim="none")
    again = scored(attas, journal)
    assert [one.name for one in again.manoeuvres] == ["entire recording"]
    shown = [one.assessment.p_value for one in recorder.waiting(0, 100_000)]
    known = [None if np.isnan(p) else p for p in again.samples["withdrawn"].tolist()]
    known = [q if np.isnan(p) else p for p, q in zip(again.samples["p_value"], known, strict=True)]
    assert all(p is None or p == q for p, q in zip(shown, known, strict=True))


def check(monitor: Monitor, recorder: SilentRecorder, again: ScoredRecording) -> None:
    """The shown samples and assessments are those of the scoring."""
    settled = recorder.waiting(0, 100_000)
    shown = [sample.assessment for sample in settled]
    samples = again.samples
    known = np.isin(samples["t"], [one.t for one in shown])
    assert samples["t"][known].tolist() == [one.t for one in shown]
    assert not np.isfinite(samples["y"][~known]).any()
    np.testing.assert_array_equal(samples["y"][known], [sample.y for sample in settled])
    for row, one in zip(np.flatnonzero(known).tolist(), shown, strict=True):
        assessed = float(samples["p_value"][row])
        assert assessed == one.p_value if one.p_value is not None else np.isnan(assessed)
        if one.p_value is not None and np.isfinite(samples["p_value"][row]):
            assert bool(samples["alert"][row]) == one.alert
