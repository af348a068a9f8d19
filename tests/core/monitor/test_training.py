"""Training: against the plain twin, by law, at the edges, and the guarantee it is for."""

from dataclasses import fields, replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.dataset import Dataset
from core.evaluation.rates import evaluate
from core.monitor import MonitorRecipe, train
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from tests.support import oscillator
from tests.support import plain_twin as twin
from tests.support.oscillator import N_SAMPLES, TIMES, Array

TWIN_FITS = {
    "linear": twin.fit_linear,
    "identity": twin.fit_identity,
    "pca": twin.fit_pca,
    "last_output": twin.fit_last_output,
}
TWIN_SCORES = {
    "nearest_neighbor": "nearest neighbour",
    "unsafe_distance": "unsafe only",
    "safe_distance": "safe only",
    "negative_magnitude": "|Ny|",
}
OF_POINTS = [name for name, score in SCORES.items() if not score.reads_card]
OF_OBSERVATIONS = [name for name, predictor in PREDICTORS.items() if not predictor.forecast]
"""Those that know no test card."""
MODES = list(product(("pointwise", "trajectory"), ("simple", "exact")))


def mode(calibration: str, p_value: str, **choices: Any) -> MonitorRecipe:
    return MonitorRecipe(calibration=calibration, p_value=p_value, **choices)  # pyright: ignore


# --- the plain twin ------------------------------------------------------------------------------


class Twin:
    """The same monitor from scikit-learn and double loops."""

    def __init__(self, dataset: Dataset, recipe: MonitorRecipe, predictor: str, score: str) -> None:
        assert predictor in TWIN_FITS, (
            "give its fit by hand in TWIN_FITS, see support/plain_twin.py"
        )
        assert score in TWIN_SCORES, "give its twin in TWIN_SCORES, see support/plain_twin.py"
        pairs = list(zip(dataset.safe, dataset.safe_times, strict=True))
        raw = recipe.scaling == "raw"
        self.recipe, self.score = recipe, twin.SCORES[TWIN_SCORES[score]]
        self.scale = np.ones(6) if raw else np.vstack([y[times] for y, times in pairs]).std(axis=0)
        h = twin.lead_steps(recipe.t_early, dataset.dt)
        safe = [y / self.scale for y in dataset.safe]
        observed, paired, ahead = twin.safe_observations(
            safe, list(dataset.safe_times), h, recipe.n_delay
        )
        self.predict = TWIN_FITS[predictor](observed, paired, ahead)
        self.flights = [
            twin.timely_part(self.mapped(y[: fail + 1]), fail, h)
            for y, fail in zip(dataset.unsafe, dataset.fail_index.tolist(), strict=True)
        ]
        self.safe, self.unsafe = self.predict(observed), twin.error_points(self.flights)
        self.alphas = twin.calibrate(self.flights, self.safe, self.score, recipe.calibration)

    def mapped(self, y: Array) -> Array:
        return self.predict(twin.observations(y / self.scale, self.recipe.n_delay))

    def scores(self, y: Array) -> Array:
        return self.score(twin.nearest(self.unsafe), twin.nearest(self.safe))(self.mapped(y))

    def p_values(self, y: Array, samples: list[int]) -> list[float]:
        """p-values of chosen samples of a flight (T, 6)."""
        s, z = self.scores(y), self.mapped(y)
        if self.recipe.p_value == "simple" or self.recipe.score.channel >= 0:
            return twin.p_values(s, self.alphas)[samples].tolist()
        if self.recipe.calibration == "pointwise":
            early = sum(len(flight) == 0 for flight in self.flights)
            return [
                twin.exact_p_value(z[k], self.unsafe, self.safe, self.score, early) for k in samples
            ]
        lowest = np.minimum.accumulate(s)[samples]
        return [self.joined(z[k], low) for k, low in zip(samples, lowest, strict=True)]

    def joined(self, z: Array, lowest: float) -> float:
        """Exact p of a flight whose lowest score so far is given: calibrate again with z."""
        unsafe = [twin.error_points(twin.without(self.flights, i)) for i in range(len(self.alphas))]
        to_safe = twin.nearest(self.safe)
        alphas = [
            self.score(twin.nearest(np.vstack([points, z])), to_safe)(flight).min()
            if len(flight)
            else np.inf
            for flight, points in zip(self.flights, unsafe, strict=True)
        ]
        return float(1 + np.sum(np.array(alphas) >= lowest)) / (len(alphas) + 1)


@pytest.mark.parametrize("scaling", ["raw", "safe_std"])
@pytest.mark.parametrize("score", OF_POINTS)
@pytest.mark.parametrize("predictor", OF_OBSERVATIONS)
def test_monitor_equals_the_plain_twin(
    predictor: str, score: str, scaling: str, dataset: Dataset, flights: Array
) -> None:
    """Every calibration and p-value, one failure too early to be warned of included."""
    choices = {"predictor": PREDICTORS[predictor], "score": SCORES[score], "scaling": scaling}
    if SCORES[score].channel >= 0 and not PREDICTORS[predictor].maps_to_outputs:
        with pytest.raises(ValueError, match="choose the predictor linear or last_output"):
            MonitorRecipe(**choices)  # pyright: ignore[reportArgumentType]
        return
    dataset = oscillator.with_early_failures(dataset, 1)
    samples = [0, 9, 14, 17, 20, 33]
    twins = {
        calibration: Twin(dataset, mode(calibration, "simple", **choices), predictor, score)
        for calibration in ("pointwise", "trajectory")
    }
    for calibration, p_value in MODES:
        recipe = mode(calibration, p_value, **choices)
        peer, monitor = twins[calibration], train(dataset, recipe)
        peer.recipe = recipe
        size = np.abs(peer.alphas[np.isfinite(peer.alphas)]).max()
        np.testing.assert_allclose(monitor.alphas, np.sort(peer.alphas), 1e-9, 1e-9 * size)
        for y in flights[:2]:
            s = peer.scores(y)
            scores = monitor.assess(TIMES, y).score
            np.testing.assert_allclose(scores, s, rtol=1e-9, atol=1e-9 * size)
            # What lies within rounding of a calibration score may fall on either side of it.
            clear = np.abs(s[samples, None] - peer.alphas).min(axis=1) > 1e-9 * size
            p = monitor.p_values(y)[samples]
            assert p[clear].tolist() == np.array(peer.p_values(y, samples))[clear].tolist()
            assert clear.sum() >= 5


def test_this_file_joins_a_point_to_the_failures_as_the_plain_twin_does(
    dataset: Dataset, flights: Array
) -> None:
    recipe = mode("trajectory", "exact")
    peer, y = Twin(dataset, recipe, "linear", "nearest_neighbor"), flights[0]
    expected = twin.exact_trajectory_p_values(peer.mapped(y), peer.flights, peer.safe)
    assert peer.p_values(y, list(range(N_SAMPLES))) == expected.tolist()


@pytest.mark.parametrize("score", OF_POINTS)
def test_ties_count_in_every_p_value(score: str) -> None:
    """Small whole numbers, so that scores tie in plenty and floats are exact."""
    rng = np.random.default_rng(31)
    unsafe, safe, y = (rng.integers(-2, 3, (n, 12, 6)) / 1.0 for n in (9, 6, 8))
    whole = Dataset(
        unsafe=unsafe,
        fail_index=rng.integers(1, 12, 9),
        safe=safe,
        safe_times=np.tile([1, 4, 9], (6, 1)),
        theta_unsafe=np.empty((9, 0)),
        theta_safe=np.empty((6, 0)),
        dt=0.05,
    )
    choices = {"n_delay": 0, "t_early": 0.1, "score": SCORES[score], "scaling": "raw"}
    for calibration, p_value in MODES:
        recipe = mode(calibration, p_value, predictor=PREDICTORS["last_output"], **choices)
        peer, monitor = Twin(whole, recipe, "last_output", score), train(whole, recipe)
        assert monitor.alphas.tolist() == np.sort(peer.alphas).tolist()
        for flight in y:
            p = peer.p_values(flight, list(range(12)))
            assert monitor.p_values(flight).tolist() == p
        assert len(np.intersect1d(peer.scores(y[0]), peer.alphas)) > 0


@pytest.mark.parametrize("score", OF_POINTS)
@pytest.mark.parametrize(("calibration", "p_value"), MODES)
def test_the_extremes_of_a_flight_are_those_of_its_samples(
    calibration: str, p_value: str, score: str, dataset: Dataset
) -> None:
    """Also on samples that were passed over, and where no sample counts."""
    dataset = oscillator.with_early_failures(dataset, 1)
    monitor = train(dataset, mode(calibration, p_value, score=SCORES[score]))
    rng = np.random.default_rng(32)
    y = oscillator.fly(rng, 100)[1]
    last = rng.integers(-1, N_SAMPLES, 100)
    for flight, end, p, s in zip(
        y, last, monitor.highest_p_values(y, last), monitor.lowest_scores(y, last), strict=True
    ):
        said = monitor.assess(TIMES, flight)
        assert p == max(said.p_value[: end + 1], default=0)
        assert s == min(said.score[: end + 1], default=np.inf)


# --- laws ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("score", OF_POINTS)
@pytest.mark.parametrize("calibration", ["pointwise", "trajectory"])
def test_exact_p_value_is_never_above_the_simple_one(
    calibration: str, score: str, dataset: Dataset, flights: Array
) -> None:
    """Pointwise at each sample; at trajectory level against the highest simple one so far."""
    simple, exact = (
        np.array([train(dataset, recipe).p_values(y) for y in flights])
        for recipe in (
            mode(calibration, "simple", score=SCORES[score]),
            mode(calibration, "exact", score=SCORES[score]),
        )
    )
    if calibration == "trajectory" and SCORES[score].channel < 0:
        simple = np.maximum.accumulate(simple, axis=1)
    assert (exact <= simple).all()
    if (score, calibration) != ("unsafe_distance", "trajectory"):
        assert (exact < simple).any() == (score == "nearest_neighbor")


@pytest.mark.parametrize("predictor", OF_OBSERVATIONS)
def test_trajectory_calibration_alerts_no_more_than_pointwise(
    predictor: str, dataset: Dataset, flights: Array
) -> None:
    choices = {"predictor": PREDICTORS[predictor]}
    pointwise = train(dataset, mode("pointwise", "simple", **choices))
    trajectory = train(dataset, mode("trajectory", "simple", **choices))
    assert (trajectory.alphas <= pointwise.alphas).all()
    assert (trajectory.alphas < pointwise.alphas).any()
    assert all((trajectory.p_values(y) <= pointwise.p_values(y)).all() for y in flights)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32), choice=st.sampled_from(MODES))
def test_shuffling_rollouts_changes_no_p_value(
    seed: int, choice: tuple[str, str], dataset: Dataset, flights: Array
) -> None:
    rng = np.random.default_rng(seed)
    unsafe, safe = rng.permutation(len(dataset.unsafe)), rng.permutation(len(dataset.safe))
    shuffled = replace(
        dataset,
        unsafe=dataset.unsafe[unsafe],
        fail_index=dataset.fail_index[unsafe],
        theta_unsafe=dataset.theta_unsafe[unsafe],
        safe=dataset.safe[safe],
        safe_times=dataset.safe_times[safe],
        theta_safe=dataset.theta_safe[safe],
    )
    one, other = train(dataset, mode(*choice)), train(shuffled, mode(*choice))
    np.testing.assert_allclose(one.alphas, other.alphas, rtol=1e-9)
    for y in flights[:5]:
        assert (one.p_values(y) == other.p_values(y)).all()
    before, after = (monitor.assess(TIMES, flights[0]) for monitor in (one, other))
    rollouts = other.unsafe_where[after.nearest_unsafe, 0]
    assert (unsafe[rollouts] == one.unsafe_where[before.nearest_unsafe, 0]).all()


@pytest.mark.parametrize("predictor", OF_OBSERVATIONS)
@pytest.mark.parametrize(("calibration", "p_value"), MODES)
def test_scaled_monitor_does_not_care_for_radians_or_degrees(
    predictor: str, calibration: str, p_value: str, dataset: Dataset, flights: Array
) -> None:
    degrees = np.where(np.arange(6) == oscillator.NY, 1, 180 / np.pi)
    recipe = mode(calibration, p_value, predictor=PREDICTORS[predictor])
    converted = replace(dataset, unsafe=dataset.unsafe * degrees, safe=dataset.safe * degrees)
    one, other = train(dataset, recipe), train(converted, recipe)
    np.testing.assert_allclose(one.alphas, other.alphas, rtol=1e-9)
    for y in flights:
        assert (one.p_values(y) == other.p_values(y * degrees)).all()
    raw = replace(recipe, scaling="raw")
    assert not np.allclose(train(dataset, raw).alphas, train(converted, raw).alphas, rtol=0.1)


# --- few, early and degenerate failures ----------------------------------------------------------


@pytest.mark.parametrize(("calibration", "p_value"), MODES)
@pytest.mark.parametrize("n_early", [0, 1, 5, 12])
def test_a_failure_too_early_for_a_warning_counts_and_is_a_miss(
    n_early: int, calibration: str, p_value: str, dataset: Dataset, flights: Array
) -> None:
    dataset = oscillator.with_early_failures(dataset, n_early, fail_index=4)  # h = 5
    monitor = train(dataset, mode(calibration, p_value))
    assert monitor.n_early == n_early
    assert monitor.n_unsafe == 12
    assert np.isposinf(monitor.alphas).sum() == n_early
    assert len(monitor.unsafe_points) == 12 - n_early
    for y in flights:
        assert (monitor.p_values(y) >= (n_early + 1) / 13).all()
    result = evaluate(monitor, dataset.unsafe, dataset.fail_index, np.array([0.1]))
    assert result.n_early == n_early
    assert result.misses[0] >= n_early


def test_a_failure_at_h_is_warned_of_at_its_first_sample(dataset: Dataset) -> None:
    monitor = train(oscillator.with_early_failures(dataset, 1, fail_index=5))
    assert monitor.n_early == 0
    assert monitor.unsafe_where[0].tolist() == [0, 0]


@pytest.mark.parametrize("score", OF_POINTS)
@pytest.mark.parametrize(("calibration", "p_value"), MODES)
def test_one_failure_is_enough_for_epsilon_one_half(
    calibration: str, p_value: str, score: str, dataset: Dataset, flights: Array
) -> None:
    """Left out of the unsafe set, it has no neighbour there: its score is infinite."""
    first = replace(
        dataset,
        unsafe=dataset.unsafe[:1],
        fail_index=dataset.fail_index[:1],
        theta_unsafe=dataset.theta_unsafe[:1],
    )
    monitor = train(first, mode(calibration, p_value, score=SCORES[score], epsilon=0.5))
    assert np.isinf(monitor.alphas[0]) == (SCORES[score].unsafe_weight > 0)
    p = np.array([monitor.p_values(y) for y in flights])
    assert set(p.ravel().tolist()) <= {0.5, 1.0}
    with pytest.raises(ValueError, match="needs at least 9 unsafe rollouts; this monitor has 1"):
        monitor.stream(0.1)


@pytest.mark.parametrize("name", ["unsafe", "safe"])
def test_a_dataset_without_one_kind_is_refused(name: str, dataset: Dataset) -> None:
    fewer = {f.name: getattr(dataset, f.name)[:0] for f in fields(dataset) if name == f.name}
    with pytest.raises(ValueError, match="a monitor needs both, change the amplitude or the limit"):
        train(replace(dataset, **fewer))


def test_parameters_without_names_are_refused(dataset: Dataset) -> None:
    with pytest.raises(ValueError, match="theta has 3 parameters and theta_names has 0"):
        train(replace(dataset, theta_names=()))


def test_a_lead_as_long_as_the_manoeuvre_is_refused(dataset: Dataset) -> None:
    with pytest.raises(ValueError, match=r"t_early=3\.0 s was given: the manoeuvre lasts 3 s"):
        train(dataset, MonitorRecipe(t_early=3.0))


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"t_early": 0.0}, "the lead must be positive"),
        ({"t_early": np.nan}, "the lead must be positive"),
        ({"n_delay": -1}, "it must be 0 or more"),
        ({"epsilon": 1.0}, "a miss rate between 0 and 1"),
        ({"calibration": "point"}, "calibration='point' was given: choose trajectory or pointwise"),
        ({"p_value": "full"}, "p_value='full' was given: choose simple or exact"),
        ({"scaling": "none"}, "scaling='none' was given: choose safe_std or raw"),
    ],
)
def test_a_recipe_that_no_dataset_could_serve_is_refused(choice: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        MonitorRecipe(**choice)


def test_lead_in_effect_is_whole_samples(dataset: Dataset) -> None:
    monitor = train(dataset, MonitorRecipe(t_early=0.21))
    assert (monitor.h, monitor.lead) == (5, 0.25)
    assert monitor.smallest_epsilon == 1 / 13


def test_still_and_doubled_channels_do_no_harm(dataset: Dataset, flights: Array) -> None:
    def spoil(y: Array) -> Array:
        y = y.copy()
        y[..., 4] = np.where(np.isnan(y[..., 4]), np.nan, 0.3)
        y[..., 2] = y[..., 1]
        return y

    spoiled = replace(dataset, unsafe=spoil(dataset.unsafe), safe=spoil(dataset.safe))
    for predictor in OF_OBSERVATIONS:
        monitor = train(spoiled, MonitorRecipe(predictor=PREDICTORS[predictor]))
        assert np.isfinite(monitor.alphas).all()
        assert monitor.scale[4] == 1
        assert np.isfinite(monitor.p_values(spoil(flights[0]))).all()


# --- the guarantee -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def campaigns() -> list[tuple[Dataset, Dataset]]:
    """Forty times 29 failures to train on and 60 fresh ones."""
    rngs = [np.random.default_rng(seed) for seed in range(40)]
    return [(oscillator.collect(rng, 29), oscillator.collect(rng, 60)) for rng in rngs]


@pytest.mark.parametrize(("calibration", "p_value"), MODES)
def test_mean_miss_rate_keeps_epsilon(
    calibration: str, p_value: str, campaigns: list[tuple[Dataset, Dataset]]
) -> None:
    """Mean over 40 fits, each on its own fresh failures, to 3 standard errors either side.

    The lower bound holds the trajectory-level rule to what it is for: the rate it was given.
    """
    epsilons, rates = np.array([0.1, 0.3, 0.5]), []
    for dataset, fresh in campaigns:
        monitor = train(dataset, mode(calibration, p_value))
        rates.append(evaluate(monitor, fresh.unsafe, fresh.fail_index, epsilons).miss_rate)
    error = np.std(rates, axis=0, ddof=1) / np.sqrt(len(rates))
    assert (np.mean(rates, axis=0) <= epsilons + 3 * error).all()
    if (calibration, p_value) == ("trajectory", "simple"):
        assert (np.mean(rates, axis=0) >= 0.6 * epsilons - 3 * error).all()
