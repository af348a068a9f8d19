import hashlib
import io
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter, perf_counter_ns

import numpy as np
import pytest

from app.recipes.recipes import USUAL_MONITOR
from core.kernels import assessing as live_path
from core.kernels.compiled import entry, jit, on_this_thread
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.predictor import Linear
from core.monitor.training import SafeObservations
from core.planned_test.collection import (
    DatasetRecipe,
    collect,
    combination_failures,
    evaluation_flights,
    fresh,
)
from core.planned_test.near import near_failures
from core.planned_test.planned_test import LateralSimulator
from tests.benchmarks.pairs import in_turns
from tests.benchmarks.peers import CKDTreeMonitor

pytestmark = pytest.mark.benchmark


def monitor_of(n_safe_points: int) -> tuple[Monitor, np.ndarray]:
    """Return a monitor of about so many safe points, and a fresh flight of 12,100 samples."""
    recipe = replace(DatasetRecipe(), n_obs=50)
    rate = collect(replace(recipe, n_unsafe=500)).unsafe_rate
    n_unsafe = max(20, round(n_safe_points / recipe.n_obs * rate / (1 - rate)))
    monitor = train(collect(replace(recipe, n_unsafe=n_unsafe)))
    flights = LateralSimulator(recipe).rollouts(100, np.random.default_rng(1))
    return monitor, flights.y.reshape(-1, 6)


@jit
def _fly(fitted, exact, buffer, status, clock, dt, y, z):
    risk = 0.0
    for k in range(y.shape[0]):
        risk += live_path.update(fitted, exact, buffer, status, clock, dt, k * dt, y[k], z)[1]
    return risk


def compiled_flight(monitor: Monitor, y: np.ndarray) -> None:
    """Assess a flight without returning to Python."""
    stream = monitor.stream()
    state = (stream._buffer, stream._status, stream._clock)
    _fly(stream._fitted, stream._exact, *state, monitor.dt, y, stream._point)


def python_calls(monitor: Monitor, y: np.ndarray) -> np.ndarray:
    """Time of each whole Python call [µs]."""
    stream = monitor.stream()
    times = np.empty(len(y))
    for k, sample in enumerate(y):
        begin = perf_counter_ns()
        stream.update(k * monitor.dt, sample)
        times[k] = (perf_counter_ns() - begin) / 1e3
    return times


@pytest.mark.parametrize("n_points", [5_000, 500_000])
def test_one_sample_to_assessment(n_points: int) -> None:
    monitor, y = monitor_of(n_points)
    peer = CKDTreeMonitor(monitor)
    pair = in_turns(
        lambda: compiled_flight(monitor, y), lambda: [peer.update(sample) for sample in y]
    ).per(len(y))
    p50, p99 = np.percentile(python_calls(monitor, y), [50, 99])
    print(
        f"\n{len(monitor.safe_points)} safe points: compiled {pair.ours.min() * 1e6:.2f} µs, "
        f"Python call median {p50:.1f} µs, p99 {p99:.1f} µs; numpy + cKDTree {pair}"
    )
    assert np.mean(monitor.p_values(y) != peer.p_values(y)) < 1e-4  # rounding of BLAS


def test_a_call_by_its_table_of_addresses() -> None:
    """Against the call that takes the nested tuples of the monitor apart."""
    monitor, y = monitor_of(5_000)
    stream, samples = monitor.stream(), list(y)
    state = (stream._fitted, stream._exact, stream._buffer, stream._status, stream._clock)
    by_tuples = entry(live_path.update, *state, monitor.dt, 0.0, samples[0], stream._point)
    call, by_table = stream._call, stream._update

    def taken_apart() -> None:
        for k, sample in enumerate(samples):
            by_tuples(*state, monitor.dt, k * monitor.dt, sample, stream._point)

    def laid_out() -> None:
        for k, sample in enumerate(samples):
            by_table(*call, k * monitor.dt, sample)

    pair = in_turns(laid_out, taken_apart).per(len(samples))
    print(f"\na call by its table: {pair.ours.min() * 1e6:.2f} µs; by nested tuples {pair}")


def test_a_sample_of_the_usual_rule_against_neighbours_alone() -> None:
    """The neighbours are searched once; the two forecasts of a peak come on top."""
    recipe = DatasetRecipe(n_unsafe=500).as_trained()
    dataset, fresh_failures = collect(recipe), combination_failures(recipe, 500)[0]
    near = near_failures(recipe, 500)
    usual = train(dataset, USUAL_MONITOR, failures=fresh_failures, near=near)
    alone = train(dataset, MonitorRecipe(guarantee="95%"))
    flights = list(evaluation_flights(recipe, 50).y)

    def flown(monitor: Monitor) -> None:
        for y in flights:
            python_calls(monitor, y)

    pair = in_turns(lambda: flown(usual), lambda: flown(alone)).per(sum(map(len, flights)))
    print(f"\na sample of the usual rule {pair.ours.min() * 1e6:.1f} µs; neighbours alone {pair}")


def test_batch_scoring_of_an_hour_at_100_hz() -> None:
    monitor, _ = monitor_of(14_600)
    flights = LateralSimulator(DatasetRecipe()).rollouts(2976, np.random.default_rng(2))
    y = flights.y.reshape(-1, 6)[:360_000]
    peer = CKDTreeMonitor(monitor)
    assert np.mean(monitor.p_values(y) != peer.p_values(y)) < 1e-4  # rounding of BLAS
    with on_this_thread():
        one = in_turns(lambda: monitor.p_values(y), lambda: peer.p_values(y))
    two = in_turns(lambda: monitor.p_values(y), lambda: peer.p_values(y, workers=2))
    print(
        f"\n360,000 samples, {len(monitor.safe_points)} safe points: {two.ours.min():.3f} s; "
        f"cKDTree, both on one thread {one}; both on two threads {two}"
    )


def test_p_values_alone_of_an_hour_at_100_hz() -> None:
    """Against assessing every sample, whose scores need every neighbour."""
    recipe = replace(DatasetRecipe(), n_unsafe=500)
    monitor = train(collect(recipe), fresh=fresh(recipe))
    y = LateralSimulator(recipe).rollouts(2976, np.random.default_rng(2)).y.reshape(-1, 6)[:360_000]
    t = np.arange(len(y)) * monitor.dt
    for flown, what in ((monitor, "with"), (replace(monitor, support=None), "without")):
        assert flown.p_values(y).tobytes() == flown.assess(t, y).p_value.tobytes()
        pair = in_turns(partial(flown.p_values, y), partial(flown.assess, t, y))
        print(
            f"\n360,000 p-values {what} validity, {monitor.n_unsafe} failures: "
            f"{pair.ours.min():.3f} s; assessing every sample {pair}"
        )


@pytest.mark.parametrize("n_unsafe", [50, 500, 5_000])
def test_exact_p_values_of_trajectory_calibration(n_unsafe: int) -> None:
    """Against the simple ones of the same failures."""
    dataset = collect(replace(DatasetRecipe(), n_unsafe=n_unsafe))
    y = LateralSimulator(DatasetRecipe()).rollouts(200, np.random.default_rng(1)).y.reshape(-1, 6)
    exact, simple = (
        train(dataset, MonitorRecipe(calibration="trajectory", p_value=p_value))
        for p_value in ("exact", "simple")
    )
    pair = in_turns(lambda: compiled_flight(simple, y), lambda: compiled_flight(exact, y))
    print(
        f"\n{n_unsafe} failures, {len(exact.exact.points)} samples: a simple p-value "
        f"{1e6 * pair.ours.min() / len(y):.2f} µs, an exact one {pair}"
    )


def test_training_on_more_than_a_million_observations() -> None:
    code = (
        "import resource\n"
        "from dataclasses import replace\n"
        "from time import perf_counter\n"
        "from core.planned_test.collection import DatasetRecipe, collect\n"
        "from core.monitor import train\n"
        "begin = perf_counter()\n"
        "monitor = train(collect(replace(DatasetRecipe(), n_unsafe=5000, n_obs=100)))\n"
        "peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6\n"
        "print(f'{monitor.n_unsafe} unsafe, {len(monitor.safe_points)} safe observations: '\n"
        "      f'{perf_counter() - begin:.1f} s, peak memory {peak:.2f} GB')\n"
    )
    print("\n" + _run(code))


def test_fitting_a_million_safe_observations() -> None:
    """Against least squares on the matrix as a whole."""
    dataset = collect(replace(DatasetRecipe(), n_unsafe=5000, n_obs=100))
    rows, rows_ahead = SafeObservations(dataset, MonitorRecipe())._pairs
    o, ahead = rows[:], rows_ahead[:]
    known = ~np.isnan(ahead[:, 0])

    def at_once() -> np.ndarray:
        centred = np.hstack([o - o[known].mean(axis=0), ahead - ahead[known].mean(axis=0)])[known]
        return np.linalg.lstsq(centred[:, :18], centred[:, 18:], rcond=None)[0]

    np.testing.assert_allclose(
        Linear().fit(rows, rows_ahead).matrix, at_once(), rtol=1e-6, atol=1e-9
    )
    pair = in_turns(lambda: Linear().fit(rows, rows_ahead), at_once)
    print(f"\nfit of {len(o):,} observations: {pair.ours.min():.2f} s; all at once {pair}")


def test_saving_a_million_safe_points(tmp_path: Path) -> None:
    """Against an archive that compresses everything, its digest taken afterwards."""
    monitor = train(collect(replace(DatasetRecipe(), n_unsafe=5000, n_obs=100)))
    with np.load(io.BytesIO(monitor.to_bytes().split(b"\n", 2)[2])) as archive:
        arrays = dict(archive)

    def compressed() -> None:
        body = io.BytesIO()
        np.savez_compressed(body, **arrays)  # pyright: ignore[reportArgumentType]
        digest = hashlib.sha256(body.getvalue()).hexdigest().encode()
        (tmp_path / "compressed").write_bytes(digest + body.getvalue())

    pair = in_turns(lambda: monitor.save(tmp_path / "monitor"), compressed)
    mine, theirs = ((tmp_path / name).stat().st_size for name in ("monitor", "compressed"))
    print(
        f"\nsaving {len(monitor.safe_points):,} safe points: {pair.ours.min():.2f} s, "
        f"{mine / 1e6:.0f} MB ({mine / theirs:.2f} of what is compressed); compressing {pair}"
    )


def test_first_sample_in_a_fresh_process(tmp_path: Path) -> None:
    monitor, y = monitor_of(5_000)
    path = tmp_path / "monitor.fwm"
    monitor.save(path)
    code = (
        "import sys\n"
        "from core.monitor import load\n"
        f"print(load(sys.argv[1]).stream().update(0.0, {y[0].tolist()}).p_value)\n"
    )
    _run(code, str(path))
    begin = perf_counter()
    _run(code, str(path))
    print(f"\nfresh process, load and first sample, warm cache: {perf_counter() - begin:.2f} s")


def _run(code: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env=os.environ,
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip()
