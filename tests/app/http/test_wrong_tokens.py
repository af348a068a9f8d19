"""Wrong tokens against a clock that the test sets."""

import pytest

from app.http.wrong_tokens import (
    FORGOTTEN_AFTER,
    FREE_GUESSES,
    LOGGED_AGAIN_AFTER,
    LONGEST_WAIT,
    MOST_ADDRESSES,
    WrongTokens,
)
from tests.support.told_clock import ToldClock


@pytest.fixture
def wrong_tokens(clock: ToldClock) -> WrongTokens:
    return WrongTokens(clock)


def guess(wrong_tokens: WrongTokens, n: int, address: str = "192.0.2.1", first: int = 0) -> None:
    for number in range(first, first + n):
        wrong_tokens.note(f"guess {number}", address)


def test_each_wrong_token_beyond_the_free_ones_doubles_the_wait(
    wrong_tokens: WrongTokens, clock: ToldClock
) -> None:
    guess(wrong_tokens, FREE_GUESSES - 1)
    assert wrong_tokens.wait_of("192.0.2.1") == 0
    waits = []
    for number in range(100, 2200):
        guess(wrong_tokens, 1, first=number)
        waits.append(wrong_tokens.wait_of("192.0.2.1"))
        clock.now += waits[-1]
        assert wrong_tokens.wait_of("192.0.2.1") == 0
    assert waits[:8] == [1, 2, 4, 8, 16, 32, LONGEST_WAIT, LONGEST_WAIT]
    assert set(waits[8:]) == {LONGEST_WAIT}


def test_the_same_wrong_token_again_is_no_other_guess(wrong_tokens: WrongTokens) -> None:
    for _ in range(100):
        guess(wrong_tokens, 1)
    assert wrong_tokens.wait_of("192.0.2.1") == 0


def test_every_refused_login_is_logged_by_its_address_and_without_its_token(
    wrong_tokens: WrongTokens, clock: ToldClock, caplog: pytest.LogCaptureFixture
) -> None:
    peer = "2001:db8::42"
    guess(wrong_tokens, FREE_GUESSES, peer)
    assert len(caplog.messages) == FREE_GUESSES
    for _ in range(100):  # the same again, and what comes too soon: once a minute
        guess(wrong_tokens, 1, peer, first=FREE_GUESSES - 1)
    assert len(caplog.messages) == FREE_GUESSES
    clock.now += LOGGED_AGAIN_AFTER
    guess(wrong_tokens, 1, peer, first=FREE_GUESSES - 1)
    assert len(caplog.messages) == FREE_GUESSES + 1
    for message in caplog.messages:
        assert message.startswith(f"{peer} was refused a login: wrong token")
        assert "guess" not in message


@pytest.mark.parametrize("ends", ["right", "time"])
def test_guesses_are_forgotten_after_the_right_one_or_some_time(
    wrong_tokens: WrongTokens, clock: ToldClock, ends: str
) -> None:
    guess(wrong_tokens, FREE_GUESSES + 3)
    if ends == "right":
        wrong_tokens.forget("192.0.2.1")
    else:
        clock.now += FORGOTTEN_AFTER + 1
    guess(wrong_tokens, 1, first=50)
    assert wrong_tokens.wait_of("192.0.2.1") == 0


def test_one_address_does_not_slow_another_down(wrong_tokens: WrongTokens) -> None:
    guess(wrong_tokens, 20, "2001:db8::1")
    assert wrong_tokens.wait_of("2001:db8::ffff:1") > 0  # of the same customer
    assert wrong_tokens.wait_of("2001:db8:0:1::1") == wrong_tokens.wait_of("192.0.2.1") == 0


def test_addresses_without_end_take_no_memory_without_end(wrong_tokens: WrongTokens) -> None:
    for number in range(2 * MOST_ADDRESSES):
        guess(wrong_tokens, 1, f"10.0.{number // 256}.{number % 256}")
    assert len(wrong_tokens._guesses) == MOST_ADDRESSES
