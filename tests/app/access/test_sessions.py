"""Sessions and links against a clock that the test sets."""

import asyncio

import pytest

from app.access.people import Admission, Person
from app.access.sessions import MOST_SESSIONS, Sessions
from app.store.store import Store, StoreError
from app.store.tables import sessions as sessions_table
from tests.support.told_clock import ToldClock

ANN = Admission(Person("Ann", "operator"), digest="a" * 64)


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


def test_a_session_ends_with_its_token(sessions: Sessions) -> None:
    revoked, other = Admission(Person("Bo", "viewer")), sessions.start(ANN)
    key = sessions.start(revoked)
    assert sessions.use(key) is revoked
    revoked.is_revoked = True
    assert sessions.use(key) is None
    assert sessions.use(other) is ANN


def test_sessions_outlast_the_server(store: Store, clock: ToldClock) -> None:
    bo = Admission(Person("Bo", "viewer"), digest="b" * 64)
    known = {ANN.digest: ANN, bo.digest: bo}

    async def begin() -> list[str]:
        sessions = Sessions(60.0, clock)
        async with sessions.open(store, known.get):
            keys = [sessions.start(person) for person in (ANN, ANN, bo)]
            clock.now += 5.0
            sessions.use(keys[0])
            sessions.end(keys[1])
        return keys

    async def use(keys: list[str]) -> list[Admission | None]:
        sessions = Sessions(60.0, clock)
        async with sessions.open(store, known.get):
            return [sessions.use(key) for key in keys]

    keys = asyncio.run(begin())
    del known[bo.digest]  # revoked meanwhile
    clock.now += 57.0
    assert asyncio.run(use(keys)) == [ANN, None, None]
    clock.now += 60.0
    assert asyncio.run(use(keys)) == [None, None, None]
    assert store.sessions.known() == []


def test_sessions_that_cannot_be_stored_go_on_in_memory(
    store: Store, clock: ToldClock, caplog: pytest.LogCaptureFixture
) -> None:
    with store.engine.begin() as connection:
        sessions_table.drop(connection)
    sessions = Sessions(60.0, clock)

    async def use() -> None:
        async with sessions.open(store, lambda digest: None):
            key = sessions.start(ANN)
            with pytest.raises(StoreError):
                await sessions.keep(store)
            assert sessions.use(key) is ANN

    asyncio.run(use())
    assert "sessions are not stored, so a restart ends them" in caplog.text
