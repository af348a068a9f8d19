"""Sessions, links and guesses against a clock that the test sets."""

import pytest

from app.http.sessions import (
    FORGOTTEN_AFTER,
    FREE_GUESSES,
    LINK_SECONDS,
    LOGGED_AGAIN_AFTER,
    LONGEST_WAIT,
    MOST_ADDRESSES,
    MOST_SESSIONS,
    Sessions,
)
from tests.support.told_clock import ToldClock

TOKEN = "a-token-of-a-good-length"


@pytest.fixture
def sessions(clock: ToldClock) -> Sessions:
    return Sessions(TOKEN, 60.0, clock)


def guess(sessions: Sessions, n: int, address: str = "192.0.2.1", first: int = 0) -> None:
    for number in range(first, first + n):
        assert not sessions.is_token(f"guess {number}", address)


def test_a_session_ends_so_long_after_its_last_use(sessions: Sessions, clock: ToldClock) -> None:
    key = sessions.begin()
    for _ in range(5):
        clock.now += 59.0
        assert sessions.is_open(key)
    clock.now += 60.0
    assert not sessions.is_open(key)
    clock.now -= 60.0
    assert not sessions.is_open(key)


def test_the_session_that_was_used_least_lately_makes_room(sessions: Sessions) -> None:
    keys = [sessions.begin() for _ in range(MOST_SESSIONS)]
    assert sessions.is_open(keys[0])
    sessions.begin()
    assert [sessions.is_open(key) for key in keys[:3]] == [True, False, True]


def test_a_link_works_once_and_not_for_long(sessions: Sessions, clock: ToldClock) -> None:
    first, second = sessions.make_link(), sessions.make_link()
    assert sessions.use_link(first)
    assert not sessions.use_link(first)
    clock.now += LINK_SECONDS
    assert not sessions.use_link(second)


def test_each_wrong_token_beyond_the_free_ones_doubles_the_wait(
    sessions: Sessions, clock: ToldClock
) -> None:
    guess(sessions, FREE_GUESSES - 1)
    assert sessions.wait_of("192.0.2.1") == 0
    waits = []
    for number in range(100, 2200):
        guess(sessions, 1, first=number)
        waits.append(sessions.wait_of("192.0.2.1"))
        clock.now += waits[-1]
        assert sessions.wait_of("192.0.2.1") == 0
    assert waits[:8] == [1, 2, 4, 8, 16, 32, LONGEST_WAIT, LONGEST_WAIT]
    assert set(waits[8:]) == {LONGEST_WAIT}


def test_the_same_wrong_token_again_is_no_other_guess(sessions: Sessions) -> None:
    for _ in range(100):
        guess(sessions, 1)
    assert sessions.wait_of("192.0.2.1") == 0


def test_every_refused_login_is_logged_by_its_address_and_without_its_token(
    sessions: Sessions, clock: ToldClock, caplog: pytest.LogCaptureFixture
) -> None:
    peer = "2001:db8::42"
    guess(sessions, FREE_GUESSES, peer)
    assert len(caplog.messages) == FREE_GUESSES
    for _ in range(100):  # the same again, and what comes too soon: once a minute
        guess(sessions, 1, peer, first=FREE_GUESSES - 1)
        sessions.turn_away(peer)
    assert len(caplog.messages) == FREE_GUESSES
    for refuse in (lambda: guess(sessions, 1, peer), lambda: sessions.turn_away(peer)):
        clock.now += LOGGED_AGAIN_AFTER
        refuse()
    assert len(caplog.messages) == FREE_GUESSES + 2
    for message in caplog.messages:
        assert message.startswith(f"{peer} was refused a login: wrong token")
        assert "guess" not in message
        assert TOKEN not in message


@pytest.mark.parametrize("ends", ["right", "time"])
def test_guesses_are_forgotten_after_the_right_one_or_some_time(
    sessions: Sessions, clock: ToldClock, ends: str
) -> None:
    guess(sessions, FREE_GUESSES + 3)
    if ends == "right":
        assert sessions.is_token(TOKEN, "192.0.2.1")
    else:
        clock.now += FORGOTTEN_AFTER + 1
    guess(sessions, 1, first=50)
    assert sessions.wait_of("192.0.2.1") == 0


def test_one_address_does_not_slow_another_down(sessions: Sessions) -> None:
    guess(sessions, 20, "2001:db8::1")
    assert sessions.wait_of("2001:db8::ffff:1") > 0  # of the same customer
    assert sessions.wait_of("2001:db8:0:1::1") == sessions.wait_of("192.0.2.1") == 0


def test_addresses_without_end_take_no_memory_without_end(sessions: Sessions) -> None:
    for number in range(2 * MOST_ADDRESSES):
        guess(sessions, 1, f"10.0.{number // 256}.{number % 256}")
    assert len(sessions._guesses) == MOST_ADDRESSES
