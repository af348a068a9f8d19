"""A scored recording as a flight: what was scored is what is played, and nothing else."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from app.assessment import sample_type
from app.flights.sources.recorded_playback import RecordedScript
from app.flights.sources.replay import TrackFlight
from app.flights.transport import NotPossible
from app.recordings.files import Verified
from app.recordings.samples import digest, open_samples, save_samples
from core.channels import KEYS
from core.limits.limits import Limits
from core.monitor import State
from core.monitor.assessment import REASONS, STATES
from core.monitor.status import BETWEEN
from core.simulation.attitude import attitude
from tests.support.flying import ScriptedClock, Seen, SilentRecorder, exact_monitor, plan
from tests.support.samples import SAMPLE_LIKE

DT, N, NY = 0.05, 200, KEYS.index("Ny")
INVALID, WARMING_UP = STATES.index(State.INVALID), STATES.index(State.WARMING_UP)


@pytest.fixture
def samples() -> npt.NDArray:
    """Two manoeuvres of 80 samples with 20 between; the second one is not valid."""
    rng = np.random.default_rng(5)
    samples = np.zeros(N, SAMPLE_LIKE)
    samples["t"] = 3358.0 + DT * np.arange(N)
    samples["y"] = 0.1 * rng.standard_normal((N, 6))
    samples["y_hat"] = 0.1 * rng.standard_normal((N, 6))
    samples["p_value"], samples["withdrawn"] = rng.uniform(size=N), np.nan
    samples["manoeuvre"] = [0] * 80 + [-1] * 20 + [1] * 80 + [-1] * 20
    samples["state"][samples["manoeuvre"] != 0] = INVALID
    samples["state"][0] = WARMING_UP
    samples["p_value"][samples["state"] != 0] = np.nan
    samples["alert"][[30, 31, 60]] = True
    samples["attitude"] = np.nan
    return samples


MANOEUVRES: list[dict[str, Any]] = [
    {
        "outcome": "timely_alert",
        "lead": 0.52,
        "alerts": [[3359.5, 3359.55], [3361.0, 3361.0]],
        "exceedance": {"t": 3360.02, "channel": "Ny", "value": 0.6},
        "validity": {"valid": True, "reasons": []},
    },
    {
        "alerts": [],
        "exceedance": None,
        "validity": {"valid": False, "reasons": ["p was off by 9 sigma", "too fast"]},
    },
]


def script(samples: npt.NDArray) -> RecordedScript:
    return RecordedScript(samples, MANOEUVRES, DT, forecasts=True)


def test_each_sample_is_said_as_it_was_scored(samples: npt.NDArray) -> None:
    played = script(samples)
    for k in range(N):
        said = played.assessment(k)
        assert said.t == samples["t"][k]
        assert said.state is STATES[samples["state"][k]]
        if said.state is State.OK:
            assert (said.p_value, said.alert) == (samples["p_value"][k], samples["alert"][k])
            np.testing.assert_array_equal(said.y_hat, samples["y_hat"][k])
        else:
            assert said.p_value is said.alert is said.y_hat is None
        np.testing.assert_array_equal(played.y(k), samples["y"][k])


def test_it_says_why_it_says_nothing(samples: npt.NDArray) -> None:
    played = script(samples)
    assert played.assessment(0).reason == REASONS[WARMING_UP]
    assert played.assessment(90).reason == BETWEEN
    assert played.assessment(120).reason == "p was off by 9 sigma; too fast"
    then = {**MANOEUVRES[1], "withdrawn_t": 3364.0, "withdrawn_reason": "p was off by 5 sigma"}
    played = RecordedScript(samples, [MANOEUVRES[0], then], DT, forecasts=True)
    assert played.assessment(120).reason == "p was off by 5 sigma"


def test_it_is_checked_where_every_manoeuvre_has_a_verdict(samples: npt.NDArray) -> None:
    assert script(samples).is_checked
    unknown = {**MANOEUVRES[0], "validity": {"valid": None, "reasons": ["not calibrated"]}}
    assert not RecordedScript(samples, [unknown, MANOEUVRES[1]], DT, forecasts=True).is_checked


def test_alerts_are_found_one_after_the_other(samples: npt.NDArray) -> None:
    played = script(samples)
    assert [played.next_alert(-1), played.next_alert(30), played.next_alert(60)] == [30, 60, None]
    assert played.fail_t == 3360.02
    assert played.duration == pytest.approx(DT * (N - 1))


def test_a_recorded_attitude_is_shown_and_a_missing_angle_integrated(samples: npt.NDArray) -> None:
    samples["attitude"][:, :2] = 0.2, 0.1
    integrated = attitude(samples["t"], samples["y"])
    played = script(samples)
    for k in [0, 1, 2, 50, 51, 7, 199]:
        assert played.attitude(k) == pytest.approx((0.2, 0.1, integrated[k, 2]))


def test_a_recording_flies_with_the_transport_of_any_flight(samples: npt.NDArray) -> None:
    clock = ScriptedClock()
    recorder = SilentRecorder(clock)
    flight = TrackFlight(plan(exact_monitor()), script(samples), recorder, clock, lambda *how: None)
    seen = Seen(flight.watch())
    flight.start()
    for _ in range(100):
        clock.advance(0.01)
        seen.take()
    flight.act("next_alert")
    flight.act("seek", 3364.0)
    with pytest.raises(NotPossible, match="no alert after"):
        flight.act("next_alert")
    seen.take()
    frames = seen.frames
    assert [frame["t"] for frame in frames[:20]] == samples["t"][:20].tolist()
    assert frames[-1]["t"] == pytest.approx(3364.0)
    assert frames[-1]["reason"].startswith("p was off")
    raised = [message["alarm"] for message in seen.of("alarm")]
    kinds = [(alarm["kind"], round(alarm["t"], 3)) for alarm in raised]
    passed = [("limit", 3360.02), ("risk", 3361.0)]
    assert kinds == [("risk", 3359.5), *passed, ("invalid", 3363.0)]
    assert flight.verdict is not None
    assert flight.verdict.warning == "Warned 0.52 s before the limit"  # as it was scored


def test_a_recorded_exceedance_between_two_samples_is_known_before_the_grid_shows_it(
    samples: npt.NDArray,
) -> None:
    samples["y"] = 0.0
    limits = Limits(Ny=0.5).envelope
    outside = [{"t": 3367.5, "channel": "Ny", "value": -0.7}]
    played = RecordedScript(samples, MANOEUVRES, DT, forecasts=True, outside=outside)
    found = {k: over for k in range(N) if (over := played.exceeded(k, limits)) is not None}
    assert {
        k: (each.t, each.measured.channel, each.measured.value) for k, each in found.items()
    } == {
        39: (3360.02, "Ny", 0.6),
        189: (3367.5, "Ny", -0.7),
    }
    assert samples["t"][40] < 3360.02 <= samples["t"][41]
    assert {each.measured.judged for each in found.values()} == {"both"}
    assert {each.measured.limit for each in found.values()} == {0.5}
    with_trim = {**MANOEUVRES[0], "first": 0, "trim": [0.0, 0.0, 0.0, -0.2, 0.0, 0.0]}
    manoeuvres = [with_trim, {**MANOEUVRES[1], "first": 100}]
    from_trim = RecordedScript(samples, manoeuvres, DT, forecasts=True).exceeded(39, limits)
    assert from_trim is not None
    assert (from_trim.measured.value, from_trim.measured.judged) == (0.6, "from_trim")


def test_a_replay_raises_the_alarm_of_an_exceedance_between_two_samples(
    samples: npt.NDArray,
) -> None:
    samples["y"] = 0.0
    clock = ScriptedClock()
    flight = TrackFlight(
        plan(exact_monitor()), script(samples), SilentRecorder(clock), clock, lambda *how: None
    )
    seen = Seen(flight.watch())
    flight.start()
    for _ in range(300):
        clock.advance(0.01)
        seen.take()
    raised = [message["alarm"] for message in seen.of("alarm")]
    (alarm,) = (alarm for alarm in raised if alarm["kind"] == "limit")
    assert alarm["t"] == 3360.02
    assert alarm["exceedance"]["value"] == 0.6


def test_a_replay_shows_the_worst_value_that_the_sensor_gave(samples: npt.NDArray) -> None:
    """Between two samples of the grid, in a manoeuvre and outside every one."""
    samples["y"] = 0.0
    about = {"channel": "Ny", "limit": None, "doubt": ""}
    inside = {**MANOEUVRES[0], "worst": [{"t": 3360.13, "value": 0.93, **about}]}
    outside = [{"t": 3367.5, "value": -0.7, "worst_t": 3367.53, "worst": -1.4, **about}]
    clock = ScriptedClock()
    monitor = exact_monitor()
    for known, worst, t in ((outside, -1.4, 3367.53), ([], 0.93, 3360.13)):
        played = RecordedScript(
            samples, [inside, MANOEUVRES[1]], DT, forecasts=True, outside=known, monitor=monitor
        )
        about_flight = plan(monitor), played, SilentRecorder(clock), clock, lambda *how: None
        flight = TrackFlight(*about_flight)
        flight.start()
        for _ in range(1200):
            clock.advance(0.01)
        (of_channel,) = flight.exceedances.of_channels
        assert (of_channel.worst, of_channel.worst_t) == (worst, t)


def test_values_as_recorded_count_from_the_trim_stored_with_each_sample() -> None:
    samples = np.zeros(N, sample_type(6))
    samples["t"] = DT * np.arange(N)
    samples["trim"][100:, NY] = 0.3
    samples["trim"][150:, NY] = np.nan
    manoeuvres = [
        {**MANOEUVRES[0], "first": 0, "trim": [0.0] * 6, "alerts": [], "exceedance": None}
    ]
    played = RecordedScript(samples, manoeuvres, DT, forecasts=True, biases=[0.0, 0, 0, 0.1, 0, 0])
    assert [played.recorded(k)[NY] for k in (99, 100, 150)] == pytest.approx([0.1, 0.4, 0.1])
    assert [np.isnan(played.judged(k)[NY]) for k in (99, 100, 150)] == [False, False, True]
    assert played.exceeding(Limits(Ny=0.35).envelope).tolist() == [100]


def test_samples_of_earlier_versions_count_from_the_trim_of_the_manoeuvre_before(
    tmp_path: Path,
) -> None:
    newest = sample_type(6)
    stored = np.zeros(N, np.dtype(newest.descr[:-1]))
    stored["t"] = DT * np.arange(N)
    save_samples(tmp_path, "old", stored)
    opened = open_samples(tmp_path, "old", digest(stored), Verified())
    np.testing.assert_array_equal(opened, stored)
    trims = [{"first": 50, "trim": [0.0, 0, 0, 0.2, 0, 0]}, {"first": 120, "trim": [None] * 6}]
    manoeuvres = [MANOEUVRES[1] | each for each in trims]
    played = RecordedScript(opened, manoeuvres, DT, forecasts=True)
    assert [played.recorded(k)[NY] for k in (0, 119, 120)] == pytest.approx([0.2, 0.2, 0.0])
    assert np.isnan(played.judged(120)).all()
