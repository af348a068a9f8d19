"""Slow libraries, of file formats and figures, are loaded where they are used, not at the start."""

import os
import subprocess
import sys

from tests.support.places import ROOT

COMMANDS = [f"app.commands.{file.stem}" for file in (ROOT / "app/commands").glob("[!_]*.py")]
MODULES = ("app.main", "app.cli", "app.telemetry.reading", *COMMANDS)
LIBRARIES = (
    "asammdf", "chapter10", "h5py", "matplotlib", "pandas", "pyarrow", "pyulog", "scipy.io",
    "scipy.signal", "scipy.stats",
)  # fmt: skip


def test_slow_libraries_are_loaded_only_when_they_are_used():
    program = (
        f"import sys, {', '.join(MODULES)}\nprint(*(n for n in {LIBRARIES} if n in sys.modules))"
    )
    loaded = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=True,
    )
    assert loaded.stdout.split() == []
