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
LIGHT = ("audit", "backup", "certificate", "mqtt", "push", "restore", "retain", "score", "serve")
"""Commands whose options need none of what they work with."""
NOT_FOR_HELP = ("fastapi", "numba", "numpy", "sqlalchemy")


def run_apart(program: str) -> subprocess.CompletedProcess[str]:
    """Run a program in an interpreter that has imported nothing yet."""
    return subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=True,
    )


def test_slow_libraries_are_loaded_only_when_they_are_used():
    program = (
        f"import sys, {', '.join(MODULES)}\nprint(*(n for n in {LIBRARIES} if n in sys.modules))"
    )
    assert run_apart(program).stdout.split() == []


def test_the_process_of_a_model_loads_no_compiler():
    models = "core.simulation.fmu, core.simulation.jsbsim"
    program = f"import sys, {models}; print('numba' in sys.modules)"
    assert run_apart(program).stdout.split() == ["False"]


def test_help_of_commands_loads_nothing_that_they_work_with():
    program = f"""
import sys
from app.cli import main
for command in {LIGHT}:
    try:
        main([command, "--help"])
    except SystemExit as ended:
        assert ended.code == 0
print(*(name for name in {NOT_FOR_HELP} if name in sys.modules), file=sys.stderr)
"""
    helped = run_apart(program)
    assert helped.stdout.count("usage: forewarn") == len(LIGHT)
    assert helped.stderr.split() == []


def test_blas_has_one_thread_unless_asked_for_more(monkeypatch):
    program = "import app, os; print(os.environ['OPENBLAS_NUM_THREADS'])"
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    assert run_apart(program).stdout.split() == ["1"]
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert run_apart(program).stdout.split() == ["2"]
