"""The response filter: against least squares, by law, at the edges, and the guarantee it is for."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from core.card import CardError
from core.evaluation.rates import evaluate
from core.kernels.response_filter import SIGN, SWITCHED, CardResponses, begin, update
from core.monitor import Monitor, MonitorRecipe, State, train
from core.monitor.assessment import STATES
from core.monitor.file.loading import from_bytes
from core.monitor.file.portable import MonitorFileError, pack
from core.monitor.peak_forecast import LOST, NOT_BEGUN, OVER, ForecastAhead, NothingAhead
from core.monitor.predictor import PREDICTORS
from core.monitor.response_filter import OF_SIDES, CardForecast
from core.monitor.score import SCORES
from core.planned_test.collection import card_of, collect, evaluation_flights, fresh
from core.planned_test.planned_test import DatasetRecipe, LateralSimulator, SensorNoise
from core.simulation.maneuver import MANEUVERS, BankToBank, Doublet, Multistep3211, Step
from core.types import Array

NOISE = SensorNoise(beta=0.001, p=0.004, r=0.001, Ny=0.004, delta_a=0.003, delta_r=0.0003)
USUAL = DatasetRecipe()
RECIPE = replace(
    USUAL,
    maneuver=replace(USUAL.maneuver, timing_jitter_s=0.1, amplitude_jitter=0.05),
    noise=NOISE,
    n_unsafe=60,
    seed=3,
)
SCORES_OF_CARD = ("rest_of_card", "card_window")


def asked(score: str = "rest_of_card", t_early: float = 0.5) -> MonitorRecipe:
    return MonitorRecipe(
        t_early=t_early, predictor=PREDICTORS["response_filter"], score=SCORES[score]
    )


@cache
def trained(score: str = "rest_of_card") -> Monitor:
    return train(collect(RECIPE), asked(score), fresh(RECIPE), card=card_of(RECIPE))


def card_in(monitor: Monitor) -> CardResponses:
    assert isinstance(monitor.forecast, CardForecast)
    return monitor.forecast.card


AS_FLOWN = replace(USUAL.as_flown(), n_unsafe=60, seed=3)


@cache
def of_inputs(predictor: str = "input_filter") -> Monitor:
    """A monitor of flights with unequal inputs and lags."""
    recipe = replace(asked("card_window"), predictor=PREDICTORS[predictor])
    return train(collect(AS_FLOWN), recipe, card=card_of(AS_FLOWN))


@cache
def unequal() -> Array:
    return evaluation_flights(AS_FLOWN, 200).y


@cache
def flights() -> Array:
    return evaluation_flights(RECIPE, 200).y


def seen(monitor: Monitor, y: Array) -> tuple[Array, int]:
    """The switches that a flight's samples show, and the sign of the first step."""
    estimate, clock, y_hat = begin(3), np.zeros(2), np.empty(6)
    for k, sample in enumerate(y):
        update(card_in(monitor), estimate, clock, monitor.dt, k * monitor.dt, sample, 0, y_hat)
    return estimate.switches[: estimate.counts[SWITCHED]], int(estimate.counts[SIGN])


# --- against least squares -----------------------------------------------------------------------


def twin_score(monitor: Monitor, y: Array, switches: Array) -> float:
    """Score of the last sample by one solution of the normal equations, all switches known."""
    card = card_in(monitor)
    rows, off, now = [], [], len(y) - 1

    def respond(k: int, c: int, at: Array) -> tuple[float, float, Array]:
        lags = [min(k - s, len(card.mean) - 1) for s in at if s < k]
        steps = card.steps[: len(lags)]
        mean = sum(w * card.mean[lag, c] for w, lag in zip(steps, lags, strict=True))
        left = sum(w * w * card.residual[lag, c] for w, lag in zip(steps, lags, strict=True))
        shares = card.shares[: len(lags)]
        weights = sum(
            (w * card.components[lag, c] for w, lag in zip(shares, lags, strict=True)), np.zeros(8)
        )
        return mean, left, weights

    known = switches[switches < now]
    for k in range(int(known[0]) + 1, now + 1):
        for c in range(6):
            mean, left, weights = respond(k, c, switches[switches < k])
            deviation = np.sqrt(left + card.noise[c])
            rows.append(weights / deviation)
            off.append((y[k, c] - mean) / deviation)
    prior = np.vstack([np.array(rows), np.eye(8)])
    coefficients = np.linalg.lstsq(prior, np.append(off, np.zeros(8)), rcond=None)[0]
    covariance = np.linalg.inv(prior.T @ prior)
    plan = list(known)
    while len(plan) < len(card.steps):
        due = plan[-1] + int(card.apart[len(plan)])
        plan.append(max(due, now) if len(plan) == len(known) else due)
    margins = []
    for k in range(now + 1, plan[-1] + card.tail + 1):
        mean, left, weights = respond(k, 3, np.array(plan))
        variance = left + weights @ covariance @ weights
        margins.append((abs(mean + weights @ coefficients) - card.limits[3]) / np.sqrt(variance))
    return -max(margins)


def test_scores_are_those_of_one_least_squares_solution():
    monitor, y = trained(), flights()[0]
    switches, _ = seen(monitor, y)
    scores = monitor.assess(np.arange(len(y)) * 0.05, y, withdraw=False).score
    for now in (int(switches[0]) + 1, 20, int(switches[1]) + 3, 45, int(switches[2]) + 1, 70):
        assert scores[now] == pytest.approx(twin_score(monitor, y[: now + 1], switches), rel=1e-6)


def test_unequal_sides_are_learned_as_by_one_least_squares_solution():
    """The coefficient of the last component, from all samples of whole flights."""
    card = card_in(of_inputs())
    for y in unequal()[:5]:
        estimate, clock, y_hat = begin(3), np.zeros(2), np.empty(6)
        for k, sample in enumerate(y):
            update(card, estimate, clock, 0.05, k * 0.05, sample, 0, y_hat)
        switches, sign = estimate.switches, estimate.counts[SIGN]
        rows, off = [], []
        for k, c in product(range(int(switches[0]) + 2, len(y)), range(6)):
            lags = [min(k - s, len(card.mean) - 1) for s in switches if s < k]
            # before a switch is visible the filter does not know it
            if any(0 < k - s <= card.seen_after for s in switches):
                continue
            steps, shares = card.steps[: len(lags)], card.shares[: len(lags)]
            mean = steps @ card.mean[lags, c]
            deviation = np.sqrt(steps**2 @ card.residual[lags, c] + card.noise[c])
            weights = np.einsum("jk,jk->k", shares, card.components[lags, c])
            rows.append(weights / deviation)
            off.append((sign * y[k, c] - mean) / deviation)
        prior = np.vstack([np.array(rows), np.eye(8)])
        twin = np.linalg.lstsq(prior, np.append(off, np.zeros(8)), rcond=None)[0]
        assert estimate.mean[OF_SIDES] == pytest.approx(twin[OF_SIDES], abs=0.2)


def test_inputs_that_are_learned_make_the_forecast_of_unequal_flights_better():
    """Half a second ahead, from the second half of the doublet on."""
    errors = []
    for name in ("input_filter", "response_filter"):
        off = []
        for y in unequal()[:100]:
            y_hat = of_inputs(name).assess(np.arange(121) * 0.05, y, withdraw=False).y_hat
            off.append(y_hat[38:-10, 3] - y[48:, 3])
        errors.append(np.nanmean(np.square(off)))
    assert errors[0] < 0.8 * errors[1]


def test_the_forecast_of_a_flight_without_noise_comes_true():
    recipe = replace(
        RECIPE,
        noise=SensorNoise(),
        maneuver=replace(RECIPE.maneuver, timing_jitter_s=0.0, amplitude_jitter=0.0),
    )
    monitor = train(collect(recipe), asked(), card=card_of(recipe))
    y = evaluation_flights(recipe, 20).y
    for flight in y:
        y_hat = monitor.assess(np.arange(len(flight)) * 0.05, flight).y_hat
        off = np.abs(y_hat[25:-10, 3] - flight[35:, 3])
        assert off.max() < 0.05 * np.abs(flight[:, 3]).max()


# --- laws ----------------------------------------------------------------------------------------


def gappy(y: Array, kind: int) -> tuple[Array, Array]:
    """Times and samples of a flight with missing, invalid or no broken samples."""
    t = np.arange(len(y), dtype=np.float64) * 0.05
    y = y.copy()
    if kind == 1:
        y[40:43, 2] = np.nan
    elif kind == 2:
        y[20:31] = np.nan
    elif kind == 3:
        keep = np.r_[0:15, 18 : len(y)]
        t, y = t[keep], y[keep]
    elif kind == 4:
        keep = np.r_[0:25, 36 : len(y)]
        t, y = t[keep], y[keep]
    elif kind == 5:
        t[50], y[51:53, 0] = t[49], np.inf
    return t, y


@pytest.mark.parametrize("score", [*SCORES_OF_CARD, "inputs"])
def test_a_stream_is_the_batch_bit_for_bit(score: str):
    whole = of_inputs() if score == "inputs" else trained(score)
    monitor = from_bytes(whole.to_bytes())
    states = set()
    for i in range(24):
        t, y = gappy(flights()[i], i % 6)
        batch, stream = whole.assess(t, y), monitor.stream()
        for k in range(len(y)):
            one, same = stream.update(t[k], y[k]), batch[k]
            states.add(one.state)
            assert (one.p_value, one.alert, one.state) == (same.p_value, same.alert, same.state)
            assert (one.score, one.reason) == (same.score, same.reason)
            assert (one.y_hat is None) == (same.y_hat is None)
            assert one.y_hat is None or (one.y_hat == same.y_hat).all()
    assert states == set(STATES)


@pytest.mark.parametrize("score", SCORES_OF_CARD)
def test_the_lowest_score_is_that_of_the_samples(score: str):
    monitor, y = trained(score), flights()[:20]
    last = np.arange(20) * 6 - 3
    lowest = monitor.lowest_scores(y, last)
    highest = monitor.highest_p_values(y, last)
    for i in range(20):
        flown = monitor.assess(np.arange(121) * 0.05, y[i], withdraw=False)
        scores, p = flown.score[: max(last[i], -1) + 1], flown.p_value[: max(last[i], -1) + 1]
        assert lowest[i] == scores.min(initial=np.inf)
        assert highest[i] == p.max(initial=0.0)


def test_a_card_flown_to_the_other_side_has_the_mirrored_forecast():
    monitor, t = trained(), np.arange(121) * 0.05
    for y in flights()[:10]:
        one, other = (monitor.assess(t, flown, withdraw=False) for flown in (y, -y))
        assert np.array_equal(one.p_value, other.p_value)
        assert np.array_equal(one.y_hat, -other.y_hat, equal_nan=True)


def test_before_the_card_begins_no_limit_is_in_danger():
    batch = trained().assess(np.arange(6) * 0.05, flights()[0][:6])
    assert (batch.p_value == 1 / 61).all()
    assert np.isinf(batch.score).all()
    assert batch[5].y_hat is None


# --- switches ------------------------------------------------------------------------------------


def test_switches_are_seen_where_the_pilot_made_them():
    """The input is drawn again from the same stream, behind the aircraft, as rollouts draw it."""
    rng, simulator = np.random.default_rng(5), LateralSimulator(RECIPE)
    y = simulator.rollouts(300, rng).y
    rng = np.random.default_rng(5)
    simulator.plant.sample(300, rng)
    command = RECIPE.maneuver.pilot(RECIPE.dt, 300, rng)[..., 1]
    exact = 0
    for flight, flown in zip(y, command, strict=True):
        made = np.flatnonzero(np.diff(flown)) + 1
        found, _ = seen(trained(), flight)
        exact += len(found) == len(made) and bool((found == made).all())
    assert exact >= 295


@pytest.mark.parametrize(
    ("missing", "state"), [(slice(25, 28), State.OK), (slice(25, 31), State.INVALID)]
)
def test_a_gap_in_which_a_switch_may_have_passed_ends_the_forecast(missing: slice, state: State):
    y = flights()[0].copy()
    y[missing] = np.nan
    flown = trained().assess(np.arange(121) * 0.05, y)
    assert flown[120].state is state
    assert (flown[120].reason == LOST) == (state is State.INVALID)


def test_a_gap_before_the_card_or_after_its_last_switch_ends_nothing():
    for missing in (slice(0, 8), slice(70, 90)):
        y = flights()[0].copy()
        y[missing] = np.nan
        assert trained().assess(np.arange(121) * 0.05, y)[120].state is State.OK


# --- cards ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("maneuver", "switches"),
    [
        (Doublet(amplitude_deg=2.0), [(0.5, 2.0), (1.5, -4.0), (2.5, 2.0)]),
        (Doublet(amplitude_deg=-2.0, half_s=0.0), []),
        (Step(amplitude_deg=3.0), [(0.5, 3.0)]),
        (Multistep3211(unit_s=0.5), [(0.5, 5), (2.0, -10), (3.0, 10), (3.5, -10), (4.0, 5)]),
        (
            BankToBank(hold_s=0.0, amplitude_deg=1.0, duration_s=6.0),
            [(0.5, 1.0), (1.5, -2.0), (3.5, 2.0), (4.5, -1.0)],
        ),
        (
            Doublet(amplitude_deg=1.0, half_s=4.0),
            [(0.5, 1.0), (4.5, -2.0)],
        ),
    ],
)
def test_the_switches_of_a_manoeuvre(maneuver, switches):
    assert np.ravel(maneuver.switches) == pytest.approx(np.ravel(switches))


def test_responses_add_up_to_the_manoeuvre():
    recipe = replace(
        RECIPE, maneuver=replace(RECIPE.maneuver, timing_jitter_s=0.0, amplitude_jitter=0.0)
    )
    card = card_of(recipe, 40)
    y = np.zeros((40, 121, 6))
    for time, step in zip(card.switch_times, card.steps / card.steps[0], strict=True):
        start = round(time / card.dt)
        y[:, start:] += step * card.step_responses[:, : 121 - start]
    rng = np.random.default_rng(0)
    simulator = LateralSimulator(replace(recipe, noise=SensorNoise()))
    whole = simulator.rollouts(2000, rng).y
    assert (
        np.abs(y.mean(axis=0) - whole.mean(axis=0)).max() < 0.1 * np.abs(whole).mean(axis=0).max()
    )
    assert card.surface == 5


@pytest.mark.parametrize("name", ["rudder_sweep", "table"])
def test_a_manoeuvre_that_is_no_steps_has_no_card(name: str):
    known = next(m for key, m in MANEUVERS.items() if name.split("_")[-1] in key)
    with pytest.raises(
        CardError, match=r"not a sequence of steps.*choose the predictor peak_ridge"
    ):
        card_of(replace(RECIPE, maneuver=known))


def test_a_card_of_an_aircraft_that_diverges_is_refused():
    with pytest.raises(CardError, match="diverged"):
        replace(card_of(RECIPE, 4), step_responses=np.full((5, 9, 6), np.nan))


def test_what_cannot_be_forecast_is_refused_with_what_to_do():
    dataset, card = collect(RECIPE), card_of(RECIPE)
    with pytest.raises(ValueError, match=r"test card.*or choose the predictor peak_ridge"):
        train(dataset, asked())
    with pytest.raises(ValueError, match="no limits: choose the predictor peak_ridge"):
        train(replace(dataset, specification="departure"), asked(), card=card)
    for pair in (("linear", "rest_of_card"), ("response_filter", "nearest_neighbor")):
        with pytest.raises(ValueError, match="go with the score rest_of_card or card_window"):
            MonitorRecipe(predictor=PREDICTORS[pair[0]], score=SCORES[pair[1]])


# --- the file ------------------------------------------------------------------------------------


def damaged() -> list[tuple[str, object]]:
    counts = ("tail", "surface", "seen_after", "least_apart", "h", "window")
    found: list[tuple[str, object]] = [(name, value) for name, value in product(counts, (-1, 1e9))]
    found += [("share", 2.0), ("share", "half"), ("surface", 6), ("seen_after", 0)]
    for name in ("mean", "components", "residual", "noise", "steps"):
        found += [(name, np.full_like(getattr(card_in(trained()), name), np.nan))]
        found += [(name, getattr(card_in(trained()), name)[:-1])]
    later = card_in(trained()).later
    return [*found, ("later", -later), ("later", later.astype(float)), ("limits", -np.ones(6))]


def test_only_a_file_of_learned_inputs_needs_a_new_program():
    section = CardForecast(card_in(of_inputs())).to_section()
    assert section.version == 2
    assert CardForecast(card_in(trained())).to_section().version == 1
    again = from_bytes(of_inputs().to_bytes())
    np.testing.assert_array_equal(card_in(again).shares, card_in(of_inputs()).shares)
    bad = section._replace(arrays={**section.arrays, "shares": section.arrays["shares"][:, :-1]})
    sections = [bad if part.name == "card" else part for part in of_inputs()._sections()]
    with pytest.raises(MonitorFileError, match="cannot rebuild"):
        from_bytes(pack(sections))


def test_a_file_that_no_kernel_may_read_is_refused():
    monitor = trained()
    for name, value in damaged():
        good = CardForecast(card_in(monitor)).to_section()
        bad = (
            good._replace(arrays={**good.arrays, name: value})
            if isinstance(value, np.ndarray)
            else good._replace(header={**good.header, name: value})
        )
        sections = [bad if part.name == "card" else part for part in monitor._sections()]
        with pytest.raises(MonitorFileError, match="cannot rebuild"):
            from_bytes(pack(sections))
    without = [part for part in monitor._sections() if part.name != "card"]
    with pytest.raises(MonitorFileError, match="section card do not match"):
        from_bytes(pack(without))


# --- what it is for ------------------------------------------------------------------------------


@pytest.mark.parametrize("score", SCORES_OF_CARD)
def test_the_promise_holds_and_more_safe_flights_pass_than_with_the_linear_forecast(score: str):
    """Half a second ahead: miss at most epsilon by 3 standard errors, over monitors and flights."""
    epsilon, missed, failed, passed, default = np.array([0.1]), 0, 0, [], []
    for seed in range(8):
        recipe = replace(RECIPE, n_unsafe=100, seed=seed)
        dataset, test = collect(recipe), evaluation_flights(recipe, 400)
        found = evaluate(
            train(dataset, asked(score), card=card_of(recipe)), test.y, test.fail_index, epsilon
        )
        missed, failed = missed + found.misses[0], failed + found.n_unsafe
        passed.append(found.power[0])
        linear = train(dataset, MonitorRecipe(t_early=0.5))
        default.append(evaluate(linear, test.y, test.fail_index, epsilon).power[0])
    scatter = np.sqrt(0.1 * 0.9 * (1 / failed + 1 / 800))
    assert missed / failed <= 0.1 + 3 * scatter
    assert np.mean(passed) > np.mean(default) + 0.2


def test_nine_tenths_of_the_samples_to_come_lie_in_the_band_of_the_forecast():
    monitor, inside = trained(), []
    for y in evaluation_flights(RECIPE, 60).y:
        stream = monitor.stream()
        for k, sample in enumerate(y):
            stream.update(k * monitor.dt, sample)
            if k < 30 or k % 10:
                continue
            if not isinstance(ahead := stream.forecast_ahead(), ForecastAhead):
                continue
            assert ahead.made_t == k * monitor.dt
            to_come = np.round(ahead.t / monitor.dt).astype(int)
            use = to_come < len(y)
            measured = y[to_come[use], 3]
            inside.append((ahead.low[use, 3] <= measured) & (measured <= ahead.high[use, 3]))
    share = np.concatenate(inside).mean()
    assert 0.86 < share < 0.95


def test_nothing_is_forecast_ahead_before_the_card_or_while_the_monitor_is_not_ok():
    monitor, y = trained(), flights()[0]
    stream = monitor.stream()
    assert stream.forecast_ahead() is None
    known = []
    for k, sample in enumerate(y[:40]):
        stream.update(k * monitor.dt, sample)
        ahead = stream.forecast_ahead()
        known.append(ahead.why if isinstance(ahead, NothingAhead) else "")
    assert known[2] == NOT_BEGUN
    assert known[-1] == ""
    stream.update(40 * monitor.dt, np.full(6, np.nan))
    assert stream.forecast_ahead() is None


def test_after_the_card_nothing_is_left_of_it_to_forecast():
    monitor, y = trained(), flights()[0]
    stream = monitor.stream()
    longer = np.concatenate([y, np.repeat(y[-1:], len(y), axis=0)])
    said = [stream.update(k * monitor.dt, sample) for k, sample in enumerate(longer)][-1]
    ahead = stream.forecast_ahead()
    assert said.state is State.OK
    assert isinstance(ahead, NothingAhead)
    assert (ahead.why, ahead.made_t) == (OVER, said.t)
