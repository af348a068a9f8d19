"""A live flight again from its journal: the bits that were shown, when they were shown."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.flights.shown_flight import ShownFlight
from app.flights.sources.replay import TrackFlight
from app.flights.sources.simulated import SourceError
from app.store.assessments import StoredAssessments, pack
from core.monitor import train
from core.monitor.assessment import CAUSES, code_of
from core.types import Array
from tests.app.flights.sources import test_live
from tests.app.flights.sources.test_live import Live, batch
from tests.support import oscillator
from tests.support.flying import (
    EPSILON,
    ScriptedClock,
    Seen,
    SilentRecorder,
    T,
    exact_monitor,
    failing_flight,
    plan,
)
from tests.support.oscillator import DT, N_SAMPLES
from tests.support.shown_record import is_as_shown

Network = Callable[[Live, Array], None]


def shuffled(live: Live, y: Array) -> None:
    """Out of order, late, and some twice."""
    rng = np.random.default_rng(3)
    for k in np.argsort(np.arange(N_SAMPLES) + rng.exponential(1.5, N_SAMPLES)):
        live.advance(float(rng.exponential(DT)))
        live.flight.receive(batch(int(k), y[k]), "rest")
        if rng.random() < 0.2:
            live.flight.receive(batch(int(k), y[k], sequence=1000 + int(k)), "rest")
        live.seen.take()


def with_gaps(live: Live, y: Array) -> None:
    """Single samples and a second are missing; what waits is settled by the clock."""
    for k in range(N_SAMPLES):
        live.advance(DT)
        if k % 7 != 3 and not 20 <= k < 40:
            live.flight.receive(batch(k, y[k]), "rest")
        live.seen.take()


def stepped(live: Live, y: Array) -> None:
    """The source's clock is set back an hour half-way."""
    for k in range(N_SAMPLES):
        live.push(k, y[k], t=T[k] - (3600.0 if k >= N_SAMPLES // 2 else 0.0))


def marked(live: Live, y: Array) -> None:
    """A manoeuvre is begun by hand while a sample waits for the one before it."""
    for k in range(N_SAMPLES):
        if k == 12:
            continue
        live.advance(DT if k != 13 else 0.3 * DT)
        live.flight.receive(batch(k, y[k]), "rest")
        if k == 13:
            live.flight.begin_manoeuvre("FTE")
        live.seen.take()


def stored(live: Live) -> StoredAssessments:
    """What the recorder was given, as the store would have it."""
    samples = live.recorder.waiting(0, 10_000)
    said = [one.assessment for one in samples]
    missing = np.full(6, np.nan)
    packed = pack(
        [one.t for one in said],
        [one.y for one in samples],
        [np.nan if one.p_value is None else one.p_value for one in said],
        [bool(one.alert) for one in said],
        [code_of(one.state) for one in said],
        [missing if one.y_hat is None else one.y_hat for one in said],
        [CAUSES.index(one.cause) for one in said],
        [one.manoeuvre for one in samples],
    )
    names = packed.dtype.names or ()
    fields: dict[str, Any] = {name: np.ascontiguousarray(packed[name]) for name in names}
    seq = np.array([one.seq for one in samples])
    return StoredAssessments(seq=seq, reasons=tuple(one.reason for one in said), **fields)


def flown(network: Network, root: Path, trim: str = "none") -> tuple[Live, StoredAssessments]:
    async def fly() -> Live:
        live = Live(root, trim=trim)
        network(live, failing_flight())
        live.advance(1.0)
        await live.close()
        return live

    live = asyncio.run(fly())
    return live, stored(live)


@pytest.mark.parametrize(
    ("network", "trim"),
    [(shuffled, "none"), (with_gaps, "none"), (stepped, "none"), (marked, "detected")],
)
def test_the_journal_gives_the_bits_that_were_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, network: Network, trim: str
) -> None:
    of_any_test = replace(exact_monitor(), dataset_recipe={})
    monkeypatch.setattr(test_live, "exact_monitor", lambda: of_any_test)
    live, record = flown(network, tmp_path, trim)
    again = ShownFlight(live.setup, live.flight.id)
    assert len(again.t) == len(record) > N_SAMPLES // 2
    assert np.isfinite(record.p_value).any()
    assert is_as_shown(again, record)
    record.p_value[np.isfinite(record.p_value).argmax()] *= 1.0 + 1e-15
    assert not is_as_shown(again, record)


def test_what_the_clock_settled_before_a_kill_is_there_too(tmp_path: Path) -> None:
    live, record = flown(with_gaps, tmp_path)
    path = live.setup.journals.path(live.flight.id)
    lines = path.read_bytes().splitlines(keepends=True)
    waiting = next(k for k, line in enumerate(lines) if b'"s":53,' in line)  # for 52
    path.write_bytes(b"".join(lines[: waiting + 1]))
    again = ShownFlight(live.setup, live.flight.id)
    assert again.samples["t"][-1] == T[53]
    assert again.samples["t"].tolist() == record.t[: len(again.t)].tolist()


def test_another_monitor_says_what_it_would_have_by_what_had_come(tmp_path: Path) -> None:
    live, record = flown(with_gaps, tmp_path)
    other = train(oscillator.collect(np.random.default_rng(5), n_unsafe=12))
    again = ShownFlight(live.setup._replace(monitor=other), live.flight.id)
    assert again.samples["t"].tolist() == record.t.tolist()
    assert not is_as_shown(again, record)


def test_what_was_never_shown_is_no_flight(tmp_path: Path) -> None:
    async def fly() -> Live:
        live = Live(tmp_path)
        await live.close()
        return live

    live = asyncio.run(fly())
    with pytest.raises(SourceError, match="has no assessed sample"):
        ShownFlight(live.setup, live.flight.id)


def test_a_replay_has_the_delays_and_is_stale_where_the_source_was(tmp_path: Path) -> None:
    live, _ = flown(with_gaps, tmp_path)
    script = ShownFlight(live.setup, live.flight.id)
    clock, over = ScriptedClock(), []
    recorder = SilentRecorder(clock)
    about = recorder, clock, lambda *how: over.append(how)
    flight = TrackFlight(plan(exact_monitor(), epsilon=EPSILON), script, *about)
    seen = Seen(flight.watch())
    seen.take()
    hellos = seen.messages[0], live.seen.messages[0]
    leads = [(hello["lead"], hello["monitors"][0]["lead"]) for hello in hellos]
    assert leads[0] == leads[1] == pytest.approx((exact_monitor().lead - 1.5 * DT,) * 2)
    flight.start()
    for _ in range(1000):
        clock.advance(0.01)
        seen.take()
    assert [f["p_value"] for f in seen.frames] == [f["p_value"] for f in live.seen.frames]
    sent, came = (
        np.array([frame["sent"] for frame in frames]) for frames in (seen.frames, live.seen.frames)
    )
    np.testing.assert_allclose(np.diff(sent), np.diff(came), atol=1e-6)
    states = [(m["state"], m["reason"]) for m in seen.of("state")]
    shown = [(m["state"], m["reason"]) for m in live.seen.of("state")]
    assert states == shown[: len(states)]
    assert [state for state, _ in states].count("stale") == 1


def test_samples_that_came_late_are_not_of_now_in_the_replay_either(tmp_path: Path) -> None:
    def late(live: Live, y: Array) -> None:
        for k in range(20):
            live.push(k, y[k])
        live.advance(5.0)
        live.push(20, y[20])

    live, _ = flown(late, tmp_path)
    script = ShownFlight(live.setup, live.flight.id)
    late_reason = f"samples come more than {live.flight.lead:g} s late"
    assert [script.late(k) for k in (19, 20)] == ["", late_reason]
    assert script.t[20] - script.t[19] == pytest.approx(5.0 + DT)
    assert script.stale_after(19) == pytest.approx(0.25)
    assert script.stale_after(5) is None
