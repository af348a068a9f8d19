"""Validity against the plain numpy way, on one hour at 100 Hz; and of a sample in flight."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from core.monitor import Monitor, train
from core.monitor.validity.verdict import ValidityVerdict, compare
from core.planned_test.collection import DatasetRecipe, collect, fresh
from core.planned_test.planned_test import LateralSimulator
from tests.benchmarks.pairs import in_turns

pytestmark = pytest.mark.benchmark
N_SAMPLES = 360_000


@pytest.fixture(scope="module")
def monitor() -> Monitor:
    recipe = DatasetRecipe(n_unsafe=200, seed=1)
    dataset = collect(recipe)
    return train(dataset, fresh=fresh(recipe))


def test_a_recording_is_judged(monitor: Monitor) -> None:
    flights = LateralSimulator(DatasetRecipe()).rollouts(3_000, np.random.default_rng(3)).y
    y = np.ascontiguousarray(flights.reshape(-1, 6)[:N_SAMPLES])
    t = np.arange(N_SAMPLES, dtype=np.float64) * monitor.dt
    said, support = monitor.assess(t, y, withdraw=False), monitor.support
    basis = monitor.validity_basis
    assert support is not None
    assert basis is not None

    innovation = support.innovation

    def plainly() -> tuple[float, float]:
        windows = sliding_window_view(y, innovation.history + 1, axis=0)
        o = windows[..., :: innovation.spacing].swapaxes(1, 2).reshape(len(windows), -1)
        white = (o @ innovation.matrix + innovation.offset)[:, :4]
        energy = np.convolve(np.square(white).sum(axis=1), np.ones(innovation.window))
        near = monitor.safe_points[said.nearest_safe]
        distance = np.linalg.norm(said.y_hat / monitor.scale - near, axis=1)
        return np.sqrt(energy.max() / (4 * innovation.window)), distance.max()

    def judged() -> ValidityVerdict:
        return compare(basis, t, y, said.state, said.nearest_safe).verdict(said.y_hat)

    verdict = judged()
    assert (verdict.residual, verdict.distance) == pytest.approx(plainly(), rel=1e-9)
    pair = in_turns(judged, plainly)
    print(
        f"\njudging {N_SAMPLES:,} samples: {1e3 * np.median(pair.ours):.0f} ms; "
        f"numpy takes {pair} as long"
    )


def test_a_sample_in_flight_is_judged_and_assessed(monitor: Monitor) -> None:
    y = LateralSimulator(DatasetRecipe()).rollouts(1, np.random.default_rng(4)).y[0]
    samples, bare = [np.ascontiguousarray(sample) for sample in y], replace(monitor, support=None)

    def fly(flown: Monitor) -> None:
        for _ in range(20):
            stream = flown.stream()
            for k, sample in enumerate(samples):
                stream.update(k * flown.dt, sample)

    pair = in_turns(lambda: fly(monitor), lambda: fly(bare)).per(20 * len(samples))
    print(
        f"\na sample with its validity: {1e6 * np.median(pair.ours):.1f} us; "
        f"assessed alone it takes {pair} as long"
    )
