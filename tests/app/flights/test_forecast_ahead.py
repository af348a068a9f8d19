"""The rest of a test card on a flight: what the stream forecasts, small, and only if known."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.flights.display_monitors import no_rest
from app.flights.flight import UNWATCHED_AHEAD_S
from app.flights.shown_flight import ShownFlight
from app.flights.sources import playback
from app.flights.sources.playback import AssessedTrack
from app.flights.sources.recorded_playback import RecordedScript
from app.flights.sources.simulated import Track, times
from app.messages import MOST_AHEAD, CardAhead, plain_frame
from core.monitor import Monitor, MonitorRecipe, State, combine, train
from core.monitor.assessment import STATES
from core.monitor.peak_forecast import ForecastAhead, PeakAhead
from core.monitor.status import Status
from core.types import Array
from tests.app.flights.sources import test_live
from tests.app.flights.sources.test_live import Live
from tests.core.monitor.test_peak_ridge import trained as peak_trained
from tests.core.monitor.test_response_filter import flights, trained
from tests.support import oscillator
from tests.support.flying import EPSILON, Flown, Seen, exact_monitor, track
from tests.support.samples import SAMPLE_LIKE


def of_the_stream(monitor: Monitor, y: Array, k: int) -> ForecastAhead:
    stream = monitor.stream()
    for at in range(k + 1):
        stream.update(at * monitor.dt, y[at])
    ahead = stream.forecast_ahead()
    assert isinstance(ahead, ForecastAhead)
    return ahead


def test_a_track_forecasts_what_its_stream_does_wherever_it_is_sought():
    monitor, y = trained(), flights()[0]
    script = AssessedTrack(Track(times(len(y), monitor.dt), y, monitor.dt), monitor, 0.1)
    for k in (40, 44, 20, 21, 60):
        ahead, expected = script.forecast_ahead(k), of_the_stream(monitor, y, k)
        assert isinstance(ahead, ForecastAhead)
        assert ahead.made_t == script.t[k]
        assert np.array_equal(ahead.mean, expected.mean)
        assert np.array_equal(ahead.deviation, expected.deviation)


def test_after_a_far_seek_nothing_is_told_until_the_forecast_has_followed(monkeypatch):
    monkeypatch.setattr(playback, "MOST_FOLLOWED", 25)
    monitor, y = trained(), flights()[0]
    script = AssessedTrack(Track(times(len(y), monitor.dt), y, monitor.dt), monitor, 0.1)
    assert script.forecast_ahead(40) is None
    ahead = script.forecast_ahead(40)
    assert ahead is not None
    assert ahead.made_t == script.t[40]


def test_a_frame_tells_the_peak_alone_where_that_is_forecast():
    monitor, y = peak_trained(), flights()[0]
    script = AssessedTrack(Track(times(len(y), monitor.dt), y, monitor.dt), monitor, 0.1)
    ahead = script.forecast_ahead(40)
    assert isinstance(ahead, PeakAhead)
    frame = plain_frame(40, y[40], script.assessment(40), None, ahead=ahead)
    told = CardAhead.model_validate(frame["ahead"])
    assert (told.t, told.channels) == ([], {})
    assert told.peak is not None
    assert told.peak.low < told.peak.mean == round(ahead.mean, 4) < told.peak.high


def test_a_frame_tells_the_rest_of_the_card_in_few_samples_or_not_at_all():
    monitor, y = trained(), flights()[0]
    ahead = of_the_stream(monitor, y, 30)
    assessment = monitor.assess(times(len(y), monitor.dt), y)[30]
    told = CardAhead.model_validate(plain_frame(30, y[30], assessment, None, ahead=ahead)["ahead"])
    (channel,) = told.channels.values()
    assert list(told.channels) == ["Ny"]
    assert len(told.t) == len(channel.low) == len(channel.high) == MOST_AHEAD
    assert told.t[-1] == round(float(ahead.t[-1]), 4)
    assert (channel.predicted, channel.possible) == (ahead.predicted(3), ahead.possible(3))
    assert "ahead" not in plain_frame(30, y[30], assessment, None)


def combination() -> Monitor:
    """One rule of two monitors."""
    dataset = oscillator.collect(np.random.default_rng(11), n_unsafe=12)
    pair = [train(dataset, MonitorRecipe(t_early=lead)) for lead in (0.25, 0.5)]
    y = oscillator.fly(np.random.default_rng(21), 40)[1]
    return combine(pair, (y, oscillator.fail_indices(y)), lead=0.5, epsilon=EPSILON)


def flown_through(monitor: Monitor, y: Array) -> Flown:
    """A flight of 0.05 s samples that someone watches."""
    flown = Flown(monitor, y)
    flown.flight.act("pause")
    return flown


def times_told(flown: Flown) -> list[float]:
    flown.seen.take()
    return [frame["t"] for frame in flown.seen.frames if "ahead" in frame]


def test_the_rest_is_told_a_tenth_of_a_second_apart_and_by_the_first_sample_after_a_seek():
    monitor, y = peak_trained(), flights()[0]
    flown = flown_through(monitor, y)
    flown.flight.act("seek", 1.0)
    for _ in range(6):
        flown.flight.act("step", 1)
    assert times_told(flown) == pytest.approx([1.0, 1.1, 1.2, 1.3])
    flown.flight.act("seek", 0.95)
    flown.flight.act("step", 1)
    assert times_told(flown)[4:] == pytest.approx([0.95])


def test_the_rest_is_forecast_less_often_while_no_one_watches(monkeypatch: pytest.MonkeyPatch):
    flown = flown_through(peak_trained(), flights()[0])
    asked: list[int] = []
    monkeypatch.setattr(AssessedTrack, "forecast_ahead", lambda _, k: asked.append(k))
    flown.flight.act("seek", 1.0)
    assert len(asked) == 1
    flown.flight.leave(flown.seen.watcher)
    forecast = PeakAhead(2.0, 0.5, 0.1)
    monkeypatch.setattr(
        AssessedTrack, "forecast_ahead", lambda _, k: [asked.append(k), forecast][1]
    )
    flown.flight.act("seek", 2.0)
    n_steps = round(UNWATCHED_AHEAD_S / flown.flight.dt)
    for _ in range(n_steps - 1):
        flown.flight.act("step", 1)
    assert len(asked) == 2
    flown.flight.act("step", 1)
    assert len(asked) == 3


def test_nothing_is_told_of_the_rest_by_a_sample_that_was_not_assessed_or_is_not_of_now():
    monitor, y = peak_trained(), flights()[0].copy()
    y[40] = np.nan
    flown = flown_through(monitor, y)
    flown.flight.act("seek", 40 * monitor.dt)
    assert times_told(flown) == []
    flown.flight._script.late = lambda k: "it came late"
    flown.flight.act("seek", 1.0)
    assert times_told(flown) == []


def test_the_last_sample_says_that_nothing_is_left_however_short_ago_the_rest_was_told():
    monitor, y = peak_trained(), flights()[0]
    flown = flown_through(monitor, y)
    last = len(y) - 1
    flown.flight.act("seek", (last - 1) * monitor.dt)
    flown.flight.act("step", 1)
    flown.seen.take()
    before, end = (frame["ahead"] for frame in flown.seen.frames[-2:])
    assert before["peak"]["mean"] > 0
    assert end == {"t": [], "channels": {}, "why": "the test card is complete"}


@pytest.mark.parametrize(
    ("monitor", "words"),
    [
        (exact_monitor, "the predictor “linear, by least squares” makes none"),
        (peak_trained, ""),
        (combination, "not available for a combination"),
    ],
    ids=["linear", "peaks", "combination"],
)
def test_a_flight_says_why_its_monitor_never_forecasts_the_rest(
    monitor: Callable[[], Monitor], words: str
):
    assert Flown(monitor(), np.zeros((61, 6))).seen.messages[0]["no_rest"].startswith(words)
    assert bool(no_rest(monitor())) == bool(words)


def test_a_scored_recording_forecasts_what_the_stream_did_of_each_manoeuvre():
    monitor, first, second = peak_trained(), *flights()[:2]
    n, between = len(first), 7
    samples = np.zeros(2 * n + between, SAMPLE_LIKE)
    samples["t"] = 3358.0 + times(len(samples), monitor.dt)
    samples["manoeuvre"] = [0] * n + [-1] * between + [1] * n
    samples["y"][:n], samples["y"][-n:] = first, second
    samples["p_value"] = 0.5
    samples["state"][10] = STATES.index(State.INVALID)  # its limits were others, or not known
    about = {"alerts": [], "exceedance": None, "validity": {"valid": True, "reasons": []}}
    manoeuvres = [about | {"first": begin} for begin in (0, n + between)]
    script = RecordedScript(samples, manoeuvres, monitor.dt, forecasts=False, monitor=monitor)
    for k in (40, 44, n + between + 40, 20):
        y, at = (first, k) if k < n else (second, k - n - between)
        stream = monitor.stream()
        for i in range(at + 1):
            stream.update(i * monitor.dt, y[i])
        ahead, expected = script.forecast_ahead(k), stream.forecast_ahead()
        assert isinstance(ahead, PeakAhead)
        assert isinstance(expected, PeakAhead)
        assert (ahead.made_t, ahead.mean) == (script.t[k], expected.mean)
    assert script.forecast_ahead(n + 3) is None
    assert (
        RecordedScript(samples, manoeuvres, monitor.dt, forecasts=False).forecast_ahead(40) is None
    )


@pytest.mark.parametrize("trim", ["none", "detected"])
def test_a_live_flight_again_forecasts_what_it_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trim: str
):
    monitor, y = replace(peak_trained(), dataset_recipe={}), flights()[0]
    monkeypatch.setattr(test_live, "exact_monitor", lambda: monitor)

    async def fly() -> Live:
        live = Live(tmp_path, trim=trim)
        for k, sample in enumerate(y):
            if k == 12 and trim == "detected":
                live.flight.begin_manoeuvre("FTE")
            live.push(0, sample, sequence=k, t=k * monitor.dt)
        await live.close()
        return live

    live = asyncio.run(fly())
    script = ShownFlight(live.setup, live.flight.id)
    told = {frame["seq"]: frame["ahead"] for frame in live.seen.frames if "ahead" in frame}
    again = {
        k: plain_frame(k, y[0], script.assessment(k), None, ahead=ahead)["ahead"]
        for k in told
        if (ahead := script.forecast_ahead(k))
    }
    assert again == told
    assert sum("peak" in one for one in told.values()) > 10


def test_a_flight_is_not_ok_while_its_forecast_exceeds_a_limit(monkeypatch: pytest.MonkeyPatch):
    flown = flown_through(peak_trained(), flights()[0])
    flight, script = flown.flight, flown.flight._script

    def seek(t: float, peak: float) -> tuple[Status, ...]:
        monkeypatch.setattr(
            AssessedTrack, "forecast_ahead", lambda _, k: PeakAhead(float(script.t[k]), peak, 0.1)
        )
        flight.act("seek", t)
        return flight.headline.status, *flight.headline.beside

    assert seek(1.0, 0.99) == (Status.PAUSED,)
    assert seek(1.2, 1.0) == (Status.PAUSED, Status.NO_ALERT)
    assert Seen(flight.watch()).take()[0]["beside"] == ["no_alert"]
    flight.act("play")
    assert flight.headline.status is Status.NO_ALERT
    flight.act("step", 1)
    assert flight.headline.beside == (Status.NO_ALERT,)  # until the next forecast
    for watcher in [*flight._watchers]:
        flight.leave(watcher)
    assert seek(2.0, 0.99) == (Status.PAUSED,)
    assert seek(3.0, 1.0) == (Status.PAUSED, Status.NO_ALERT)  # also where no one watches
    script.late = lambda k: "it came late"
    flight.act("step", 1)
    assert not flight.facts.predicted


def test_who_joins_a_paused_flight_is_told_the_rest_by_its_newest_sample():
    monitor, y = peak_trained(), flights()[0]
    flown = flown_through(monitor, y)
    assert Seen(flown.flight.watch()).take()[0]["ahead"] is None  # nothing has come
    flown.flight.leave(flown.seen.watcher)
    for t, key in ((1.0, "peak"), ((len(y) - 1) * monitor.dt, "why")):
        flown.flight.act("seek", t)
        ahead = Seen(flown.flight.watch()).take()[0]["ahead"]
        assert ahead[key]
    expected = AssessedTrack(track(y, monitor.dt), monitor, EPSILON).forecast_ahead(20)
    assert isinstance(expected, PeakAhead)
    flown.flight.act("seek", 1.0)
    told = Seen(flown.flight.watch()).take()[0]["ahead"]
    assert told["peak"]["mean"] == round(expected.mean, 4)
