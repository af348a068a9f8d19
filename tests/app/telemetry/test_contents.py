"""Columns on disk are memory-mapped on use, and released."""

import sys
from pathlib import Path

import numpy as np
import pytest

from app.telemetry.contents import ColumnWriter, open_columns, release


def resident(path: Path) -> int:
    """Bytes of a file that are in this process's memory."""
    lines = iter(Path("/proc/self/smaps").read_text().splitlines())
    resident_kib = 0
    for line in lines:
        if line.endswith(str(path)):
            resident_kib += next(int(row.split()[1]) for row in lines if row.startswith("Rss:"))
    return resident_kib * 1024


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_a_released_column_uses_no_memory_and_can_be_read_again(tmp_path: Path) -> None:
    """Also through views of it; other arrays are not affected."""
    place = tmp_path / "columns"
    place.mkdir()
    writer = ColumnWriter(place, 1 << 30)
    writer.add_signal(writer.add_group(), "x")
    values = np.arange(1e6)
    writer.append(0, values)
    writer.finish("csv")
    column = open_columns(place).values("x")
    np.testing.assert_array_equal(column, values)
    assert resident(place / "0.f8") >= column.nbytes
    release(np.asarray(column)[5:])
    assert resident(place / "0.f8") == 0
    np.testing.assert_array_equal(column, values)
    release(values)
    assert values[-1] == 1e6 - 1
