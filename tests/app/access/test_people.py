"""Stored tokens, as they change while a server runs."""

import asyncio
import logging
from datetime import datetime
from pathlib import Path

import pytest

from app.access import people as module
from app.access.people import Admission, People, Person
from app.store.people import TokenError, digest_of
from app.store.store import Store, StoreError
from tests.support.told_clock import ToldClock

TOKEN = "a-token-of-a-good-length"


def person_of(people: People, token: str) -> Person | None:
    admission = people.find(token)
    return admission and admission.person


def test_the_token_of_the_settings_is_an_admins() -> None:
    assert person_of(People(TOKEN), TOKEN) == Person("server", "admin")
    assert People(TOKEN).find(TOKEN[:-1]) is People(None).find("") is None


async def end_of(admission: Admission) -> None:
    async with asyncio.timeout(30):
        while not admission.has_ended:
            await asyncio.sleep(0.001)


def test_tokens_made_or_revoked_by_another_process_count_without_a_restart(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "REFRESH_EVERY_S", 0.001)

    async def run() -> None:
        people = People(None)
        async with people.open(store):
            assert not people.needs_token
            ann, token = await asyncio.to_thread(store.tokens.add, "Ann", "operator")
            await end_of(people.local)
            assert people.needs_token
            admission = people.find(token)
            assert admission is not None
            assert admission.person == Person("Ann", "operator")
            await asyncio.to_thread(store.tokens.revoke, ann.id)
            await end_of(admission)
            assert people.find(token) is None
            assert people.needs_token  # access without a token does not come back
            async with asyncio.timeout(30):
                while (await asyncio.to_thread(store.tokens.all))[0].last_used is None:
                    await asyncio.sleep(0.001)

    asyncio.run(run())


def test_a_token_expires(store: Store, clock: ToldClock) -> None:
    made, token = store.tokens.add("Ann", "viewer", days=1)
    assert made.expires is not None
    ends = datetime.fromisoformat(made.expires).timestamp()

    async def run() -> None:
        people = People(None, clock)
        async with people.open(store):
            clock.now = ends - 1.0
            admission = people.find(token)
            assert admission is not None
            clock.now = ends
            assert people.find(token) is None
            assert admission.has_ended

    asyncio.run(run())


def test_unreadable_tokens_are_refused_and_a_token_is_needed(
    store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    _, token = store.tokens.add("Ann", "viewer")

    def fail() -> None:
        raise StoreError("damaged")

    monkeypatch.setattr(store.tokens, "known", fail)

    async def run() -> None:
        people = People(None)
        async with people.open(store):
            assert people.needs_token
            assert people.find(token) is None

    asyncio.run(run())
    assert [record.levelno for record in caplog.records] == [logging.ERROR]


def test_neither_token_nor_link_is_stored(store: Store, tmp_path: Path) -> None:
    made, token = store.tokens.add("Ann", "viewer")
    code = store.tokens.make_link(made.id)
    store.close()
    content = b"".join(path.read_bytes() for path in tmp_path.iterdir())
    assert digest_of(token).encode() in content
    assert token.encode() not in content
    assert code.encode() not in content


def test_a_link_works_once_and_replaces_the_earlier_one(store: Store) -> None:
    made, token = store.tokens.add("Ann", "viewer")
    first, second = store.tokens.make_link(made.id), store.tokens.make_link(made.id)
    assert [store.tokens.use_link(code) for code in (first, second, second)] == [
        None,
        digest_of(token),
        None,
    ]
    third = store.tokens.make_link(made.id)
    store.tokens.revoke(made.id)
    assert store.tokens.use_link(third) is None
    with pytest.raises(TokenError, match="revoked"):
        store.tokens.make_link(made.id)


@pytest.mark.parametrize("name", ["", "local", "Server", " Ann", "=1+1", "a\nb", "x" * 65])
def test_an_invalid_name_is_refused(store: Store, name: str) -> None:
    with pytest.raises(TokenError, match="name"):
        store.tokens.add(name, "viewer")


def test_a_name_has_one_valid_token(store: Store) -> None:
    made, _ = store.tokens.add("Ann Lee", "viewer")
    with pytest.raises(TokenError, match="revoke it"):
        store.tokens.add("ann lee", "admin")
    store.tokens.revoke(made.id)
    again, _ = store.tokens.add("ann lee", "operator")
    assert store.tokens.of_name("Ann Lee") == again
