"""The estimate of the demonstration's start counts the kernels of this installation alone."""

from pathlib import Path

import pytest

from app import demonstration
from app.demonstration import n_kernels
from tests.support.flying import exact_monitor


def test_kernels_of_this_installation_are_counted() -> None:
    exact_monitor()
    assert n_kernels() > 0


def test_kernels_of_another_installation_are_not_counted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(demonstration, "cache_directory", lambda: str(tmp_path))
    (tmp_path / "kernels_elsewhere").mkdir()
    (tmp_path / "kernels_elsewhere" / "a.nbi").touch()
    assert n_kernels() == 0
