"""How costs grow: with failures, safe points, flights side by side and the length of a file."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd
import pytest

from core.monitor import Monitor, train
from core.planned_test.collection import DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator
from core.types import Array

pytestmark = pytest.mark.benchmark

ROUNDS = 5
N_UNSAFE = (50, 500, 5_000)
SAFE_POINTS = (5_000, 50_000, 500_000)
FLIGHTS = (1, 10, 50)
HOURS = {"1 min": 1 / 60, "1 h": 1.0, "10 h": 10.0}
DT = 0.02
NAMES = ["beta_deg", "p_degps", "r_degps", "ay_g", "da_deg", "dr_deg"]
TO_SI = np.array([np.pi / 180, np.pi / 180, np.pi / 180, 1.0, np.pi / 180, np.pi / 180])
MEASURED = """
import resource, subprocess, sys
code = "import sys; from app.cli import main; raise SystemExit(main(sys.argv[1:]))"
subprocess.run(
    [sys.executable, "-c", code, *sys.argv[1:]], stdout=subprocess.DEVNULL, check=True
)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss)
"""


def cpu_s(task: Callable[[], object]) -> float:
    """Median processor time of a call [s]."""
    times = []
    for _ in range(ROUNDS):
        begin = process_time()
        task()
        times.append(process_time() - begin)
    return float(np.median(times))


def flown(n: int, recipe: DatasetRecipe) -> Array:
    """Samples (n, 6) of flights one after the other."""
    per_flight = recipe.maneuver.n_samples(recipe.dt)
    flights = LateralSimulator(recipe).rollouts(-(-n // per_flight), np.random.default_rng(1))
    return flights.y.reshape(-1, 6)[:n]


def a_sample_us(monitor: Monitor, y: Array, n_flights: int = 1) -> float:
    """Processor time of a live sample, its flight among others [us]."""
    samples = list(y[: 2_000 // n_flights + 1])

    def fly() -> None:
        streams = [monitor.stream(exemplars=False) for _ in range(n_flights)]
        for k, sample in enumerate(samples):
            for stream in streams:
                stream.update(k * monitor.dt, sample)

    return 1e6 * cpu_s(fly) / (len(samples) * n_flights)


def row(*cells: object) -> None:
    print(" | ".join(f"{cell!s:>14}" for cell in cells))


def test_costs_by_failures_and_safe_points_and_flights() -> None:
    recipe = DatasetRecipe()
    y = flown(12_100, recipe)
    print()
    row("failures", "safe points", "training [s]", "10^4 p [s]", "sample [us]")
    for n_unsafe in N_UNSAFE:
        dataset = collect(replace(recipe, n_unsafe=n_unsafe, n_obs=10))
        monitor = train(dataset)
        taken = cpu_s(lambda dataset=dataset: train(dataset))
        batch = cpu_s(lambda monitor=monitor: monitor.p_values(y[:10_000]))
        figures = f"{taken:.3f}", f"{batch:.4f}", f"{a_sample_us(monitor, y):.1f}"
        row(n_unsafe, len(monitor.safe_points), *figures)
    rate = collect(replace(recipe, n_unsafe=500)).unsafe_rate
    for n_points in SAFE_POINTS:
        n_unsafe = max(20, round(n_points / 50 * rate / (1 - rate)))
        dataset = collect(replace(recipe, n_unsafe=n_unsafe, n_obs=50))
        monitor = train(dataset)
        taken = cpu_s(lambda dataset=dataset: train(dataset))
        batch = cpu_s(lambda monitor=monitor: monitor.p_values(y[:10_000]))
        figures = f"{taken:.3f}", f"{batch:.4f}", f"{a_sample_us(monitor, y):.1f}"
        row(n_unsafe, len(monitor.safe_points), *figures)
    monitor = train(collect(replace(recipe, n_unsafe=500)))
    row("flights", "sample [us]")
    for n_flights in FLIGHTS:
        row(n_flights, f"{a_sample_us(monitor, y, n_flights):.1f}")


def test_costs_of_the_score_command_by_the_length_of_a_file(tmp_path: Path) -> None:
    recipe = replace(DatasetRecipe(), dt=DT, n_unsafe=100)
    train(collect(recipe)).save(tmp_path / "m.fwm")
    print()
    row("50 Hz for", "rows", "MB", "score [CPU s]", "peak [MB]")
    for words, hours in HOURS.items():
        n, path = round(3600 * hours / DT), tmp_path / "flight.csv"
        table = pd.DataFrame(flown(n, recipe) / TO_SI, columns=NAMES)
        table.insert(0, "t_s", DT * np.arange(n))
        table.to_csv(path, index=False, float_format="%.12g")
        figures = [_scored(tmp_path, path) for _ in range(ROUNDS if n < 1e6 else 1)]
        seconds, peak = np.median(figures, axis=0)
        row(words, n, f"{path.stat().st_size / 1e6:.1f}", f"{seconds:.2f}", f"{peak:.0f}")


def _scored(folder: Path, path: Path) -> tuple[float, float]:
    """Processor time [s] and peak memory [MB] of the command with all that it starts.

    A small process starts it: the peak of one begins with that of the process it comes from.
    """
    command = [str(folder / "m.fwm"), str(path), "-o", str(folder / "out"), "--accept-useless"]
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, "score", *command, "--manoeuvres", "entire"],
        stdout=subprocess.PIPE,
        check=True,
        text=True,
    )
    seconds, kilobytes = done.stdout.split()
    return float(seconds), float(kilobytes) / 1e3
