"""Rounds in which the watchers of all flights are sent what is new."""

import logging

import pytest

from app.flights.watcher import TICK_S, FrameTicks
from tests.support.flying import ScriptedClock


def test_the_first_round_is_at_once_and_the_next_a_tick_later() -> None:
    clock, sent = ScriptedClock(), list[tuple[str, float]]()
    ticks, began = FrameTicks(clock), clock.now()

    def send(name: str) -> None:
        sent.append((name, clock.now() - began))

    ticks.ask(lambda: send("first"))
    clock.advance(0.0)
    assert sent == [("first", 0.0)]
    ticks.ask(lambda: send("second"))
    ticks.ask(lambda: send("third"))
    clock.advance(10 * TICK_S)
    assert sent[1:] == [("second", pytest.approx(TICK_S)), ("third", pytest.approx(TICK_S))]


def test_who_asks_again_before_a_round_is_sent_to_once() -> None:
    clock, sent = ScriptedClock(), list[int]()
    ticks = FrameTicks(clock)

    def send() -> None:
        sent.append(1)

    for _ in range(3):
        ticks.ask(send)
    clock.advance(10 * TICK_S)
    assert sent == [1]
    ticks.ask(send)
    clock.advance(10 * TICK_S)
    assert sent == [1, 1]


def test_a_watcher_that_cannot_be_sent_to_keeps_nobody_else_from_theirs(
    caplog: pytest.LogCaptureFixture,
) -> None:
    clock, sent = ScriptedClock(), list[str]()
    ticks = FrameTicks(clock)

    def fail() -> None:
        raise OSError("gone")

    ticks.ask(fail)
    ticks.ask(lambda: sent.append("other"))
    with caplog.at_level(logging.CRITICAL, "forewarn"):
        clock.advance(TICK_S)
    assert sent == ["other"]
    ticks.ask(lambda: sent.append("again"))
    clock.advance(TICK_S)
    assert sent == ["other", "again"]
