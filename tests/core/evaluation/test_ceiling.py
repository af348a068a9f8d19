"""The information limit: a calibrated posterior that does not use the future."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import truncnorm

from core.evaluation import ceiling as module
from core.evaluation.ceiling import Ceiling
from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import LateralSimulator
from core.simulation.maneuver import FrequencySweep
from core.simulation.simulator import Rollouts
from core.types import Array

TEST = TESTS["ATTAS"]
N = 24


@pytest.fixture(scope="module")
def ceiling() -> Ceiling:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "N_DRAWN", 32)
        return Ceiling(TEST)


@pytest.fixture(scope="module")
def flown() -> tuple[Rollouts, Array]:
    simulator = LateralSimulator(TEST)
    flights = simulator.rollouts(N, np.random.default_rng(3))
    return flights, simulator.commands(N, np.random.default_rng(3))


def test_the_posterior_is_calibrated(ceiling: Ceiling, flown: tuple[Rollouts, Array]) -> None:
    flights, commands = flown
    plant, now, amplitude = LateralSimulator(TEST).plant, 50, np.deg2rad(TEST.maneuver.peak_deg)
    given = commands[:, : now + 1, 1]
    largest = np.abs(given).max(axis=1)
    level, mean = given * (amplitude / largest)[:, None], np.zeros((N, 16))
    for _ in range(3):
        mean = ceiling._estimated(flights.y[:, : now + 1], level, mean).mean
    mean, root = ceiling._estimated(flights.y[:, : now + 1], level, mean)
    truth = np.column_stack(
        [
            (flights.theta - plant.nominal) / plant.spread,
            (largest / amplitude - 1) / TEST.maneuver.amplitude_jitter,
        ]
    )
    off = np.linalg.solve(root, (truth - mean)[:, :, None])
    assert np.mean(off**2) == pytest.approx(1.0, abs=5 * np.sqrt(2 / off.size))
    assert np.mean((truth - mean) ** 2) < 0.7 * np.mean(truth**2)


def test_a_score_does_not_depend_on_later_samples_and_commands(
    ceiling: Ceiling, flown: tuple[Rollouts, Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "N_DRAWN", 32)
    flights, commands = flown
    y, commands, now = flights.y[:3], commands[:3].copy(), 24
    windows, last = np.array([0, 9]), np.full(3, now)
    scores = ceiling.scores(y, commands, last, windows)
    other = y.copy()
    other[:, now + 1 :] = 7.0
    commands[:, now:] = 0.0
    assert (ceiling.scores(other, commands, last, windows) == scores).all()
    before = np.arange(y.shape[1]) <= np.argmax(commands[:, :, 1] != 0, axis=1)[:, None]
    assert np.isinf(scores[:, before | (np.arange(y.shape[1]) > now)]).all()
    assert np.isfinite(scores[:, ~before][:, :4]).all()


def test_pilots_wait_as_planned_given_the_time_passed(ceiling: Ceiling) -> None:
    for passed in (0, 15, 24):
        waits = ceiling._wait(1, np.array([passed]))[0]
        expected = truncnorm((passed - 20.5) / 2.0 if passed else -np.inf, np.inf, 20.0, 2.0)
        assert waits.mean() == pytest.approx(expected.mean(), abs=0.1)
        assert waits.std() == pytest.approx(expected.std(), rel=0.1)
        assert waits.min() > passed - 0.5


@pytest.mark.parametrize(
    "test",
    [replace(TEST, maneuver=FrequencySweep(amplitude_deg=9.5)), TEST.as_flown()],
    ids=["no steps", "imperfect"],
)
def test_a_test_without_known_probabilities_is_refused(test) -> None:
    with pytest.raises(ValueError, match="needs a manoeuvre of steps"):
        Ceiling(test)
