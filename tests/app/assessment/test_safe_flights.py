"""The band of simulated safe flights, and the interval of a forecast on flights held out."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.assessment.safe_flights import Unavailable, forecast_interval, safe_band
from core.channels import KEYS
from core.dataset import Dataset
from core.monitor import Monitor, MonitorRecipe
from core.monitor.predictor import Identity
from core.monitor.training import train

DT = 0.05
RNG = np.random.default_rng(4)


def flights(n: int, begins: np.ndarray, noise: float = 1e-4) -> np.ndarray:
    """A rudder step at another sample in each flight, and the response to it."""
    y = noise * RNG.standard_normal((n, 81, len(KEYS)))
    for flight, begin in zip(y, begins, strict=True):
        s = DT * np.arange(81 - begin)
        flight[begin:, KEYS.index("delta_r")] += 0.1
        flight[begin:, KEYS.index("beta")] += 0.05 * np.sin(3.0 * s)
    return y


def dataset_of(y: np.ndarray, fails: np.ndarray | None = None, **more: Any) -> Dataset:
    """With two failing flights where none is given."""
    if fails is None:
        y = np.concatenate([y, RNG.standard_normal((2, *y.shape[1:]))])
        fails = np.array([-1] * (len(y) - 2) + [40, 40])
    return Dataset.from_rollouts(y, dt=DT, channels=KEYS, fail_index=fails, **more)


def test_each_flight_is_aligned_where_its_input_is_detected() -> None:
    begins = RNG.integers(10, 25, 200)
    band = safe_band(dataset_of(flights(200, begins)))
    assert band.n_flights == 200
    beta = KEYS.index("beta")
    after = band.t > 0.5
    expected = 0.05 * np.sin(3.0 * band.t[after])
    assert band.low[after, beta] == pytest.approx(expected, abs=0.01)
    assert band.high[after, beta] == pytest.approx(expected, abs=0.01)
    rudder = band.high[:, KEYS.index("delta_r")]
    assert (rudder[band.t < -1.5 * DT] < 0.01).all()  # detected with the first sample or the next
    assert (rudder[band.t > DT / 2] > 0.09).all()
    assert band.onset == pytest.approx(np.median(begins) * DT, abs=1.01 * DT)


def test_nine_of_ten_flights_lie_in_the_band_at_each_time() -> None:
    sizes = RNG.uniform(0.5, 1.5, (400, 1, 1))
    band = safe_band(dataset_of(sizes * flights(400, np.full(400, 12))))
    beta, late = KEYS.index("beta"), np.argmin(np.abs(band.t - 0.5))
    value = sizes[:, 0, 0] * 0.05 * np.sin(1.5)
    inside = (value >= band.low[late, beta]) & (value <= band.high[late, beta])
    assert inside.mean() == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize(("y", "word"), [
    (flights(20, np.full(20, 12)), "20 safe flights"),
    (flights(60, np.full(60, 81)), "detected"),
])  # fmt: skip
def test_a_dataset_without_a_band_gives_its_reason(y: np.ndarray, word: str) -> None:
    with pytest.raises(Unavailable, match=word):
        safe_band(dataset_of(y))


def trained() -> tuple[Dataset, Monitor]:
    y = flights(300, RNG.integers(10, 25, 300), noise=3e-3)
    y[:60, :, KEYS.index("Ny")] = np.linspace(0, 0.6, 81)
    fails = np.where(np.arange(300) < 60, 68, -1)
    data = dataset_of(y, fails, limits={"Ny": 0.5})
    return data, train(data, MonitorRecipe())


def test_the_interval_holds_nine_of_ten_errors_of_fresh_safe_flights() -> None:
    data, monitor = trained()
    interval = forecast_interval(monitor, data)
    fresh = flights(200, RNG.integers(10, 25, 200), noise=3e-3)
    errors = []
    for y in fresh:
        y_hat = monitor.assess(np.arange(81) * DT, y).y_hat
        errors.append(y[monitor.h :] - y_hat[: -monitor.h])
    error = np.concatenate(errors)
    inside = (error >= interval.low) & (error <= interval.high)
    assert inside.mean(axis=0) == pytest.approx(0.9, abs=0.02)
    assert 0 <= interval.covered <= 1


def test_a_method_without_a_forecast_has_no_interval() -> None:
    data, monitor = trained()
    without = replace(monitor, recipe=replace(monitor.recipe, predictor=Identity()))
    with pytest.raises(Unavailable, match="forecasts no channel"):
        forecast_interval(without, data)
