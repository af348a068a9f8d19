"""Flights: the scores of the batch whatever the transport does, at their own rate, to everyone."""

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.flights.sources.replay import LEFT_S, VIEWER_S, WAITING
from app.flights.transport import CATCH_UP_S, NotPossible, TransportError
from core.monitor import Monitor, State
from core.monitor.status import Level
from core.simulation.attitude import attitude
from tests.support.flying import (
    EPSILON,
    Call,
    Flown,
    ScriptedClock,
    Seen,
    T,
    exact_monitor,
    failing_flight,
)
from tests.support.oscillator import DT, N_SAMPLES, NY, Array
from tests.support.repetition import examples


def assert_batch(flown: Flown, monitor: Monitor, y: Array, epsilon: float = EPSILON) -> None:
    """Every frame that came is the batch's assessment of the sample at its time, bit for bit."""
    said = monitor.assess(T, y, epsilon)
    for frame in flown.seen.frames:
        k = int(np.searchsorted(T, frame["t"]))
        assert frame["t"] == T[k]
        assert frame["y"] == [None if np.isnan(value) else value for value in y[k]]
        assert frame["state"] == list(State)[said.state[k]]
        if frame["state"] == "ok":
            assert frame["p_value"] == said.p_value[k]
            assert frame["alert"] == said.alert[k]
            assert frame["y_hat"] == said.y_hat[k].tolist()
        else:
            assert frame["p_value"] is frame["alert"] is frame["y_hat"] is None


def test_frames_are_the_stream_and_the_batch_bit_for_bit(exact: Monitor, failing: Array) -> None:
    y = failing.copy()
    y[25, 3] = np.nan
    flown = Flown(exact, y).start()
    flown.advance(N_SAMPLES * DT + 0.1)
    stream = exact.stream(EPSILON)
    expected = [stream.update(*sample) for sample in zip(T, y, strict=True)]
    assert len(flown.seen.frames) == N_SAMPLES
    for frame, said in zip(flown.seen.frames, expected, strict=True):
        assert (frame["p_value"], frame["alert"]) == (said.p_value, said.alert)
        assert (frame["state"], frame["reason"]) == (said.state, said.reason)
    assert {frame["state"] for frame in flown.seen.frames} == {"ok", "invalid", "warming_up"}
    assert_batch(flown, exact, y)


ACTIONS = st.one_of(
    st.tuples(st.just("seek"), st.floats(-1, 4)),
    st.tuples(st.just("step"), st.sampled_from([-7, -1, 1, 2, 9, None])),
    st.tuples(st.just("speed"), st.floats(0.1, 10)),
    st.tuples(st.just("loop"), st.booleans()),
    st.tuples(st.sampled_from(["play", "pause", "next_alert"]), st.none()),
)


@settings(max_examples=examples(25))
@given(actions=st.lists(st.tuples(ACTIONS, st.floats(0, 0.5)), min_size=1, max_size=15))
def test_no_action_changes_a_score_or_loses_a_sample(
    actions: list[tuple[tuple[str, Any], float]],
) -> None:
    exact, failing = exact_monitor(), failing_flight()
    flown = Flown(exact, failing).start()
    flown.flight.act("play")
    for (action, value), wait in actions:
        try:
            flown.flight.act(action, value)
        except NotPossible:
            assert action == "next_alert"
        flown.seen.take()
        flown.advance(wait, tick=0.05)
    flown.seen.take()
    assert flown.over == []
    assert_batch(flown, exact, failing)
    seqs = [frame["seq"] for frame in flown.seen.frames]
    assert seqs == list(range(flown.flight.head + 1))
    recorded = flown.recorder.waiting(0, 10**9)
    assert [sample.seq for sample in recorded] == seqs
    assert [sample.assessment.p_value for sample in recorded] == [
        f["p_value"] for f in flown.seen.frames
    ]


def test_frames_that_do_not_follow_each_other_are_told_apart_by_a_reset(
    exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing).start()
    flown.flight.act("loop", True)
    flown.advance(1.0)
    flown.flight.act("seek", 2.0)
    flown.advance(2.0)
    follows, resets, last = None, 0, None
    for message in flown.seen.messages:
        if message["type"] == "reset":
            follows, resets, last = message, resets + 1, None
        for frame in message.get("frames", []):
            if follows is not None:
                assert (frame["seq"], frame["t"]) == (follows["seq"], follows["t"])
            elif last is not None:
                assert frame["t"] == pytest.approx(last + DT)
            follows, last = None, frame["t"]
    assert resets == 2


def test_the_flight_keeps_its_rate_and_stamps_when_each_sample_was_due(
    exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing).start()
    flown.flight.act("speed", 2.0)
    assert len(flown.seen.frames) == 1
    flown.advance(1.0, tick=0.001)
    assert len(flown.seen.frames) == pytest.approx(1 + 2 / DT, abs=1)
    sent = np.array([frame["sent"] for frame in flown.seen.frames[1:]])
    np.testing.assert_allclose(np.diff(sent), 1e3 * DT / 2, atol=2e-3)


class HastyClock(ScriptedClock):
    """Makes its calls up to a millisecond early, as loops do that round to milliseconds."""

    def call_at(self, when: float, call: Callable[[], object]) -> Call:
        return super().call_at(when - 0.001 if when - self.time > 0.002 else when, call)


def test_a_timer_that_comes_early_delays_no_sample(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing, clock=HastyClock()).start()
    came: list[float] = []
    for _ in range(1000):
        flown.clock.advance(0.001)
        n = len(flown.seen.frames)
        flown.seen.take()
        came += [flown.clock.time] * (len(flown.seen.frames) - n)
    due = np.array([frame["sent"] for frame in flown.seen.frames[1:]]) / 1e3
    assert len(came) == len(due) == 20
    assert (np.array(came) - due < 0.002).all()


def test_samples_due_within_a_tick_come_as_one_message(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing).start()
    flown.flight.act("speed", 10.0)
    flown.advance(0.2, tick=0.001)
    assert len(flown.seen.frames) == pytest.approx(40, abs=4)
    assert len(flown.seen.of("frames")) < 16


def test_a_machine_that_slept_makes_the_flight_slip_and_say_so(
    exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing).start()
    flown.clock.freeze(CATCH_UP_S + 30)
    flown.advance(0.01)
    assert len(flown.seen.frames) == 2
    slipped = flown.seen.of("transport")[-1]["transport"]["slipped"]
    assert slipped == pytest.approx(CATCH_UP_S + 30 - DT, abs=0.02)
    flown.advance(1.0)
    assert [frame["seq"] for frame in flown.seen.frames] == list(range(flown.flight.head + 1))
    assert_batch(flown, exact, failing)


def test_at_its_end_a_flight_pauses_and_can_be_sought(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing).start()
    flown.advance(N_SAMPLES * DT + 0.1)
    transport = flown.seen.of("transport")[-1]["transport"]
    assert (transport["playing"], transport["sample"]) == (False, N_SAMPLES - 1)
    assert transport["position"] == transport["duration"] == T[-1]
    assert flown.over == []
    flown.flight.act("seek", 1.0)
    flown.seen.take()
    assert flown.seen.frames[-1]["t"] == 1.0
    flown.advance(1.0)
    assert flown.seen.frames[-1]["t"] == 1.0


def acknowledge_all(flown: Flown) -> None:
    for alarm in flown.flight.alarms.at_hand:
        flown.flight.acknowledge(alarm.id, "FTE", "now")


def test_left_at_its_end_a_flight_is_over_by_itself(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing).start()
    flown.advance(N_SAMPLES * DT + 0.1)
    assert flown.flight.alarms.n_open(Level.WARNING)
    flown.clock.advance(2 * LEFT_S)
    assert flown.over == []  # someone watches an alarm that waits
    acknowledge_all(flown)
    flown.clock.advance(LEFT_S / 2)
    flown.flight.act("seek", 1.0)
    flown.clock.advance(2 * LEFT_S)
    assert flown.over == []  # paused before its end
    flown.flight.act("seek", T[-1])
    acknowledge_all(flown)
    flown.clock.advance(LEFT_S - 1.0)
    assert flown.over == []
    flown.clock.advance(1.0)
    said = "the flight was ended by the server after 10 minutes at its end without a command"
    assert flown.over == [("ended", said)]
    flown.seen.take()
    assert flown.seen.messages[-1] == {"type": "end", "reason": said}


def test_an_alarm_that_nobody_watches_keeps_no_flight_at_its_end(
    exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing).start()
    flown.flight.leave(flown.seen.watcher)
    flown.clock.advance(N_SAMPLES * DT + 0.1 + LEFT_S)
    assert flown.flight.alarms.at_hand
    assert [status for status, _ in flown.over] == ["ended"]


def test_an_action_answers_where_the_flight_is_then(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing).start()
    flown.flight.act("pause")
    for action, value, sample in [("seek", 1.0, 20), ("step", None, 21), ("step", -3, 18)]:
        flown.flight.act(action, value)
        assert flown.flight.transport.sample == sample


@pytest.mark.parametrize(
    ("action", "value"),
    [("seek", None), ("seek", True), ("speed", None), ("speed", 11), ("loop", 1), ("step", 0.5)],
)
def test_an_action_with_a_wrong_value_is_refused_and_changes_nothing(
    action: str, value: Any, exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing).start()
    before = flown.flight.transport
    with pytest.raises(TransportError):
        flown.flight.act(action, value)
    assert flown.flight.transport == before


# --- alarms --------------------------------------------------------------------------------------


def test_an_alert_raises_one_alarm_at_its_onset(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing).start()
    flown.advance(N_SAMPLES * DT)
    onset = int(exact.assess(T, failing, EPSILON).alert.argmax())
    (message,) = flown.seen.of("alarm")
    alarm = message["alarm"]
    assert (alarm["seq"], alarm["t"], alarm["acknowledged"]) == (onset, T[onset], None)
    assert alarm["p_value"] > EPSILON
    where = flown.seen.messages.index(message)
    before = [f["seq"] for m in flown.seen.messages[:where] for f in m.get("frames", [])]
    assert max(before) < onset
    told = flown.flight.acknowledge(alarm["id"], "FTE", flown.clock.utc())
    assert (told.by, told.acknowledged) == ("FTE", flown.clock.utc())
    flown.flight.acknowledge(alarm["id"], "pilot", "later")
    flown.seen.take()
    assert [m["alarm"]["by"] for m in flown.seen.of("alarm")] == [None, "FTE"]
    late = Seen(flown.flight.watch())
    assert late.take()[0]["alarms"] == [asdict(told)]


def test_a_seek_into_an_alert_rings_once_by_the_time_at_which_it_began(
    exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing).start()
    flown.flight.act("pause")
    onset = int(exact.assess(T, failing, EPSILON).alert.argmax())
    for sample in (onset + 5, 0, onset + 9, onset):
        flown.flight.act("seek", float(T[sample]))
    flown.flight.acknowledge("1", "FTE", "now")
    for sample in (0, onset + 7, onset + 1):
        flown.flight.act("seek", float(T[sample]))
    flown.seen.take()
    raised = [m["alarm"] for m in flown.seen.of("alarm") if m["alarm"]["acknowledged"] is None]
    assert [alarm["t"] for alarm in raised] == [T[onset]]
    assert raised[0]["p_value"] == exact.assess(T, failing, EPSILON)[onset].p_value


def test_an_exceedance_that_a_seek_comes_into_is_counted_from_where_it_began(
    exact: Monitor,
) -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[5:10, NY], y[30:40, NY] = 0.529, 0.6
    flown = Flown(exact, y, epsilon=0.99).start()
    flown.flight.act("pause")
    for sample in (35, 0, 7, 37):
        flown.flight.act("seek", float(T[sample]))
    flown.seen.take()
    alarms = [m["alarm"] for m in flown.seen.of("alarm")]
    assert [(alarm["kind"], alarm["t"]) for alarm in alarms] == [("limit", T[5]), ("limit", T[30])]
    (ny,) = flown.flight.exceedances.of_channels
    assert (ny.n, ny.first_t, ny.last_t) == (2, T[5], T[30])


def test_a_step_back_into_an_acknowledged_exceedance_stays_acknowledged(exact: Monitor) -> None:
    y = np.zeros((N_SAMPLES, 6))
    y[20:30, NY] = 0.6
    flown = Flown(exact, y, epsilon=0.99).start()
    flown.flight.act("pause")
    flown.flight.act("seek", float(T[25]))
    acknowledge_all(flown)
    flown.flight.act("step", -1)
    assert flown.flight.alarms.n_open(Level.WARNING) == 0
    assert len(flown.flight.alarms.at_hand) == 1
    (latched,) = flown.flight.exceedances.latched
    assert latched.acknowledged
    flown.flight.act("play")
    flown.advance(1.0)
    assert flown.flight.exceedances.latched == []


def test_an_alarm_reaches_a_watcher_without_credit(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing)
    frozen = Seen(flown.flight.watch())
    flown.start()
    for _ in range(N_SAMPLES):
        flown.clock.advance(DT)
        frozen.take(credit=False)
    assert len(frozen.of("alarm")) == 1
    assert len(frozen.frames) < N_SAMPLES


def test_next_alert_goes_from_onset_to_onset(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing).start()
    flown.flight.act("pause")
    alert = exact.assess(T, failing, EPSILON).alert
    onsets = [k for k in range(1, N_SAMPLES) if alert[k] and not alert[k - 1]]
    for onset in onsets:
        flown.flight.act("next_alert")
        assert flown.flight.transport.sample == onset
    with pytest.raises(NotPossible, match="no alert after"):
        flown.flight.act("next_alert")


def test_a_flight_waits_at_its_start_for_its_first_viewer(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing, wait_for_viewer=True).start()
    flown.flight.act("loop", True)  # the start page asks for it before anybody watches
    flown.advance(5.0)
    state = flown.flight.transport
    assert (state.waiting, state.playing, flown.flight.head) == (True, False, -1)
    assert flown.flight.reason == WAITING
    flown.join()
    hello, *messages = flown.seen.messages
    assert hello["head"] == -1
    assert [message["frames"][0]["t"] for message in messages if "frames" in message] == [0.0]
    flown.advance(1.0)
    assert (flown.flight.transport.waiting, flown.flight.transport.playing) == (False, True)
    assert flown.flight.t == pytest.approx(1.0, abs=DT)
    flown.advance(N_SAMPLES * DT - 1.0)
    assert [frame["seq"] for frame in flown.seen.frames] == [*range(flown.flight.head + 1)]


def test_a_flight_without_a_viewer_flies_after_a_while(exact: Monitor, failing: Array) -> None:
    flown = Flown(exact, failing, wait_for_viewer=True).start()
    flown.advance(VIEWER_S - 0.1)
    assert flown.flight.head == -1
    flown.advance(1.1)
    assert flown.flight.t == pytest.approx(1.0, abs=DT)


@pytest.mark.parametrize(
    ("action", "value", "t", "playing"),
    [("play", None, 0.0, True), ("seek", 2.0, 2.0, True), ("step", 3, 2 * DT, False)],
)
def test_whoever_steers_a_flight_that_waits_starts_it(
    action: str, value: float | None, t: float, playing: bool, exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing, wait_for_viewer=True).start()
    with pytest.raises(TransportError):
        flown.flight.act("seek", None)
    assert flown.flight.transport.waiting
    flown.flight.act(action, value)
    state = flown.flight.transport
    assert (state.waiting, state.playing, state.position) == (False, playing, pytest.approx(t))
    flown.advance(2 * VIEWER_S)
    assert flown.flight.transport.playing == (playing and not flown.flight._transport.at_end)


def test_frames_have_the_attitude_and_say_that_it_is_integrated(
    exact: Monitor, failing: Array
) -> None:
    flown = Flown(exact, failing).start()
    flown.advance(N_SAMPLES * DT + 0.1)
    truth = attitude(T, failing)
    for frame, angles in zip(flown.seen.frames, truth, strict=True):
        assert frame["attitude"] == pytest.approx(angles, abs=1e-5)
        assert frame["integrated"]
    assert flown.flight.no_plan
