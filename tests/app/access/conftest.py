"""A store for tokens and sessions."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from app.store.store import Store, open_store


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    opened = open_store(tmp_path / "forewarn.db")
    yield opened
    opened.close()
