"""The libraries of file formats are loaded where a file is read, not where the program starts."""

import os
import subprocess
import sys

import pytest

LIBRARIES = ("asammdf", "chapter10", "h5py", "pandas", "pyarrow", "pyulog", "scipy.io")


@pytest.mark.parametrize("module", ["app.commands.report", "app.main", "app.telemetry.reading"])
def test_libraries_of_file_formats_are_loaded_only_when_they_are_used(module):
    program = f"import sys, {module}; print(*(n for n in {LIBRARIES!r} if n in sys.modules))"
    loaded = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=True,
    )
    assert loaded.stdout.split() == []
