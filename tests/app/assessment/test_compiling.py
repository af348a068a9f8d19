"""Kernels of a live sample: compiled by another process, and loaded before the flight."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from app.assessment import compiling
from app.assessment.compiling import COMPILED, make_ready
from tests.support.flying import exact_monitor


def test_another_process_compiles_once_on_a_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[tuple[list[str], bytes]] = []

    def run(command: list[str], *, input: bytes, **_: Any) -> subprocess.CompletedProcess[bytes]:  # noqa: A002
        calls.append((command, input))
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiling.subprocess, "run", run)
    monitor = exact_monitor()
    make_ready(monitor)
    make_ready(monitor)
    assert calls == [([sys.executable, "-c", compiling.APART], monitor.to_bytes())]
    assert (tmp_path / COMPILED).exists()


EVERY_KERNEL = """
from core.kernels.causal_grid import advance, receive_one
from core.kernels.causal_trim import begin, follow_one
from core.kernels.input_motion import look, roughness
from core.kernels.live_call import update_at
for kernel in (advance, receive_one, begin, follow_one, look, roughness, update_at):
    assert kernel.signatures, kernel
"""


def test_the_other_process_compiles_every_kernel_of_a_live_sample() -> None:
    done = subprocess.run(
        [sys.executable, "-c", compiling.APART + EVERY_KERNEL],
        input=exact_monitor().to_bytes(),
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stderr.decode()) == (0, "")


def test_where_it_fails_the_flight_starts_all_the_same_and_the_log_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiling, "APART", "raise SystemExit('no memory')")
    make_ready(exact_monitor())
    assert "during flights: no memory" in caplog.text
    assert not (tmp_path / COMPILED).exists()
