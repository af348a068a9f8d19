"""Validity on simulated plants: how often it is wrong of flights like those of training, and how
often it finds a flight that is not.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from core.channels import KEYS
from core.kernels.deviation import Reference, largest_so_far
from core.monitor import Monitor, train
from core.monitor.training import with_validity
from core.monitor.validity.support import LEVEL
from core.planned_test.collection import DatasetRecipe, collect
from core.planned_test.planned_test import LateralSimulator, SensorNoise
from core.simulation.aircraft import PublishedAircraft
from core.simulation.control_law import CONTROL_LAWS, RateDamper
from core.simulation.maneuver import Doublet
from core.types import Array, Indices

NOISE = SensorNoise(beta=5e-4, p=4e-3, r=1e-3, Ny=4e-3, delta_a=3e-4, delta_r=3e-4)
PLANTS = {
    "f16": (PublishedAircraft("f16_sl_h0_v502", 3), "f16_damper", 9.5, SensorNoise()),
    "f104a": (PublishedAircraft("f104a_sl_m0p8", 3), "f104a_damper", 3.7, SensorNoise()),
    "attas": (PublishedAircraft("attas_id_16kft", 4), "none", 9.6, NOISE),
}
EVERY_TIME = "f16"
"""The plant whose error rates `make test` counts; `make fuzz` counts the others' as well."""
N_CALIBRATE, N_FRESH, N_FITS = 1_000, 1_000, 12


def recipe_of(name: str) -> DatasetRecipe:
    aircraft, law, amplitude, noise = PLANTS[name]
    return DatasetRecipe(
        aircraft=aircraft,
        control_law=CONTROL_LAWS[law],
        maneuver=Doublet(surface="rudder", amplitude_deg=amplitude),
        noise=noise,
        n_unsafe=60,
        seed=5,
    )


def farthest(reference: Reference, y: Array, last: Indices) -> Array:
    """(n, 2) what each flight reaches up to sample `last`."""
    return largest_so_far(reference, y, last)[np.arange(len(y)), last]


@dataclass
class Plant:
    """A planned test, a monitor trained for it, and fresh flights."""

    recipe: DatasetRecipe
    monitor: Monitor

    def strays(self, y: Array) -> Array:
        """(n, 2) what each flight reaches up to its first violation or its end."""
        assert self.monitor.validity_basis
        last = np.minimum(self.recipe.specification.first_exceedance(y), y.shape[1] - 1)
        return farthest(self.monitor.validity_basis.reference, y, last)

    def share_invalid(self, y: Array) -> float:
        assert self.monitor.support
        return float((self.strays(y) > self.monitor.support.bounds()).any(axis=1).mean())


@pytest.fixture(scope="module", params=PLANTS)
def plant(request: pytest.FixtureRequest) -> Plant:
    recipe = recipe_of(request.param)
    dataset = collect(recipe)
    monitor, rng = train(dataset), np.random.default_rng(6)
    fresh = LateralSimulator(recipe).rollouts(N_CALIBRATE, rng)
    return Plant(recipe, with_validity(monitor, dataset, [fresh]))


@pytest.mark.parametrize(
    "plant",
    [pytest.param(name, marks=() if name == EVERY_TIME else pytest.mark.fuzz) for name in PLANTS],
    indirect=True,
)
def test_at_most_the_level_of_either_kind_is_wrongly_called_invalid(plant: Plant) -> None:
    """Over calibration sets, as the promise is made; and at 0.1 the rule is not idle."""
    basis, simulator = plant.monitor.validity_basis, LateralSimulator(plant.recipe)
    assert basis
    reference, rng = basis.reference, np.random.default_rng(7)
    shares: dict[tuple[str, float], list[float]] = {}
    for _ in range(N_FITS):
        flights = simulator.rollouts(N_CALIBRATE + N_FRESH, rng)
        last = np.minimum(flights.fail_index, flights.y.shape[1] - 1)
        reached = farthest(reference, flights.y, last)
        old = np.arange(len(reached)) < N_CALIBRATE
        kinds = {"safe": ~flights.is_unsafe, "failing": flights.is_unsafe}
        safe, unsafe = (np.sort(reached[old & kind], axis=0) for kind in kinds.values())
        support = replace(basis.support, safe=safe, unsafe=unsafe)
        for level in (LEVEL, 0.1):
            is_invalid = np.any(reached > replace(support, level=level).bounds(), axis=1)
            for name, kind in kinds.items():
                share = np.mean(is_invalid[np.flatnonzero(kind & ~old)])
                shares.setdefault((name, level), []).append(float(share))
    for (name, level), found in shares.items():
        error = np.std(found, ddof=1) / np.sqrt(N_FITS)
        print(f"{name} at {level}: {np.mean(found):.4f} +- {error:.4f} called invalid")
        assert np.mean(found) <= level + 3 * error, (name, level)
    assert np.mean(shares["failing", 0.1]) > 0.03


# --- flights that are not like those of training -------------------------------------------------

BETA, NY, DELTA_A, DELTA_R = (KEYS.index(key) for key in ("beta", "Ny", "delta_a", "delta_r"))
ANGLES = [KEYS.index(key) for key in ("beta", "p", "r", "delta_a", "delta_r")]


def edit(*channels: int, by: Callable[[Array], Array]) -> Callable[[Array], Array]:
    def edited(y: Array) -> Array:
        y = y.copy()
        y[..., list(channels)] = by(y[..., list(channels)])
        return y

    return edited


def frozen(y: Array) -> Array:
    """The sensor gives its value of 1 s for ever."""
    y = y.copy()
    y[:, 20:] = y[:, 20:21]
    return y


WRONG_SENSORS = {
    "rudder with the other sign": edit(DELTA_R, by=np.negative),
    "sideslip with the other sign": edit(BETA, by=np.negative),
    "N_y with the other sign": edit(NY, by=np.negative),
    "degrees taken for radians": edit(*ANGLES, by=np.degrees),
    "radians taken for degrees": edit(*ANGLES, by=np.radians),
    "sideslip in degrees": edit(BETA, by=np.degrees),
    "N_y in m/s2": edit(NY, by=lambda y: 9.81 * y),
    "sideslip frozen": edit(BETA, by=frozen),
    "rudder frozen": edit(DELTA_R, by=frozen),
    "N_y frozen": edit(NY, by=frozen),
    "N_y with gravity of a bank of 20 degrees": edit(NY, by=lambda y: y + 0.34),
    "white noise of ten times the sensors'": lambda y: (
        y
        + 10
        * np.array([getattr(NOISE, key) for key in KEYS])
        * np.random.default_rng(1).standard_normal(y.shape)
    ),
}


@pytest.mark.parametrize("wrong", WRONG_SENSORS)
def test_a_wrong_sensor_is_found(plant: Plant, wrong: str) -> None:
    flights = LateralSimulator(plant.recipe).rollouts(100, np.random.default_rng(8))
    share = plant.share_invalid(WRONG_SENSORS[wrong](flights.y))
    print(f"{wrong}: {share:.2f} called invalid")
    assert share >= 0.9


def flown_as(recipe: DatasetRecipe, **changes: Any) -> DatasetRecipe:
    """The same test with another manoeuvre: its fields that change."""
    return replace(recipe, maneuver=replace(recipe.maneuver, **changes))


def amplitude(recipe: DatasetRecipe) -> float:
    assert isinstance(recipe.maneuver, Doublet)
    return recipe.maneuver.amplitude_deg


def other_gains(recipe: DatasetRecipe) -> DatasetRecipe:
    """The damper's gains doubled; a damper where there was none."""
    law = recipe.control_law
    if isinstance(law, RateDamper):
        return replace(recipe, control_law=replace(law, kr=2 * law.kr, kp=2 * law.kp))
    return replace(recipe, control_law=CONTROL_LAWS["f16_damper"])


def jumbo(recipe: DatasetRecipe) -> DatasetRecipe:
    aircraft = PublishedAircraft("b747_40k_m0p8", 4)
    return replace(recipe, aircraft=aircraft, control_law=CONTROL_LAWS["none"])


WRONG_TESTS: dict[str, Callable[[DatasetRecipe], DatasetRecipe]] = {
    "twice the amplitude": lambda recipe: flown_as(recipe, amplitude_deg=2 * amplitude(recipe)),
    "the other way round": lambda recipe: flown_as(recipe, amplitude_deg=-amplitude(recipe)),
    "aileron instead of rudder": lambda recipe: flown_as(recipe, surface="aileron"),
    "other gains": other_gains,
    "another aircraft": jumbo,
}


@pytest.mark.parametrize("wrong", WRONG_TESTS)
def test_another_test_than_the_planned_one_is_found(plant: Plant, wrong: str) -> None:
    recipe = WRONG_TESTS[wrong](plant.recipe)
    flights = LateralSimulator(recipe).rollouts(100, np.random.default_rng(9))
    share = plant.share_invalid(flights.y)
    print(f"{wrong}: {share:.2f} called invalid")
    assert share >= 0.9
