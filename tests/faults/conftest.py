"""Fixtures of the faults: a data directory with a monitor, on a disk of any size."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.settings import Settings
from app.store.store import open_store
from core.monitor import Monitor, MonitorRecipe, train
from core.planned_test.collection import DatasetRecipe, collect

MIB = 2**20
DISK_BYTES = 24 * MIB


@pytest.fixture(scope="session")
def flyable() -> Monitor:
    """A monitor of an aircraft that can be simulated, which alerts easily."""
    return train(collect(DatasetRecipe(n_unsafe=12, n_obs=10, seed=3)), MonitorRecipe(epsilon=0.3))


def keep_monitor(data_dir: Path, monitor: Monitor, url: str | None = None) -> str:
    """Store a monitor in a directory, or a database, that nobody serves; its id."""
    store = open_store(Settings(data_dir=data_dir, database_url=url).url)
    monitor_id = store.monitors.add(monitor, "m").id
    store.close()
    return monitor_id


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """A directory on a disk of DISK_BYTES."""
    if sys.platform != "linux" or os.geteuid() != 0:
        pytest.skip("a small disk is a tmpfs, which root mounts on Linux")
    path = tmp_path / "disk"
    path.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "forewarn", str(path)],
        capture_output=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip(f"no tmpfs can be mounted here: {mounted.stderr.decode().strip()}")
    yield path
    subprocess.run(["umount", "-l", str(path)], check=True)
