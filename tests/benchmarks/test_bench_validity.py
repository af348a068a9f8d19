"""Validity against the plain numpy way, on one hour at 100 Hz; and of a sample in flight."""

from dataclasses import replace
from time import perf_counter

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from core.collection import DatasetRecipe, Simulator, collect, fresh
from core.monitor import Monitor, train

pytestmark = pytest.mark.benchmark
N_SAMPLES = 360_000


@pytest.fixture(scope="module")
def monitor() -> Monitor:
    recipe = DatasetRecipe(n_unsafe=200, seed=1)
    dataset = collect(recipe)
    return train(dataset, fresh=fresh(recipe))


def best(call, n: int = 5) -> float:
    def once() -> float:
        begin = perf_counter()
        call()
        return perf_counter() - begin

    return min(once() for _ in range(n))


def test_a_recording_is_judged(monitor: Monitor) -> None:
    flights = Simulator(DatasetRecipe()).rollouts(3_000, np.random.default_rng(3)).y
    y = np.ascontiguousarray(flights.reshape(-1, 6)[:N_SAMPLES])
    t = np.arange(N_SAMPLES, dtype=np.float64) * monitor.dt
    said, support = monitor.assess(t, y, withdraw=False), monitor.support
    assert support is not None

    def plainly() -> tuple[float, float]:
        o = sliding_window_view(y, 5, axis=0).swapaxes(1, 2).reshape(-1, 30)
        white = (o @ support.innovation.matrix + support.innovation.offset)[:, :4]
        energy = np.convolve(np.square(white).sum(axis=1), np.ones(10))
        near = monitor.safe_points[said.nearest_safe]
        distance = np.linalg.norm(said.y_hat / monitor.scale - near, axis=1)
        return np.sqrt(energy.max() / 40), distance.max()

    verdict = monitor.judge(t, y, said)
    assert (verdict.residual, verdict.distance) == pytest.approx(plainly(), rel=1e-9)
    ours, plain = best(lambda: monitor.judge(t, y, said)), best(plainly)
    print(
        f"\njudging {N_SAMPLES:,} samples: {1e3 * ours:.0f} ms, numpy {plain / ours:.1f} x as long"
    )
    assert ours < plain


def test_a_sample_in_flight_is_judged_in_less_than_it_is_assessed(monitor: Monitor) -> None:
    y = Simulator(DatasetRecipe()).rollouts(1, np.random.default_rng(4)).y[0]
    samples, bare = [np.ascontiguousarray(sample) for sample in y], replace(monitor, support=None)

    def fly(validity: bool) -> None:
        stream = (monitor if validity else bare).stream()
        for k, sample in enumerate(samples):
            stream.update(k * monitor.dt, sample)

    alone, both = best(lambda: fly(False), 50), best(lambda: fly(True), 50)
    each = 1e6 * (both - alone) / len(samples)
    print(f"\nvalidity takes {each:.1f} us a sample beside {1e6 * alone / len(samples):.1f} us")
    assert both < 2 * alone
