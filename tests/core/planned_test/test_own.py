"""Somebody's own simulator, as an object and as a plain function."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from core.card import CardError
from core.monitor import train
from core.planned_test.collection import (
    CollectionError,
    card_of,
    collect,
    evaluation_flights,
    fresh,
    replanned,
    stopping_flights,
)
from core.planned_test.own import OwnSimulator
from core.planned_test.planned_test import DatasetRecipe
from core.seeds import Branch, stream
from core.simulation.python_simulator import OwnCodeError
from core.simulation.simulator import Flies, Stops
from tests.support.own_pitch import (
    NOISE,
    PARAMETERS,
    Pitch,
    declared,
    fly,
    pitch,
    small_test,
    thing,
)
from tests.support.short_period import DICTIONARY, LIMITS, N_SAMPLES

BOTH = pytest.mark.parametrize("own", [thing, pitch], ids=["object", "function"])


@BOTH
def test_rollouts_are_collected_until_enough_fail_with_their_provenance(own: Any):
    dataset = collect(small_test(own, seed=3))
    assert (len(dataset.unsafe), dataset.seed) == (20, 3)
    assert dataset.dictionary == DICTIONARY
    assert dataset.specification == LIMITS
    assert dataset.theta_names == ("stiffness", "gain")
    assert dataset.recipe["simulator"] == "own_pitch:it"
    assert dataset.recipe["parameters"]["stiffness"] == {"nominal": 6.0, "spread": 1.1}
    last = dataset.unsafe[np.arange(20), dataset.fail_index, DICTIONARY.index("Nz")]
    assert ((last < -1.05) | (last > 2.85)).all()


@BOTH
def test_the_same_seed_gives_the_same_bits(own: Any):
    digests = [collect(small_test(own, seed=seed)).digest() for seed in (1, 1, 2)]
    assert digests[0] == digests[1] != digests[2]


def test_arrays_in_another_order_of_memory_train_the_same_monitor():
    class Transposed(Pitch):
        def rollouts(self, n: int, rng: np.random.Generator):
            y, fails, theta = super().rollouts(n, rng)
            return np.moveaxis(np.moveaxis(y, -1, 0).copy(), 0, -1), fails, theta

    usual, transposed = (collect(small_test(own)) for own in (thing, Transposed()))
    assert usual.digest() == transposed.digest()
    np.testing.assert_array_equal(train(usual).alphas, train(transposed).alphas)


@BOTH
def test_flights_that_train_check_and_test_differ(own: Any):
    test = small_test(own)
    tested, checked = evaluation_flights(test, 20), next(fresh(test, 20))
    every = np.concatenate([collect(test).safe[:20], tested.y, checked.y])
    assert len(np.unique(every.reshape(len(every), -1), axis=0)) == len(every)


def test_capabilities_follow_from_what_a_simulator_has():
    def can(test: Any) -> tuple[bool, bool, bool]:
        simulator = test.simulator()
        return (
            isinstance(simulator, Flies),
            isinstance(simulator, Stops),
            replanned(test) is not None,
        )

    assert can(DatasetRecipe()) == (True, True, True)
    assert can(small_test(pitch)) == (True, True, False)
    assert can(small_test(thing)) == (False, False, False)
    with pytest.raises(CardError):
        card_of(small_test(pitch))
    with pytest.raises(ValueError, match="stop"):
        stopping_flights(small_test(thing), 2)


def test_limits_are_judged_without_noise():
    quiet, noisy = (small_test(replace(pitch, noise=noise)) for noise in ({}, {"Nz": 5.0}))
    flown, hidden = (evaluation_flights(test, 50) for test in (quiet, noisy))
    assert flown.is_unsafe.any()
    assert np.array_equal(flown.fail_index, hidden.fail_index)
    assert np.abs(flown.y - hidden.y)[..., 2].mean() > 1.0


def test_a_manoeuvre_that_is_not_stopped_fails_as_flown_and_one_stopped_at_once_does_not():
    test, n = small_test(pitch), 60
    flown, stopped = evaluation_flights(test, n), stopping_flights(test, n)
    every = np.arange(n)
    assert np.array_equal(stopped(every, np.full(n, N_SAMPLES)), flown.fail_index)
    assert (stopped(every, np.zeros(n, int)) == N_SAMPLES).all()
    some = np.flatnonzero(flown.is_unsafe)[:3]
    assert np.array_equal(stopped(some, np.full(3, N_SAMPLES)), flown.fail_index[some])


def test_given_aircraft_are_flown():
    simulator = small_test(replace(pitch, noise={})).simulator()
    assert isinstance(simulator, Flies)
    theta = np.array([[6.0, 0.5], [3.0, 1.5]])
    flights, peaks = simulator.fly(theta, np.random.default_rng(1))
    assert np.array_equal(flights.theta, theta)
    assert np.array_equal(flights.is_unsafe, [False, True])
    assert peaks[0] < 1 <= peaks[1]


@pytest.mark.parametrize("spread", [0.01, 0.1])
def test_too_few_failures_are_refused_with_the_number_that_would_do(spread: float):
    rare = replace(pitch, parameters=PARAMETERS | {"stiffness": (8.5, 1.0), "gain": (0.8, spread)})
    with pytest.raises(CollectionError, match=r"out of reach within 2000 rollouts") as refused:
        collect(small_test(rare, n_unsafe=1_000))
    told = str(refused.value)
    if not told.startswith("0 of"):
        made, n = int(told.split()[2]), int(told.split()[0])
        assert f"to about {-(-1_000 * made // n)}" in told


def broken(theta: dict[str, float], inputs: Any, t: Any) -> Any:
    return [[1.0 / (theta["gain"] - theta["gain"])]]


def with_nan(theta: dict[str, float], inputs: Any, t: Any) -> Any:
    rows = np.array(fly(theta, inputs, t))
    rows[7, 2] = np.nan
    return rows


def some(change: Any) -> Any:
    """The pitch with other outputs for the aircraft of a gain above 1."""

    def changed(theta: dict[str, float], inputs: Any, t: Any) -> Any:
        rows = fly(theta, inputs, t)
        return change(rows) if theta["gain"] > 1 else rows

    return declared(changed)


def stopped(rows: Any) -> Any:
    raise RuntimeError("no convergence")


THEIRS = r"changed \(test_own\.py, line \d+\), rollout [12] of 50 \(stiffness=[\d.]+, gain=1\.\d+\)"


@pytest.mark.parametrize(
    ("own", "told"),
    [
        (some(lambda rows: rows[:-5]), r"outputs is of shape \(76, 4\): return \(81 samples, 4"),
        (
            some(lambda rows: [*rows[:-1], [0.0]]),
            r"outputs\[80\] has shape \(1,\), the first .*\(4,\)",
        ),
        (some(lambda rows: [*rows[:-1], [0, "a", 0, 0]]), r"outputs\[80\]\[1\] is 'a' of type str"),
        (
            some(lambda rows: [*rows[:-1], [0, "1.5", 0, 0]]),
            r"outputs\[80\]\[1\] is '1.5' of type str",
        ),
        (some(lambda rows: np.array(rows) + 1j), r"outputs\[0\]\[0\] is .* of type complex128"),
        (some(lambda rows: np.array(rows, object)), r"outputs\[0\] is an array of objects"),
        (some(lambda rows: None), "outputs is None: return"),
        (some(lambda rows: "ok"), "outputs is 'ok' of type str: return"),
        (some(stopped), r"failed in test_own\.py, line \d+, 'raise Runtime.*no convergence"),
    ],
    ids=[
        *("short", "ragged", "text", "text of a number", "complex", "objects"),
        *("none", "string", "raises"),
    ],
)
def test_the_rollout_and_output_that_cannot_be_used_are_named(own: Any, told: str):
    with pytest.raises(OwnCodeError, match=f"{THEIRS}.*{told}") as refused:
        evaluation_flights(small_test(own), 50)
    assert "own.py, line" not in str(refused.value).replace("test_own.py", "")


@pytest.mark.parametrize(
    ("inputs", "told"),
    [
        (lambda rng: None, "inputs of rollout 1 is None"),
        (lambda rng: "up", "inputs of rollout 1 is 'up' of type str"),
        (lambda rng: np.full(9, np.nan), r"of shape \(9,\) with missing or infinite"),
        (lambda rng: [], r"of shape \(0,\): give finite numbers"),
        (lambda rng: np.zeros(rng.integers(60, 70)), r"of rollout \d is .* that of rollout 1"),
        (lambda: None, r"inputs of rollout 1 failed in test_own\.py.*positional"),
    ],
)
def test_inputs_that_cannot_be_used_are_named(inputs: Any, told: str):
    with pytest.raises(OwnCodeError, match=told):
        evaluation_flights(small_test(replace(pitch, inputs=inputs)), 50)


def two(theta: Any, inputs: Any) -> Any: ...


def test_a_function_with_other_arguments_is_named():
    with pytest.raises(OwnCodeError, match=r"test_own\.py, line \d+, 'def two\(.*TypeError"):
        evaluation_flights(small_test(declared(two)), 50)  # pyright: ignore


class Unequal(Pitch):
    def rollouts(self, n: int, rng: np.random.Generator) -> Any:
        y, _, theta = super().rollouts(n, rng)
        return [each[: 80 + (k != 3)] for k, each in enumerate(y)], None, theta


class Worded(Pitch):
    def rollouts(self, n: int, rng: np.random.Generator) -> Any:
        y, _, theta = super().rollouts(n, rng)
        return y, ["late"] * n, theta


@pytest.mark.parametrize(
    ("own", "told"),
    [
        (Unequal(), r"y\[3\] has shape \(80, 4\), the first one \(81, 4\): give \(50 flights"),
        (Worded(), r"fail_index\[0\] is 'late' of type str"),
    ],
)
def test_the_output_of_an_object_is_named(own: Any, told: str):
    with pytest.raises(OwnCodeError, match=told):
        evaluation_flights(small_test(own), 50)


def test_outputs_in_degrees_are_refused():
    def degrees(*about: Any) -> Any:
        return np.rad2deg(fly(*about))

    with pytest.raises(OwnCodeError, match=r"alpha up to .* rad.* return it in rad"):
        OwnSimulator.of(declared(degrees), "it").outputs(9, 0)


class Flagged(Pitch):
    def rollouts(self, n: int, rng: np.random.Generator) -> Any:
        y, _, theta = super().rollouts(n, rng)
        return y, np.zeros(n, bool), theta


class Stopping(Pitch):
    def stopping(self, n: int, rng: np.random.Generator) -> Any:
        return 5


class FlownWrong(Pitch):
    def fly(self, theta: Any, rng: np.random.Generator) -> Any:
        return theta


class Labelled(Pitch):
    def rollouts(self, n: int, rng: np.random.Generator) -> Any:
        y, _, theta = super().rollouts(n, rng)
        return y, np.where(np.arange(n) % 3, -1, 40), theta


class WithoutLabels(Pitch):
    def rollouts(self, n: int, rng: np.random.Generator) -> Any:
        y, _, theta = super().rollouts(n, rng)
        return y, theta


class OtherTheta(Pitch):
    def rollouts(self, n: int, rng: np.random.Generator) -> Any:
        y, _, theta = super().rollouts(n, rng)
        return y, None, theta[:, :1]


@pytest.mark.parametrize(
    ("own", "told"),
    [
        (declared(with_nan), r"own_pitch:it returned no finite Nz in 50 of 50 .* 0\.35 s"),
        (declared(lambda theta, inputs, t: fly(theta, inputs, t)[:-1]), r"\(80, 4\).*81 samples"),
        (declared(lambda theta, inputs, t: np.array(fly(theta, inputs, t))[:, :3]), "4 channels"),
        (
            declared(broken),
            r"test_own\.py, line \d+, 'return \[\[1\.0 / .* ZeroDivisionError: ",
        ),
        (WithoutLabels(), "2 values.*y, fail_index .* theta"),
        (Flagged(), "returned true and false as fail_index: give the first failing sample or -1"),
        (Stopping(), "returned type int: return a function of flights and samples"),
        (OtherTheta(), r"theta of shape \(50, 1\): give .* \(50 flights, 2 parameters\)"),
    ],
    ids=["nan", "samples", "channels", "raises", "pair", "flags", "stopping", "theta"],
)
def test_what_cannot_be_used_is_refused_in_one_sentence(own: Any, told: str):
    test = small_test(own)
    flown = stopping_flights if isinstance(own, Stopping) else evaluation_flights
    with pytest.raises(OwnCodeError, match=told) as refused:
        flown(test, 50)
    assert "\n" not in str(refused.value)


def test_labels_tell_without_limits_and_are_asked_for_without_either():
    flights = evaluation_flights(small_test(Labelled(), None), 9)
    assert flights.fail_index.tolist() == [40, N_SAMPLES, N_SAMPLES] * 3
    with pytest.raises(
        ValueError, match=r"no limit tells which flights .* fail, and they have no fail_index"
    ):
        evaluation_flights(small_test(thing, None), 9)


def test_flights_of_another_length_are_refused():
    whole = small_test(thing).simulator().judged(DICTIONARY, LIMITS, N_SAMPLES + 1)
    with pytest.raises(OwnCodeError, match=r"\(5, 81, 4\).*82 samples"):
        whole.rollouts(5, np.random.default_rng(0))


class Unseeded(Pitch):
    def rollouts(self, n: int, rng: np.random.Generator) -> Any:
        return super().rollouts(n, np.random.default_rng())


class Recorded(Pitch):
    def rollouts(self, n: int, rng: np.random.Generator) -> Any:
        y, _, theta = super().rollouts(n, stream(0, Branch.TEST))
        return np.repeat(y[:2], n, axis=0)[:n], None, theta


@pytest.mark.parametrize(
    ("own", "told"),
    [
        (Unseeded(), "same seed"),
        (Recorded(), "8 flights of 9"),
        (FlownWrong(), "returned type ndarray: return three values"),
    ],
)
def test_flights_must_be_reproducible_and_unlike_each_other(own: Any, told: str):
    with pytest.raises(OwnCodeError, match=told):
        OwnSimulator.of(own, "it").outputs(9, 0)


@pytest.mark.parametrize(
    ("own", "told"),
    [
        (fly, "of type function .*, not a simulator: declare it by @simulator"),
        (Pitch, "a class, not a simulator"),
        (3.0, "of type float .*, not a simulator: give an object with dictionary, parameters"),
        (replace(pitch, dt=0.0), "dt=0"),
        (replace(pitch, dt="slow"), "dt is 'slow' of type str"),  # pyright: ignore
        (replace(pitch, noise=[0.1]), "noise=.0.1.: give"),  # pyright: ignore
        (replace(pitch, noise={"Nz": "low"}), "noise of Nz is 'low'"),  # pyright: ignore
        (replace(pitch, noise=NOISE | {"Ny": 0.1}), "'Ny' is unknown"),
        (replace(pitch, noise=NOISE | {"Nz": -0.1}), "noise=-0.1 in Nz"),
        (replace(pitch, channels=["alpha", "load"]), "'load' is unknown"),
        (replace(pitch, parameters={"gain": (1.0, -0.1)}), "spread of 0 or more"),
        (replace(pitch, parameters={"gain": 1.0}), "nominal value, spread"),
        (replace(pitch, distribution="gaussian"), "normal or uniform"),
    ],
)
def test_what_is_no_simulator_is_refused(own: Any, told: str):
    with pytest.raises(ValueError, match=told):
        OwnSimulator.of(own, "it")


def test_uniform_parameters_stay_within_their_spread():
    theta = evaluation_flights(small_test(replace(pitch, distribution="uniform")), 200).theta
    assert (np.abs(theta - [6.0, 1.0]) <= [1.1, 0.18]).all()
    assert np.ptp(theta[:, 0]) > 2.0


def test_modules_that_declare_a_simulator_from_here_still_load():
    from core.planned_test import own
    from core.simulation import python_simulator

    assert own.simulator is python_simulator.simulator
