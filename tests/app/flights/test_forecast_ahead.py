"""The rest of a test card on a flight: what the stream forecasts, small, and only if known."""

import numpy as np

from app.flights.sources import playback
from app.flights.sources.playback import AssessedTrack
from app.flights.sources.track import Track, times
from app.messages import MOST_AHEAD, CardAhead, plain_frame
from core.monitor import Monitor
from core.monitor.peak_forecast import ForecastAhead, PeakAhead
from core.types import Array
from tests.core.monitor.test_peak_ridge import trained as peak_trained
from tests.core.monitor.test_response_filter import flights, trained


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
