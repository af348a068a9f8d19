"""Validity: statistics against brute force, p-values against fractions, stream against batch."""

import re
from collections.abc import Callable
from dataclasses import astuple, replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.channels import KEYS
from core.dataset import Dataset
from core.limits.limits import Envelope
from core.monitor import Assessments, Monitor, MonitorRecipe, State, train
from core.monitor.assessment import STATES
from core.monitor.predictor import PREDICTORS
from core.monitor.recipe import mismatch
from core.monitor.score import SCORES
from core.monitor.training import with_validity
from core.monitor.validity.innovation import fit_innovation
from core.monitor.validity.support import LEVEL, Support, SupportError, ValidityBasis, calibrate
from core.monitor.validity.verdict import (
    Comparison,
    RunningValidity,
    ValidityVerdict,
    compare,
)
from tests.support import oscillator
from tests.support.oscillator import DT, N_SAMPLES, NY, TIMES, Array

P, DELTA_A = KEYS.index("p"), KEYS.index("delta_a")
PAIRS = [
    (predictor, score)
    for predictor, score in product(PREDICTORS, SCORES)
    if not mismatch(PREDICTORS[predictor], SCORES[score]) and not SCORES[score].reads_card
]


def batches(seed: int = 3, n: int = 1_000):
    """Fresh flights of the oscillator, without an end."""
    rng = np.random.default_rng(seed)
    while True:
        y = oscillator.fly(rng, n)[1]
        yield y, oscillator.fail_indices(y)


def supported(dataset: Dataset, recipe: MonitorRecipe | None = None) -> Monitor:
    return train(dataset, recipe, batches())


@pytest.fixture(scope="module")
def monitor(dataset: Dataset) -> Monitor:
    return supported(dataset)


def support_of(monitor: Monitor) -> Support:
    assert monitor.support is not None
    return monitor.support


def basis_of(monitor: Monitor) -> ValidityBasis:
    assert monitor.validity_basis is not None
    return monitor.validity_basis


def judged(
    monitor: Monitor, t: Array, y: Array, said: Assessments, end: int | None = None
) -> ValidityVerdict:
    """The verdict on a whole manoeuvre, up to sample `end`."""
    whole = compare(basis_of(monitor), t, y, said.state, said.nearest_safe, end)
    return whole.verdict(said.y_hat)


def compared(monitor: Monitor, t: Array, y: Array, said: Assessments) -> Comparison:
    return compare(basis_of(monitor), t, y, said.state, said.nearest_safe)


def untouched(monitor: Monitor, t: Array, y: Array) -> Assessments:
    """What would be said if nothing were withdrawn."""
    return monitor.assess(t, y, withdraw=False)


def rough_flight(seed: int) -> tuple[Array, Array]:
    """t, y of a flight with a NaN, a repeated time, a gap, and a clock that is not a number."""
    rng = np.random.default_rng(seed)
    y = oscillator.fly(rng, 1)[1][0]
    t = TIMES.copy()
    y[rng.integers(1, 20), rng.integers(6)] = np.nan
    t[30:] += 4 * DT
    t[rng.integers(35, 40) :] -= DT
    t[50] = np.nan
    return t, y


# --- the statistics, by brute force --------------------------------------------------------------


def brute_force(monitor: Monitor, t: Array, y: Array, said: Assessments) -> Array:
    """(n, 2) largest off a forecast and distance by each sample, from assessments and points."""
    affine, n_delay = monitor.affine, monitor.recipe.n_delay
    off_forecast = innovation_of if support_of(monitor).innovation.window else residual_of
    kept = [i for i in range(len(t)) if STATES[said.state[i]] is not State.STALE]
    reached = np.zeros((len(t), 2))
    for at, i in enumerate(kept):
        if STATES[said.state[i]] is State.OK:
            rows = [kept[max(at - lag, 0)] for lag in range(n_delay, -1, -1)]
            z = y[rows].ravel() @ affine.matrix + affine.offset
            distance = np.sqrt(((monitor.safe_points - z) ** 2).sum(axis=1).min())
            run = [i]
            for before in kept[:at][::-1]:
                if STATES[said.state[before]] is not State.OK or t[run[0]] - t[before] >= 1.5 * DT:
                    break
                run = [before, *run]
            reached[i] = off_forecast(monitor, y[run], said.y_hat[run]), distance
    return np.fmax.accumulate(reached, axis=0)


def residual_of(monitor: Monitor, y: Array, y_hat: Array) -> float:
    """Of the last of an unbroken run of samples, h samples after its forecast; 0 without one."""
    if not np.isfinite(support_of(monitor).sigma).all() or len(y) <= monitor.h:
        return 0.0
    return float((np.abs(y[-1] - y_hat[-1 - monitor.h]) / support_of(monitor).sigma).max())


def innovation_of(monitor: Monitor, y: Array, _: Array) -> float:
    """Root mean square over the last half second of an unbroken run of samples."""
    forecast = support_of(monitor).innovation
    energies = []
    for k in range(8, len(y))[-10:]:
        white = (y[k - 8 : k + 1 : 2].ravel() @ forecast.matrix + forecast.offset)[:4]
        energies.append(white @ white / 4)
    return float(np.sqrt(sum(energies) / 10))


def of_older_file(monitor: Monitor) -> Monitor:
    """The same monitor, judged by the residuals of its own forecasts as those of 0.2.0 were."""
    sigma = np.full(6, 0.02 if monitor.recipe.predictor.forecasts else np.nan)
    support = calibrate(monitor.reference(sigma=sigma), N_SAMPLES, batches())
    return replace(monitor, support=support)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.fuzz) for k in (1, 2))])
@pytest.mark.parametrize("n_delay", [0, 2])
@pytest.mark.parametrize(("predictor", "score"), PAIRS)
@pytest.mark.parametrize("version", [of_older_file, lambda monitor: monitor])
def test_statistics_equal_brute_force(
    version: Callable[[Monitor], Monitor],
    predictor: str,
    score: str,
    n_delay: int,
    seed: int,
    dataset: Dataset,
) -> None:
    recipe = MonitorRecipe(
        predictor=PREDICTORS[predictor], score=SCORES[score], n_delay=n_delay, scaling="raw"
    )
    monitor = version(supported(dataset, recipe))
    has_forecasts = support_of(monitor).statistics == (0, 1)
    for t, y in (
        rough_flight(seed),
        (TIMES, oscillator.fly(np.random.default_rng(seed), 1)[1][0]),
    ):
        said = untouched(monitor, t, y)
        reached = compared(monitor, t, y, said).largest
        expected = brute_force(monitor, t, y, said)
        np.testing.assert_allclose(reached, expected, rtol=1e-6)
        assert (reached[-1, 0] > 0) == has_forecasts


def test_the_nearest_safe_points_need_not_be_known(monitor: Monitor) -> None:
    """The same bits where most of them are passed over, and the same sample of withdrawal."""
    withdrawn = 0
    for seed, (t, y) in enumerate(map(rough_flight, range(20))):
        y = y * (1 + seed % 4)
        said = untouched(monitor, t, y)
        unknown = replace(said, nearest_safe=np.full(len(t), -1))
        of_known, of_unknown = (
            compared(monitor, t, y, assessments) for assessments in (said, unknown)
        )
        assert of_known.largest.tobytes() == of_unknown.largest.tobytes()
        assert of_known.deviation.peaks.tobytes() == of_unknown.deviation.peaks.tobytes()
        p = monitor.assess(TIMES, y).p_value
        assert monitor.p_values(y).tobytes() == p.tobytes()
        withdrawn += np.isnan(p[-1])
    assert 0 < withdrawn < 20


def test_innovations_of_training_have_unit_deviation(dataset: Dataset) -> None:
    """And so has each response by itself, in its unit; but for what a sensor does not resolve."""
    innovation = fit_innovation(dataset)
    off = []
    for y in (*dataset.safe, *dataset.unsafe):
        o = np.hstack([y[k : len(y) - 8 + k] for k in range(0, 9, 2)])
        off.append(o[np.isfinite(o[:, -1])] @ innovation.matrix + innovation.offset)
    white, own = np.split(np.concatenate(off), 2, axis=1)
    assert np.abs(white.mean(axis=0)).max() < 1e-9
    np.testing.assert_allclose(np.cov(white.T), np.eye(4), atol=0.05)
    np.testing.assert_allclose(own.std(axis=0), innovation.sigma, rtol=0.05)


def test_past_outputs_are_a_tenth_of_a_second_apart_at_any_rate(dataset: Dataset) -> None:
    fast = fit_innovation(replace(dataset, dt=0.01))
    assert (fast.n_past, fast.spacing, fast.window) == (4, 10, 50)
    slow = fit_innovation(replace(dataset, dt=2.0))
    assert (slow.n_past, slow.spacing, slow.window) == (4, 1, 1)


def test_rollouts_too_short_for_a_forecast_are_judged_by_distance_alone(dataset: Dataset) -> None:
    short = replace(
        dataset,
        unsafe=dataset.unsafe[:, :4],
        safe=dataset.safe[:, :4],
        fail_index=dataset.fail_index * 0 + 3,
        safe_times=dataset.safe_times * 0 + 3,
    )
    assert fit_innovation(short).window == 0


def test_calibration_flights_are_measured_as_a_flight_is(monitor: Monitor) -> None:
    """Each column of the support is made of what `compare` says of its flights, sorted."""
    y, fail = next(batches())
    support, found = support_of(monitor), []
    for i in np.flatnonzero(fail < N_SAMPLES):
        t = TIMES[: fail[i] + 1]
        said = untouched(monitor, t, y[i, : fail[i] + 1])
        found.append(compared(monitor, t, y[i], said).largest[-1])
    assert np.sort(found, axis=0).tobytes() == support.unsafe.tobytes()
    assert len(support.safe) + len(support.unsafe) == len(y)
    assert support.n_samples == N_SAMPLES


# --- p-values and the rule -----------------------------------------------------------------------

numbers = st.lists(st.integers(0, 12), min_size=19, max_size=60)


@given(
    safe=numbers,
    unsafe=numbers,
    residual=st.integers(-1, 13),
    distance=st.integers(-1, 13),
    level=st.fractions(Fraction(1, 10), Fraction(1, 2)),
    forecasts=st.booleans(),
)
def test_invalid_iff_the_exact_combined_p_value_is_at_most_the_level(
    safe: list[int],
    unsafe: list[int],
    residual: int,
    distance: int,
    level: Fraction,
    forecasts: bool,
) -> None:
    """Ties and equality included; each column is half the other, to tell them apart."""
    kinds = [np.sort(np.column_stack([kind, kind]) / [1, 2], axis=0) for kind in (safe, unsafe)]
    sigma = np.full(6, 1.0 if forecasts else np.nan)
    support = Support(sigma, kinds[0], kinds[1], 61)
    reached = np.array([residual, distance / 2])

    def exact(kind: list[int], value: int) -> Fraction:
        return Fraction(1 + sum(x >= value for x in kind), len(kind) + 1)

    p = {1: max(exact(safe, distance), exact(unsafe, distance))}
    if forecasts:
        p[0] = max(exact(safe, residual), exact(unsafe, residual))
    combined = min(Fraction(1), len(p) * min(p.values()))
    found = support.p_values(reached[None])
    for k, value in p.items():
        assert found[0, k] == pytest.approx(float(value), rel=1e-12)
    assert np.isnan(found[0, 0]) != forecasts
    assert support.combined(found)[0] == pytest.approx(float(combined), rel=1e-12)
    is_invalid = (reached > replace(support, level=float(level)).bounds()).any()
    assert is_invalid == (combined <= level)


def test_a_level_that_the_calibration_cannot_serve_is_refused(monitor: Monitor) -> None:
    support = replace(support_of(monitor), unsafe=support_of(monitor).unsafe[:98])
    with pytest.raises(SupportError, match=r"level=0\.02 .* 98 failing .* support 0\.0202 or more"):
        replace(support, level=0.02).check_level()
    replace(support, level=0.0203).check_level()
    with pytest.raises(SupportError, match="below 1"):
        replace(support, level=1.0).check_level()


def test_calibration_ends_once_both_kinds_serve_the_level(dataset: Dataset) -> None:
    """Never before LEAST flights; only labels decide."""
    monitor, taken = train(dataset), 0

    def small():
        nonlocal taken
        for y, fail in batches(n=100):
            taken += 1
            yield y, fail

    with_validity(monitor, dataset, small())
    assert taken == 10
    rare = ((y, np.where(np.arange(len(y)) < 9, fail, N_SAMPLES)) for y, fail in batches(n=250))
    support = support_of(with_validity(monitor, dataset, rare))
    assert len(support.unsafe) >= 99
    assert len(support.safe) > 1_000
    assert support.level == LEVEL


def test_too_few_flights_of_one_kind_raise_the_level_or_are_refused(dataset: Dataset) -> None:
    monitor = train(dataset)
    y, fail = next(batches())
    failing = np.flatnonzero(fail < N_SAMPLES)

    def with_failing(n: int):
        chosen = np.concatenate([np.flatnonzero(fail == N_SAMPLES), failing[:n]])
        return [(y[chosen], fail[chosen])]

    support = support_of(with_validity(monitor, dataset, with_failing(39)))
    assert support.level == 2 / 40
    with pytest.raises(SupportError, match=r"\d+ stayed safe and 18 failed, 19 of each"):
        with_validity(monitor, dataset, with_failing(18))


# --- one verdict a manoeuvre ---------------------------------------------------------------------


def test_a_flight_like_the_simulated_ones_is_valid(monitor: Monitor, flights: Array) -> None:
    verdicts = [judged(monitor, TIMES, y, untouched(monitor, TIMES, y)) for y in flights]
    assert [verdict.valid for verdict in verdicts] == [True] * len(flights)
    for verdict in verdicts:
        assert verdict.reasons == ()
        assert verdict.level == LEVEL
        assert verdict.p_value is not None
        assert verdict.p_value > LEVEL


def test_support_changes_no_assessment(monitor: Monitor, dataset: Dataset, flights: Array) -> None:
    bare = train(dataset)
    for y in flights[:5]:
        one, other = (m.assess(TIMES, y) for m in (monitor, bare))
        assert one.withdrawal is other.withdrawal is None
        for name in set(Assessments.__dataclass_fields__) - {"withdrawal"}:
            same, bits = (np.asarray(getattr(each, name)).tobytes() for each in (one, other))
            assert same == bits


@pytest.mark.parametrize(("predictor", "score"), PAIRS)
def test_running_says_what_the_batch_says_of_every_part(
    predictor: str, score: str, dataset: Dataset
) -> None:
    """Bit for bit; and once invalid, it stays so. The stream does not withdraw by itself."""
    recipe = MonitorRecipe(predictor=PREDICTORS[predictor], score=SCORES[score])
    monitor = supported(dataset, recipe)
    for seed in (1, 2):
        t, y = rough_flight(seed)
        y[44:, NY] += 2.0
        said, running = untouched(monitor, t, y), RunningValidity(basis_of(monitor))
        stream = replace(monitor, support=None).stream()
        before = False
        for k in range(len(t)):
            is_invalid = running.update(y[k], stream.update(t[k], y[k]))
            whole = judged(monitor, t, y, said, end=k)
            assert repr(astuple(running.verdict)) == repr(astuple(whole))
            assert is_invalid == (whole.valid is False)
            assert is_invalid >= before
            before = is_invalid
        assert before


def test_verdict_and_withdrawal_are_those_of_a_manoeuvre_that_ends_with_its_exceedance(
    monitor: Monitor,
) -> None:
    for seed, is_unsafe in ((1, False), (2, False), (2, True)):
        t, y = rough_flight(seed)
        y[44 if is_unsafe else 30 :, NY] += 2.0
        assessments = untouched(monitor, t, y)
        verdict, withdrawal = monitor.judge_and_withdraw(t, y, assessments)
        end = monitor.last_counted(y)
        assert end is not None
        assert repr(verdict) == repr(judged(monitor, t, y, assessments, end=end))
        assert (withdrawal is None) == (verdict.valid is not False)


def test_reasons_name_response_size_and_time(monitor: Monitor, flights: Array) -> None:
    y, support = flights[3].copy(), support_of(monitor)
    y[-1, NY] += 0.6
    verdict = judged(monitor, TIMES, y, untouched(monitor, TIMES, y))
    assert verdict.valid is False
    assert (verdict.sample, verdict.t, verdict.channel) == (60, TIMES[60], "Ny")
    least = 1 / (min(len(support.safe), len(support.unsafe)) + 1)
    assert (verdict.residual_p, verdict.p_value) == (least, 2 * least)
    # 0.6 g off at one of ten samples: a root mean square of 0.19 g
    assert verdict.reasons[0] == (
        f"the response to the surfaces was {verdict.residual:.2f} sigma off its forecast "
        f"over the 0.5 s to 3.00 s, mostly Ny (0.187 g); 99 % of fresh flights stay within "
        f"{support.bounds()[0]:.2f}"
    )
    y[-1] *= 9
    said = untouched(monitor, TIMES, y)
    verdict = judged(monitor, TIMES, y, said)
    z = said.y_hat[-1] / monitor.scale
    near = min(monitor.safe_points, key=lambda point: ((point - z) ** 2).sum())
    mostly = max(range(6), key=lambda c: abs(near[c] - z[c]))
    assert verdict.reasons[-1] == (
        f"the nearest safe training sample was {verdict.distance:.3g} (scaled units) away "
        f"at 3.00 s, mostly in forecast {KEYS[mostly]}; 99 % of fresh flights "
        f"stay within {support.bounds()[1]:.3g}"
    )


def test_the_residual_of_an_older_file_names_its_channel(dataset: Dataset, flights: Array) -> None:
    monitor = of_older_file(train(dataset))
    y, support = flights[3].copy(), support_of(monitor)
    y[-1, NY] += 0.6
    said = untouched(monitor, TIMES, y)
    verdict = judged(monitor, TIMES, y, said)
    off = abs(y[-1, NY] - said.y_hat[-1 - monitor.h, NY])
    assert (verdict.sample, verdict.valid) == (60, False)
    assert verdict.residual == pytest.approx(off / support.sigma[NY])
    assert verdict.reasons[0] == (
        f"Ny was {verdict.residual:.1f} sigma ({off:.3g} g) off its forecast at 3.00 s; "
        f"99 % of fresh flights stay within {support.bounds()[0]:.1f}"
    )


def with_still(dataset: Dataset, channel: int) -> Dataset:
    """The same rollouts, one channel at rest."""
    unsafe, safe = dataset.unsafe.copy(), dataset.safe.copy()
    unsafe[..., channel] *= 0
    safe[..., channel] = 0
    return replace(dataset, unsafe=unsafe, safe=safe)


def test_a_response_that_moves_now_and_never_did_is_named(dataset: Dataset, flights: Array) -> None:
    def still(y: Array) -> Array:
        return y * (np.arange(6) != P)

    fresh = ((still(y), fail) for y, fail in batches())
    monitor = with_validity(train(with_still(dataset, P)), with_still(dataset, P), fresh)
    y = still(flights[3])
    assert judged(monitor, TIMES, y, untouched(monitor, TIMES, y)).valid
    y[25:, P] = 0.1
    verdict = judged(monitor, TIMES, y, untouched(monitor, TIMES, y))
    assert (verdict.valid, verdict.channel) == (False, "p")
    y[25:, P] = 0.5e-3
    assert judged(monitor, TIMES, y, untouched(monitor, TIMES, y)).valid


def test_a_surface_that_never_moved_in_training_has_no_weight(
    dataset: Dataset, flights: Array
) -> None:
    """It is not recorded, say, and reads 0; what it does to the responses is seen in these."""
    forecast = fit_innovation(with_still(dataset, DELTA_A))
    weights = np.abs(forecast.matrix).reshape(5, 6, 8).max(axis=(0, 2))
    assert weights[DELTA_A] < 1e-12 * weights.min(initial=1.0, where=np.arange(6) != DELTA_A)


def test_a_flight_longer_than_those_of_training_says_so_where_it_strays(monitor: Monitor) -> None:
    y = oscillator.fly(np.random.default_rng(5), 40)[1].reshape(-1, 6)
    t = np.arange(len(y), dtype=np.float64) * DT
    verdict = judged(monitor, t, y, untouched(monitor, t, y))
    assert verdict.valid is False
    assert re.search(r"lasts 122\.00 s, .* 3\.05 s: split it", verdict.reasons[-1])


def test_a_flight_counts_up_to_its_first_exceedance(monitor: Monitor, flights: Array) -> None:
    y = flights[3].copy()
    y[45:] *= 9
    said = untouched(monitor, TIMES, y)
    assert judged(monitor, TIMES, y, said).valid is False
    assert judged(monitor, TIMES, y, said, end=44).valid is True


def test_a_flight_of_which_too_little_was_seen_is_not_called_valid(
    monitor: Monitor, flights: Array
) -> None:
    def reasons(t: Array, y: Array) -> tuple[str, ...]:
        verdict = judged(monitor, t, y, untouched(monitor, t, y))
        assert verdict.valid is None
        return verdict.reasons

    y = flights[3].copy()
    assert reasons(TIMES[:4], y[:4])[0].startswith("4 samples are too few to judge validity")
    y[::4, 0] = np.nan
    assert reasons(TIMES, y)[0].startswith("only 15 of 61 samples could be assessed")
    y = flights[3].copy()
    y[12::13, 0] = np.nan
    assert reasons(TIMES, y)[0].startswith("only 10 of 53 forecasts could be checked")
    late = TIMES.copy()
    late[30:] += 10.0
    assert reasons(late, flights[3])[0].startswith("only 59 of 261 samples could be assessed")


def test_numbers_beyond_all_bounds_are_invalid_not_overlooked(
    monitor: Monitor, flights: Array
) -> None:
    """A forecast that overflows is no number, and compares false with any bound."""
    y = flights[3].copy()
    y[40] = 1e308
    with np.errstate(over="ignore", invalid="ignore"):
        said = untouched(monitor, TIMES, y)
    verdict = judged(monitor, TIMES, y, said)
    assert verdict.valid is False
    assert verdict.distance == np.inf


def test_a_monitor_without_support_is_not_calibrated_and_never_valid(
    dataset: Dataset, flights: Array
) -> None:
    monitor = train(dataset)
    said = untouched(monitor, TIMES, flights[0])
    verdict, _ = monitor.judge_and_withdraw(TIMES, flights[0], said)
    assert verdict.valid is None
    assert verdict.p_value is None
    assert verdict.reasons[0].startswith("validity is not calibrated")
    assert monitor.validity_basis is None


def test_a_monitor_without_forecasts_is_judged_by_distance_alone(
    dataset: Dataset, flights: Array
) -> None:
    """One of an older file, whose predictor makes none."""
    monitor = of_older_file(train(dataset, MonitorRecipe(predictor=PREDICTORS["identity"])))
    verdict = judged(monitor, TIMES, flights[0], untouched(monitor, TIMES, flights[0]))
    assert verdict.valid is True
    assert verdict.residual_p is verdict.residual is None
    assert verdict.p_value == verdict.distance_p
    y = flights[0] * 3
    verdict = judged(monitor, TIMES, y, untouched(monitor, TIMES, y))
    assert verdict.valid is False
    assert "98 % of fresh flights" in verdict.reasons[0]


def test_responses_are_judged_whatever_the_predictor(dataset: Dataset, flights: Array) -> None:
    monitor = supported(dataset, MonitorRecipe(predictor=PREDICTORS["identity"]))
    y = flights[3].copy()
    y[30:, NY] *= -1
    verdict = judged(monitor, TIMES, y, untouched(monitor, TIMES, y))
    assert verdict.valid is False
    assert verdict.reasons[0].startswith("the response to the surfaces was")


def test_one_sample_exceeds_as_a_row_of_many_does() -> None:
    limits = Envelope.of_magnitudes(np.array([np.inf, 1.0, 2.0, np.inf, 0.5, np.inf]))
    values = (0.0, -2.0, 0.5, 1.0, np.nan, np.inf, -np.inf)
    y = np.random.default_rng(0).choice(values, (200, 6), p=(0.7, *6 * (0.05,)))
    among_many = limits.exceeds(y)
    assert 0 < among_many.sum() < len(y)
    assert [bool(limits.exceeds(row)) for row in y] == among_many.tolist()
