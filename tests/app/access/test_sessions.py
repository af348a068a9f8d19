"""Sessions and links against a clock that the test sets."""

import pytest

from app.access.people import Admission, Person
from app.access.sessions import MOST_SESSIONS, Sessions
from app.store.people import LINK_SECONDS
from tests.support.told_clock import ToldClock

ANN = Admission(Person("Ann", "operator"))


@pytest.fixture
def sessions(clock: ToldClock) -> Sessions:
    return Sessions(60.0, clock)


def test_a_session_ends_a_set_time_after_its_last_use(sessions: Sessions, clock: ToldClock) -> None:
    key = sessions.start(ANN)
    for _ in range(5):
        clock.now += 59.0
        assert sessions.use(key) is ANN
    clock.now += 60.0
    assert sessions.use(key) is None
    clock.now -= 60.0
    assert sessions.use(key) is None


def test_the_least_recently_used_session_is_dropped(sessions: Sessions) -> None:
    keys = [sessions.start(ANN) for _ in range(MOST_SESSIONS)]
    assert sessions.use(keys[0])
    sessions.start(ANN)
    assert [sessions.use(key) for key in keys[:3]] == [ANN, None, ANN]


def test_a_link_works_once_and_expires(sessions: Sessions, clock: ToldClock) -> None:
    first, second = sessions.make_link(), sessions.make_link()
    assert sessions.use_link(first)
    assert not sessions.use_link(first)
    clock.now += LINK_SECONDS
    assert not sessions.use_link(second)


def test_a_session_ends_with_its_token(sessions: Sessions) -> None:
    revoked, other = Admission(Person("Bo", "viewer")), sessions.start(ANN)
    key = sessions.start(revoked)
    assert sessions.use(key) is revoked
    revoked.is_revoked = True
    assert sessions.use(key) is None
    assert sessions.use(other) is ANN
