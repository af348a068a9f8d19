"""Fixtures of the store's tests: a store that must be sound when it closes."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from app.store.store import Store
from tests.support.stored import opened


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Of a database that is not there yet, in a directory that is not either."""
    return tmp_path / "data of the crew" / "50 %" / "forewarn.db"


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.services)])
def url(request: pytest.FixtureRequest, path: Path) -> str:
    """Of a database that is empty or not there yet, of each kind."""
    if request.param == "sqlite":
        return f"sqlite:///{path}"
    return request.getfixturevalue("postgresql").new_database()


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    with opened(url) as store:
        yield store
