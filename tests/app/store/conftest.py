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


@pytest.fixture
def store(path: Path) -> Iterator[Store]:
    with opened(path) as store:
        yield store
