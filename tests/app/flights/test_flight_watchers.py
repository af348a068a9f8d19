"""What a flight's watchers and its scene are told, whatever becomes of them."""

import numpy as np
import pytest

from app.flights.flight import HEARTBEAT_S, stale_after
from app.flights.sources.simulated import Track
from app.flights.transport import NotPossible
from app.messages import Frames, Hello
from core.dataset import Dataset
from core.monitor import Monitor, MonitorRecipe, State, train
from core.monitor.status import Facts
from tests.support.flying import (
    EPSILON,
    Flown,
    Seen,
    T,
)
from tests.support.oscillator import DT, N_SAMPLES, Array


def test_hello_says_what_a_display_needs(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing)
    hello = Hello.model_validate(flown.seen.messages[0])
    assert [(c.key, c.limit) for c in hello.channels][3] == ("Ny", 0.5)
    assert (hello.epsilon, hello.n_unsafe, hello.lead, hello.dt) == (EPSILON, 12, 0.25, DT)
    assert (hello.duration, hello.head, hello.state) == (T[-1], -1, State.NO_DATA)
    assert hello.transport == flown.flight.transport
    assert hello.stale_after == 0.25
    assert stale_after(0.2) == pytest.approx(0.6)


def test_messages_of_frames_are_as_described(exact: Monitor, failing: Array) -> None:
    y = failing.copy()
    y[3] = np.nan
    flown = Flown(exact, y).start()
    flown.advance(0.5)
    for message in flown.seen.of("frames"):
        Frames.model_validate(message)
    assert flown.seen.frames[3]["y"] == [None] * 6


def test_a_frozen_watcher_changes_nothing_for_the_others(exact: Monitor, failing: Array) -> None:
    alone, together = Flown(exact, failing), Flown(exact, failing)
    blocked, mute = together.flight.watch(), Seen(together.flight.watch())
    for flown in (alone, together):
        flown.start().flight.act("loop", True)
        for _ in range(100):
            flown.advance(0.1)
            mute.take(credit=False)
    assert together.seen.messages[1:] == alone.seen.messages[1:]
    assert len(blocked._waiting) < 20
    assert blocked.conflated > 0
    shown, flown_in_all = len(mute.frames), together.flight.head + 1
    waiting = flown_in_all - mute.watcher._next
    assert mute.watcher.conflated == flown_in_all - shown - waiting
    assert mute.watcher.conflated > 100


def test_a_heartbeat_is_encoded_once_for_all_who_were_sent_as_much(
    exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing)
    flight = flown.flight
    watchers = [flight.watch() for _ in range(2)]
    for watcher in watchers:
        watcher.next_message()  # hello
    flight._send_heartbeat()
    first, second = (watcher.next_message() for watcher in watchers)
    assert first is not None
    assert '"heartbeat"' in first
    assert first is second


def test_a_heartbeat_comes_each_second_even_while_paused(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing).start()
    flown.flight.act("pause")
    flown.advance(10 * HEARTBEAT_S + 0.5)
    assert len(flown.seen.of("heartbeat")) == pytest.approx(11, abs=1)
    flown.recorder.lost = 7
    flown.advance(HEARTBEAT_S)
    assert flown.seen.of("heartbeat")[-1]["lost"] == 7


def test_a_change_of_state_is_told_once(exact: Monitor, failing: Array) -> None:
    y = failing.copy()
    y[10:13, 0] = np.nan
    flown = Flown(exact, y).start()
    flown.advance(1.5)
    assert [message["state"] for message in flown.seen.of("state")] == [
        "ok",
        "invalid",
        "warming_up",
        "ok",
    ]


class Stage:
    """A scene that keeps what it is shown."""

    def __init__(self) -> None:
        self.shown: list[tuple] = []
        self.held = 0
        self.waits: list[float] = []

    def show(self, what: tuple) -> None:
        self.shown.append(what)

    def restate(self, facts: Facts) -> None:
        self.held += facts.paused

    def wait(self, stale_after_s: float) -> None:
        self.waits.append(stale_after_s)


def test_the_scene_is_shown_the_newest_pose_of_each_tick_only(
    exact: Monitor, failing: Array
) -> None:
    stage = Stage()
    flown = Flown(exact, failing, scene=stage).start()
    flown.flight.act("step", 20)
    t, attitude, beta, delta_a, delta_r, p_value, epsilon, *_ = stage.shown[-1]
    assert len(stage.shown) == 2
    assert (t, beta, delta_a, delta_r) == (T[20], *failing[20, [0, 4, 5]])
    assert (p_value, epsilon) == (exact.assess(T, failing).p_value[20], EPSILON)
    assert attitude == tuple(Track(T, failing, DT).attitude[20])
    assert stage.held == 1


def test_the_scene_waits_longer_while_samples_come_slowly(exact: Monitor, failing: Array) -> None:
    stage = Stage()
    flown = Flown(exact, failing, scene=stage).start()
    for speed in (0.1, 0.5, 1.0, 10.0):
        flown.flight.act("speed", speed)
    assert stage.waits == [pytest.approx(3 * DT / 0.1), pytest.approx(3 * DT / 0.5), 0.25, 0.25]


def test_a_flight_goes_on_without_a_scene_that_fails(
    exact: Monitor, failing: Array, caplog: pytest.LogCaptureFixture
) -> None:
    flown = Flown(exact, failing, scene=object()).start()
    flown.advance(N_SAMPLES * DT)
    assert len(flown.seen.frames) == N_SAMPLES
    assert caplog.text.count("continues without its scene") == 1


def test_a_flight_that_fails_is_over_and_says_so(
    exact: Monitor, failing: Array, caplog: pytest.LogCaptureFixture
) -> None:
    flown = Flown(exact, failing).start()
    flown.flight._script = None  # pyright: ignore[reportAttributeAccessIssue]
    flown.advance(0.5)
    ((status, _),) = flown.over
    assert status == "failed"
    assert flown.seen.messages[-1]["type"] == "end"
    assert "TypeError" in caplog.text or "AttributeError" in caplog.text
    with pytest.raises(NotPossible, match="start another one"):
        flown.flight.act("play")


def test_a_monitor_without_forecasts_flies_too(dataset: Dataset, failing: Array) -> None:
    from core.monitor.predictor import PREDICTORS

    monitor = train(dataset, MonitorRecipe(predictor=PREDICTORS["pca"]))
    flown = Flown(monitor, failing).start()
    flown.advance(0.5)
    assert {str(frame["y_hat"]) for frame in flown.seen.frames} == {"None"}
    assert all(frame["p_value"] for frame in flown.seen.frames)
