"""Peak forecasts by ridge: against least squares, by law, at the edges, and the guarantee."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from core.dataset import Dataset
from core.evaluation.rates import evaluate
from core.kernels.peak_ridge import PeakWeights
from core.limits.limits import Envelope, Limits, magnitudes_of
from core.monitor import Monitor, MonitorRecipe, State, train
from core.monitor.assessment import STATES
from core.monitor.file.loading import from_bytes
from core.monitor.file.portable import MonitorFileError, pack
from core.monitor.peak_forecast import LOST, NOT_BEGUN, OVER, NothingAhead, PeakAhead
from core.monitor.peak_ridge import (
    FINEST,
    LEAST_WEIGHT,
    PENALTIES,
    LearnedFlights,
    Regressors,
    RidgeForecast,
    fit_windows,
    log_odds,
)
from core.monitor.predictor import PREDICTORS, PeakRidge
from core.monitor.score import SCORES
from core.planned_test.collection import collect, evaluation_flights, fresh, training_rollouts
from core.planned_test.planned_test import DatasetRecipe, SensorNoise
from core.types import Array, Indices

USUAL = DatasetRecipe()
RECIPE = replace(
    USUAL,
    maneuver=replace(USUAL.maneuver, timing_jitter_s=0.1, amplitude_jitter=0.05),
    noise=SensorNoise(beta=0.001, p=0.004, r=0.001, Ny=0.004, delta_a=0.003, delta_r=0.0003),
    n_unsafe=60,
    seed=3,
)
T: Array = np.arange(121.0) * 0.05


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    """Threads only slow such small matrices down."""
    with threadpool_limits(1):
        yield


def asked(score: str = "rest_of_card", predictor: PeakRidge | None = None) -> MonitorRecipe:
    return MonitorRecipe(
        t_early=0.5, predictor=predictor or PREDICTORS["peak_ridge"], score=SCORES[score]
    )


@cache
def dataset() -> Dataset:
    return collect(RECIPE)


NO_SCORES = np.full(10, np.nan)


@cache
def trained() -> Monitor:
    return train(dataset(), asked(), fresh(RECIPE))


@cache
def labelled(score: str = "rest_of_card") -> Monitor:
    """A monitor that never knew the limits: of verdicts alone."""
    rollouts = training_rollouts(RECIPE, 800)
    return train(replace(dataset(), specification="departure"), asked(score), rollouts=rollouts)


@cache
def flights() -> Array:
    return evaluation_flights(RECIPE, 200).y


def peaks_of(monitor: Monitor) -> PeakWeights:
    assert isinstance(monitor.forecast, RidgeForecast)
    return monitor.forecast.peaks


def begin_of(monitor: Monitor, y: Array) -> int:
    """Sample at which a flight's input begins."""
    peaks = peaks_of(monitor)
    return int((np.abs(y[:, peaks.surface]) >= peaks.threshold).argmax())


# --- against least squares -----------------------------------------------------------------------


def test_the_weights_are_least_squares_with_a_row_for_each_penalty():
    """The one with the least leave-one-out residuals, each found by leaving that row out."""
    rng = np.random.default_rng(0)
    x = rng.standard_normal((40, 7)) * np.logspace(-2, 2, 7)
    x[:, 3] = 5.0
    target = x @ rng.standard_normal(7) + 30 * rng.standard_normal(40)
    mean, deviation = x.mean(axis=0), np.where(x.std(axis=0) > 1e-9, x.std(axis=0), np.inf)
    z = (x - mean) / deviation
    with_constant = np.column_stack([z, np.ones(40)])

    def solve(penalty: float, rows: Indices) -> Array:
        augmented = np.vstack([with_constant[rows], np.sqrt(penalty) * np.eye(8)[:7]])
        found = np.linalg.lstsq(augmented, np.append(target[rows], np.zeros(7)), rcond=None)[0]
        return np.asarray(found, np.float64)

    def off(penalty: float) -> Array:
        left_out = [np.delete(np.arange(40), i) for i in range(40)]
        found = [solve(penalty, rows) for rows in left_out]
        return np.array([float(target[i] - with_constant[i] @ found[i]) for i in range(40)])

    best = min(PENALTIES, key=lambda penalty: np.square(off(penalty)).sum())
    assert PENALTIES[0] < best < PENALTIES[-1]
    weights, constant, residual = Regressors(x, np.ones(40)).ridge(target)
    solution = solve(best, np.arange(40))
    assert weights == pytest.approx(solution[:7] / deviation)
    assert constant == pytest.approx(solution[7] - mean @ weights)
    assert residual == pytest.approx(off(best))


ONES = Envelope.of_magnitudes(np.ones(6))


def linear_flights(n: int = 200) -> LearnedFlights:
    """Flights whose rudder moves at sample 3 and whose N_y at 8 is twice beta at sample 5."""
    rng = np.random.default_rng(1)
    y = np.zeros((n, 10, 6))
    y[:, 3:, 5] = 0.1
    y[:, 5, 0] = rng.uniform(0.01, 0.1, n)
    y[:, 8, 3] = 2 * y[:, 5, 0]
    return LearnedFlights(y, np.full(n, 10))


def test_a_peak_that_what_was_flown_decides_is_forecast_and_the_margin_scored():
    limits = Limits(Ny=0.5).envelope
    flown = linear_flights()
    (forecast,) = fit_windows(PeakRidge(past_s=1.0), flown, limits, [0], 0.05)
    assert (forecast.peaks.surface, forecast.peaks.threshold) == (5, pytest.approx(0.01))
    y = flown.y[0]
    score = forecast.follow(T[:10], y, np.zeros(10, np.int64), 0.05, NO_SCORES).score
    assert np.isposinf(score[[0, 1, 2, 9]]).all()
    assert score[4] == pytest.approx(-(flown.y[:, 8, 3].mean() / 0.5 - 1) / 0.105, rel=0.05)
    assert score[5:8] == pytest.approx(-(y[8, 3] / 0.5 - 1) / FINEST, rel=0.02)
    assert score[8] == pytest.approx(1 / FINEST)
    (near,) = fit_windows(PeakRidge(past_s=1.0), flown, limits, [2], 0.05)
    score = near.follow(T[:10], y, np.zeros(10, np.int64), 0.05, NO_SCORES).score
    assert score[5] == pytest.approx(1 / FINEST)


# --- laws ----------------------------------------------------------------------------------------


def gappy(y: Array, kind: int) -> tuple[Array, Array]:
    """Times and samples of a flight with missing, invalid or no broken samples."""
    t, y = T.copy(), y.copy()
    if kind == 1:
        y[40:43, 2] = np.nan
    elif kind == 2:
        y[5:16] = np.nan
    elif kind == 3:
        keep = np.r_[0:4, 6 : len(y)]
        t, y = t[keep], y[keep]
    elif kind == 4:
        keep = np.r_[0:30, 33 : len(y)]
        t, y = t[keep], y[keep]
    elif kind == 5:
        t[50], y[51:53, 0] = t[49], np.inf
    return t, y


@pytest.mark.parametrize("monitor", [trained, labelled])
def test_a_stream_is_the_batch_bit_for_bit(monitor):
    """Of the monitor and of its file."""
    read, states, reasons = from_bytes(monitor().to_bytes()), set(), set()
    for i in range(12):
        t, y = gappy(flights()[i], i % 6)
        batch, stream = monitor().assess(t, y), read.stream()
        for k in range(len(y)):
            one, same = stream.update(t[k], y[k]), batch[k]
            states.add(one.state)
            reasons.add(one.reason)
            assert (one.p_value, one.alert, one.state) == (same.p_value, same.alert, same.state)
            assert (one.score, one.reason) == (same.score, same.reason)
            assert (one.y_hat is None) == (same.y_hat is None)
            assert one.y_hat is None or (one.y_hat == same.y_hat).all()
    assert states == set(STATES)
    assert LOST in reasons


def test_the_lowest_score_is_that_of_the_samples():
    monitor, y = trained(), flights()[:20]
    last = np.arange(20) * 6 - 3
    lowest, highest = monitor.lowest_scores(y, last), monitor.highest_p_values(y, last)
    for i in range(20):
        flown = monitor.assess(T, y[i], withdraw=False)
        scores, p = flown.score[: max(last[i], -1) + 1], flown.p_value[: max(last[i], -1) + 1]
        assert lowest[i] == scores.min(initial=np.inf)
        assert highest[i] == p.max(initial=0.0)


def test_a_flight_to_the_other_side_has_the_same_risk():
    for y in flights()[:10]:
        one, other = (trained().assess(T, flown, withdraw=False) for flown in (y, -y))
        assert np.array_equal(one.p_value, other.p_value)


# --- what is missing -----------------------------------------------------------------------------


def test_nothing_is_forecast_while_a_sample_that_it_needs_is_missing():
    """A gap of one sample is in what every second sample of two seconds is made of, in turns."""
    y = flights()[0].copy()
    begin = begin_of(trained(), y)
    y[begin + 4] = np.nan
    flown = trained().assess(T, y, withdraw=False)
    missing = [k for k in range(begin + 7, 121) if flown[k].state is State.WARMING_UP]
    assert missing == list(range(begin + 8, begin + 43, 2))


@pytest.mark.parametrize("missing", ["sample", "time", "all before"])
def test_a_begin_of_the_input_that_passed_unseen_ends_the_forecast(missing: str):
    y, t = flights()[0].copy(), T.copy()
    begin = begin_of(trained(), y)
    if missing == "sample":
        y[begin - 1] = np.nan
    else:
        keep = np.r_[0 if missing == "time" else 121 : begin - 1, begin:121]
        y, t = y[keep.astype(int)], t[keep.astype(int)]
    flown = trained().assess(t, y, withdraw=False)
    assert flown[len(y) - 1].state is State.INVALID
    assert flown[len(y) - 1].reason == LOST


def test_before_the_input_and_after_the_card_no_limit_is_in_danger():
    y = np.concatenate([flights()[0]] * 2)
    flown = trained().assess(np.arange(242) * 0.05, y, withdraw=False)
    assert (flown.p_value[: begin_of(trained(), y)] == 1 / 61).all()
    assert (flown.p_value[130:] == 1 / 61).all()


def test_phases_may_be_counted_from_the_start_of_the_samples():
    monitor = train(dataset(), asked(predictor=PeakRidge(phase="start")))
    assert peaks_of(monitor).surface == -1
    y = flights()[0]
    assert np.isfinite(monitor.assess(T, y).score[:110]).all()
    early = monitor.assess(T[:118], y[3:]).score
    assert not np.array_equal(early[:100], monitor.assess(T, y).score[3:103])


# --- specifications known by their label ---------------------------------------------------------


@pytest.mark.parametrize("score", ["rest_of_card", "card_window"])
def test_a_monitor_of_verdicts_alone_tells_failures_apart(score: str):
    test = evaluation_flights(RECIPE, 500)
    found = evaluate(labelled(score), test.y, test.fail_index, np.array([0.1]))
    assert found.miss_rate[0] < 0.3
    assert found.power[0] > 0.6


def test_log_odds_are_those_at_which_the_penalised_likelihood_is_largest():
    """The gradient of the likelihood is the penalty times each standardised weight."""
    rng = np.random.default_rng(2)
    x = rng.standard_normal((300, 5)) * np.array([1, 10, 0.1, 3, 1])
    fails = x[:, 0] - 0.1 * x[:, 1] + 2 * rng.standard_normal(300) > 0.5
    fails = fails.astype(np.float64)
    weights, constant = log_odds(x, fails)
    share = 1 / (1 + np.exp(-x @ weights - constant))
    precision = np.maximum(share * (1 - share), LEAST_WEIGHT)
    spread = np.average((x - np.average(x, 0, precision)) ** 2, 0, precision)
    assert abs((fails - share).sum()) < 0.01
    gradient, standard = x.T @ (fails - share) / np.sqrt(spread), weights * np.sqrt(spread)
    assert np.abs(gradient).max() > 0.5
    assert min(np.abs(gradient - penalty * standard).max() for penalty in PENALTIES) < 0.02


def test_where_hardly_any_flight_fails_the_odds_are_those_of_all():
    fails = (np.arange(100) < 4).astype(np.float64)
    weights, constant = log_odds(np.random.default_rng(0).standard_normal((100, 3)), fails)
    assert not weights.any()
    assert constant == pytest.approx(np.log(4.5 / 96.5))


def test_what_cannot_be_learned_is_refused_with_what_to_do():
    with pytest.raises(ValueError, match=r"0 of \d+ rollouts failed.*rollouts="):
        train(replace(dataset(), specification="departure"), asked())
    with pytest.raises(ValueError, match="roll out the same manoeuvre"):
        train(dataset(), asked(), rollouts=(np.zeros((3, 5, 6)), np.zeros(3, np.int64)))
    still = linear_flights()
    with pytest.raises(ValueError, match=r"no surface moves.*choose phase start"):
        fit_windows(PeakRidge(), LearnedFlights(0 * still.y, still.fail_index), ONES, [0], 0.05)
    with pytest.raises(ValueError, match="choose phase start"):
        fit_windows(
            PeakRidge(), LearnedFlights(still.y[:, 4:], still.fail_index - 4), ONES, [0], 0.05
        )
    with pytest.raises(ValueError, match="choose input or start"):
        PeakRidge(phase="end")  # pyright: ignore[reportArgumentType]


# --- the rest of the manoeuvre ------------------------------------------------------------------


def test_the_band_of_the_peak_holds_as_many_safe_flights_as_it_says():
    monitor, test = trained(), evaluation_flights(RECIPE, 500)
    limit, again = magnitudes_of(RECIPE.specification), from_bytes(trained().to_bytes())
    held = []
    for y in test.y[~test.is_unsafe][:200]:
        stream, later = monitor.stream(), again.stream()
        t = np.arange(45) * monitor.dt
        said = [stream.update(*sample) for sample in zip(t, y[:45], strict=True)][-1]
        for sample in zip(t, y[:45], strict=True):
            later.update(*sample)
        ahead, stored = stream.forecast_ahead(), later.forecast_ahead()
        if said.score is None:
            assert ahead is None
            continue
        assert isinstance(ahead, PeakAhead)
        assert isinstance(stored, PeakAhead)
        assert vars(stored) == vars(ahead)
        assert ahead.made_t == said.t
        assert ahead.mean == pytest.approx(1 - said.score * ahead.deviation)
        held.append(ahead.low <= np.abs(y[45:] / limit).max() <= ahead.high)
    assert 0.84 <= np.mean(held) <= 0.96


def test_no_peak_is_told_of_verdicts_alone_or_of_a_window_which_say_so():
    y, windowed = flights()[0], train(dataset(), asked("card_window"))
    for monitor in (labelled(), windowed):
        stream = monitor.stream()
        for k in range(45):
            stream.update(k * monitor.dt, y[k])
        assert stream.forecast_ahead() is None
        assert monitor.forecast is not None
        assert "not available" in monitor.forecast.no_forecast_reason


def test_before_the_input_and_at_the_end_of_the_manoeuvre_no_peak_is_told_but_why():
    monitor, y = trained(), flights()[0]
    assert monitor.forecast is not None
    assert monitor.forecast.no_forecast_reason == ""
    stream, told = monitor.stream(), []
    for k, sample in enumerate(np.concatenate([y, np.repeat(y[-1:], 40, axis=0)])):
        stream.update(k * monitor.dt, sample)
        told.append(stream.forecast_ahead())
    before, after = told[2], told[-1]
    assert isinstance(before, NothingAhead)
    assert (before.why, before.made_t) == (NOT_BEGUN, 2 * monitor.dt)
    assert isinstance(after, NothingAhead)
    assert (after.why, after.made_t) == (OVER, pytest.approx((len(y) + 39) * monitor.dt))
    known = [k for k, one in enumerate(told) if isinstance(one, PeakAhead)]
    assert len(known) == len(monitor.forecast.to_section().arrays["offset"])


# --- the file ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("weights", np.full((2, 3, 6), np.nan)),
        ("weights", np.zeros((2, 3, 5))),
        ("weights", np.zeros((2, 0, 6))),
        ("deviation", np.ones(3)),
        ("deviation", np.zeros(111)),
        ("offset", np.zeros(3)),
        ("offset", np.zeros(111, np.float32)),
        ("every", 0),
        ("stride", 10**9),
        ("surface", 3),
        ("threshold", float("nan")),
        ("threshold", 1),
    ],
)
def test_a_file_that_no_kernel_may_read_is_refused(name: str, value: object):
    good = RidgeForecast(peaks_of(trained())).to_section()
    bad = (
        good._replace(arrays={**good.arrays, name: value})
        if isinstance(value, np.ndarray)
        else good._replace(header={**good.header, name: value})
    )
    sections = [bad if part.name == "peaks" else part for part in trained()._sections()]
    with pytest.raises(MonitorFileError, match=r"cannot rebuild|holds no monitor"):
        from_bytes(pack(sections))
    without = [part for part in trained()._sections() if part.name != "peaks"]
    with pytest.raises(MonitorFileError, match="section peaks do not match"):
        from_bytes(pack(without))


# --- what it is for ------------------------------------------------------------------------------


def test_the_promise_holds_and_more_safe_flights_pass_than_with_the_linear_forecast():
    """Half a second ahead: miss at most epsilon by 3 standard errors, over monitors and flights."""
    epsilon, missed, failed, passed, default = np.array([0.1]), 0, 0, [], []
    for seed in range(6):
        recipe = replace(RECIPE, n_unsafe=100, seed=seed)
        data, test = collect(recipe), evaluation_flights(recipe, 400)
        found = evaluate(train(data, asked()), test.y, test.fail_index, epsilon)
        missed, failed = missed + found.misses[0], failed + found.n_unsafe
        passed.append(found.power[0])
        linear = train(data, MonitorRecipe(t_early=0.5))
        default.append(evaluate(linear, test.y, test.fail_index, epsilon).power[0])
    scatter = np.sqrt(0.1 * 0.9 * (1 / failed + 1 / 600))
    assert missed / failed <= 0.1 + 3 * scatter
    assert np.mean(passed) > np.mean(default) + 0.2


def test_a_failure_before_the_input_is_seen_is_an_early_one_in_the_file_too(
    dataset: Dataset,
) -> None:
    monitor = train(replace(dataset, specification=Limits(Ny=0.5)), asked("card_window"))
    assert monitor.n_early == np.isposinf(monitor.alphas).sum() > 0
    assert from_bytes(monitor.to_bytes()).n_early == monitor.n_early
