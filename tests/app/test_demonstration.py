"""The estimate of the demonstration's start counts the kernels of this installation alone."""

from pathlib import Path

import pytest

from app import demonstration
from app.demonstration import n_kernels
from tests.support.flying import exact_monitor


def test_kernels_of_this_installation_are_counted() -> None:
    exact_monitor()
    assert n_kernels() > 0


def test_no_kernels_are_counted_before_the_first_is_compiled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(demonstration, "cache_directory", lambda: str(tmp_path))
    assert n_kernels() == 0
