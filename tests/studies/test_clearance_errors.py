"""Model errors: their flights, and the table of clearances."""

from dataclasses import replace

import numpy as np
import pytest

from core.evaluation.lead_sweep import TESTS
from core.planned_test.planned_test import LateralSimulator, SensorNoise
from tests.studies import clearance_errors
from tests.studies.clearance_errors import (
    MODEL_ERRORS,
    ErrorTableRecipe,
    error_table,
    softened,
)

BY_WORDS = {error.words: error for error in MODEL_ERRORS}


@pytest.mark.parametrize("name", TESTS)
def test_an_aircraft_without_softening_flies_like_the_linear_one(name: str) -> None:
    """The numerical integration against the exact rollout."""
    simulator = LateralSimulator(replace(TESTS[name], noise=SensorNoise()))
    theta = simulator.plant.sample(5, np.random.default_rng(1))
    exact = simulator.fly(theta, np.random.default_rng(2))[0].y
    outputs = softened(simulator, theta, 0.0, np.random.default_rng(2))
    np.testing.assert_allclose(outputs, exact, atol=2e-4 * np.abs(exact).max())


def test_softening_makes_the_aircraft_swing_farther() -> None:
    """More so for a larger input."""
    planned, grown = replace(TESTS["F-16"], noise=SensorNoise()), []
    for part in (0.25, 1.0, 1.5):
        peak = part * planned.maneuver.peak_deg
        simulator = LateralSimulator(replace(planned, maneuver=planned.maneuver.with_peak(peak)))
        theta = simulator.plant.nominal[np.newaxis]
        linear, soft = (
            np.abs(softened(simulator, theta, lost, np.random.default_rng(2))[..., 0]).max()
            for lost in (0.0, 0.3)
        )
        grown.append(soft / linear - 1.0)
    assert 0.0 < grown[0] < 0.01 < grown[1] < grown[2]


def test_noise_that_is_not_modelled_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Twice the noise is detected on all flights; the modelled noise on few."""
    some = (BY_WORDS["as modelled"], BY_WORDS["noise twice as large"])
    monkeypatch.setattr(clearance_errors, "MODEL_ERRORS", some)
    recipe = ErrorTableRecipe(tests=("ATTAS",), n_aircraft=100, n_exceeding=20, epsilon=0.1)
    modelled, noisy = error_table(recipe)
    assert modelled.error == "as modelled"
    assert modelled.n_exceed + modelled.n_safe == 100
    assert modelled.flagged <= 20
    assert noisy.flagged >= 95
    assert noisy.wrongly_unflagged == 0


def test_an_unknown_test_is_refused() -> None:
    with pytest.raises(ValueError, match="'B-52' was given: choose F-16"):
        ErrorTableRecipe(tests=("B-52",))


SHOWN = (
    "as modelled",
    "yaw stiffness falls by 20 % with sideslip",
    "noise twice as large",
    "N_y reads 0.85",
)


@pytest.mark.fuzz
def test_a_second_step_reveals_softening(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few wrong clearances stay unflagged after two steps; more after one."""
    wrong = {}
    for steps, shown in (((0.6,), SHOWN[:2]), ((0.4, 0.6), SHOWN)):
        errors = tuple(BY_WORDS[words] for words in shown)
        monkeypatch.setattr(clearance_errors, "MODEL_ERRORS", errors)
        recipe = ErrorTableRecipe(tests=("F-16",), steps=steps, n_aircraft=300, seed=5)
        modelled, soft, *others = error_table(recipe)
        assert modelled.flagged <= 0.1 * 300
        assert soft.wrongly / soft.n_exceed > 0.05
        wrong[len(steps)] = soft.wrongly_unflagged / soft.n_exceed
    noisy, misread = others
    assert noisy.flagged == 300
    assert misread.wrongly_unflagged > 0, "no fit detects it"
    assert wrong[2] < 0.05 < wrong[1]
