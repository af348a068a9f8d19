"""Watchers: credit, what is left out and counted, what never is, and resuming."""

import msgspec
import pytest

from app.flights.watcher import (
    CREDIT,
    LARGEST,
    MAX_WAITING,
    NEWEST,
    RARELY,
    RecentFrames,
    Watcher,
)
from tests.support.flying import Seen


def append(recent: RecentFrames, *watchers: Watcher, n: int = 1) -> None:
    for _ in range(n):
        recent.append(msgspec.json.encode({"seq": recent.head + 1}).decode())
        for watcher in watchers:
            watcher.wake()


def seqs(messages: list[dict]) -> list[int]:
    return [frame["seq"] for message in messages for frame in message.get("frames", [])]


def test_a_watcher_that_gives_credit_back_gets_every_frame_once() -> None:
    recent = RecentFrames()
    watcher = Watcher(recent)
    seen = Seen(watcher)
    for _ in range(5 * CREDIT):
        append(recent, watcher)
        seen.take()
    assert seqs(seen.messages) == list(range(5 * CREDIT))
    assert {message["conflated"] for message in seen.messages} == {0}
    assert watcher.conflated == 0


def test_the_same_message_is_encoded_once_for_all() -> None:
    recent = RecentFrames()
    watchers = [Watcher(recent) for _ in range(3)]
    append(recent, *watchers)
    first, *others = [watcher.next_message() for watcher in watchers]
    assert all(text is first for text in others)


def held_up(n: int, *, before: int = 0) -> tuple[Watcher, Seen, RecentFrames]:
    """A watcher that gave no credit while n frames came, after it had taken some."""
    recent = RecentFrames()
    watcher = Watcher(recent)
    seen = Seen(watcher)
    for k in range(before + CREDIT + n):
        append(recent, watcher)
        seen.take(credit=k < before)
    return watcher, seen, recent


def test_a_watcher_that_was_held_up_once_is_sent_every_frame() -> None:
    watcher, seen, recent = held_up(LARGEST, before=200)
    assert watcher.conflated == 0
    watcher.grant(1)
    seen.take(credit=False)
    assert seqs(seen.messages) == list(range(recent.head + 1))


def test_a_watcher_that_is_always_slow_is_sent_the_newest_frames_with_the_count() -> None:
    watcher, seen, recent = held_up(LARGEST)
    watcher.grant(1)
    seen.take(credit=False)
    append(recent, watcher, n=100)
    assert watcher.conflated == 100 - NEWEST
    watcher.grant(1)
    (message,) = seen.take(credit=False)
    assert seqs([message]) == list(range(recent.head + 1 - NEWEST, recent.head + 1))
    assert message["conflated"] == watcher.conflated == 100 - NEWEST
    append(recent, watcher, n=RARELY)
    watcher.grant(1)
    (message,) = seen.take(credit=False)
    assert len(message["frames"]) == LARGEST


def test_shown_and_conflated_frames_add_up_to_those_flown() -> None:
    recent = RecentFrames(kept=50)
    watcher = Watcher(recent)
    seen = Seen(watcher)
    for k in range(1000):
        append(recent, watcher, n=1 + k % 7)
        seen.take(credit=False)
        if k % 29 == 0:
            watcher.grant(3)
    watcher.grant(CREDIT)
    seen.take()
    shown = seqs(seen.messages)
    assert shown == sorted(set(shown))
    assert shown[-1] == recent.head
    conflated = sum(message["conflated"] for message in seen.messages)
    assert conflated == watcher.conflated > 0
    assert len(shown) + conflated == recent.head + 1


def test_a_burst_is_not_conflated_for_a_watcher_with_credit() -> None:
    recent = RecentFrames()
    watcher = Watcher(recent)
    append(recent, watcher, n=LARGEST + 10)
    messages = Seen(watcher).take()
    assert seqs(messages) == list(range(LARGEST + 10))
    assert len(messages) == 2


def test_credit_has_a_ceiling() -> None:
    watcher = Watcher(RecentFrames())
    watcher.grant(1000)
    assert watcher.credit == CREDIT


def test_other_messages_need_no_credit_and_come_first() -> None:
    recent = RecentFrames()
    watcher = Watcher(recent)
    watcher.credit = 0
    append(recent, watcher, n=LARGEST + 40)
    watcher.send('{"type":"alarm"}')
    watcher.send('{"type":"state"}')
    watcher.beat(lambda conflated: f'{{"type":"heartbeat","conflated":{conflated}}}')
    seen = Seen(watcher)
    told = [message["type"] for message in seen.take()]
    assert told == ["alarm", "state", "waiting", "heartbeat"]
    assert seen.messages[-1]["conflated"] == 40


def test_of_waiting_heartbeats_only_the_newest_is_sent() -> None:
    watcher = Watcher(RecentFrames())
    watcher.beat(lambda conflated: '{"type":"heartbeat","n":1}')
    watcher.beat(lambda conflated: '{"type":"heartbeat","n":2}')
    assert [message["n"] for message in Seen(watcher).take()] == [2]


def test_a_watcher_that_takes_no_alarms_is_closed_and_holds_nothing() -> None:
    watcher = Watcher(RecentFrames())
    for _ in range(MAX_WAITING):
        watcher.send("{}")
    assert not watcher.ended
    watcher.send("{}")
    assert watcher.overrun
    assert watcher.ended
    assert Seen(watcher).take() == []


def test_the_frames_before_a_reset_are_still_sent_before_it() -> None:
    recent = RecentFrames()
    watcher = Watcher(recent)
    append(recent, watcher, n=3)
    watcher.before_reset()
    watcher.send(recent.restart(7.5))
    append(recent, watcher)
    messages = Seen(watcher).take()
    assert [message["type"] for message in messages] == ["frames", "reset", "frames"]
    assert seqs(messages) == [0, 1, 2, 3]
    assert messages[1] == {"type": "reset", "seq": 3, "t": 7.5, "since": 3, "held": []}


def test_what_a_reset_took_from_a_watcher_without_credit_is_counted() -> None:
    recent = RecentFrames()
    watcher = Watcher(recent)
    watcher.credit = 0
    append(recent, watcher, n=3)
    watcher.before_reset()
    watcher.send(recent.restart(0.0))
    assert [message["type"] for message in Seen(watcher).take()] == ["reset"]
    assert watcher.conflated == 3


def test_resume_as_first_message_continues_without_a_gap_or_repeat() -> None:
    recent = RecentFrames()
    append(recent, n=700)
    watcher = Watcher(recent)
    watcher.resume(99)
    append(recent, watcher, n=5)
    messages = Seen(watcher).take()
    assert {message["type"] for message in messages} == {"frames"}
    assert seqs(messages) == list(range(100, 705))
    assert watcher.conflated == 0


@pytest.mark.parametrize("seen_before", [-1, 3, 88, 200])
def test_resume_from_what_is_not_kept_resets_and_sends_what_is(seen_before: int) -> None:
    recent = RecentFrames(kept=60)
    append(recent, n=150)
    watcher = Watcher(recent)
    watcher.resume(seen_before)
    reset, *messages = Seen(watcher).take()
    assert (reset["type"], reset["since"], reset["seq"]) == ("reset", 0, 90)
    assert seqs(messages) == list(range(90, 150))


def test_resume_after_frames_came_resets_first() -> None:
    recent = RecentFrames()
    append(recent, n=10)
    watcher = Watcher(recent)
    append(recent, watcher)
    seen = Seen(watcher)
    seen.take()
    watcher.resume(4)
    messages = seen.take()
    assert messages[0]["type"] == "reset"
    assert seqs(messages) == list(range(11))


def test_end_comes_after_the_last_frames() -> None:
    recent = RecentFrames()
    watcher = Watcher(recent)
    append(recent, watcher, n=2)
    watcher.end('{"type":"end"}')
    watcher.send('{"type":"alarm"}')
    assert [message["type"] for message in Seen(watcher).take()] == ["frames", "end"]


def test_a_client_that_gives_no_credit_is_told_with_the_next_heartbeat() -> None:
    recent = RecentFrames()
    watcher = Watcher(recent)
    seen = Seen(watcher)

    def beaten() -> list[str]:
        watcher.beat(lambda _: '{"type":"heartbeat"}')
        return [message["type"] for message in seen.take()]

    for _ in range(CREDIT + 3):
        append(recent, watcher)
        while (text := watcher.next_message()) is not None:
            assert "frames" in text
    assert beaten() == ["waiting", "heartbeat"]
    assert '"type": "credit"' in seen.messages[-2]["reason"]
    assert seen.messages[-2]["behind"] == 3
    assert beaten() == ["heartbeat"]
