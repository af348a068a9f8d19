"""A monitor of any channels: trained, streamed, written to a file, and held to its promise."""

from functools import cache

import numpy as np
import pytest

from core.channels import LATERAL, Dictionary, channel
from core.dataset import Dataset
from core.evaluation.rates import evaluate
from core.limits.limits import Envelope, IntervalLimits, Limits, SafeInterval
from core.monitor import Monitor, MonitorRecipe, train
from core.monitor.file.loading import from_bytes
from core.monitor.predictor import PREDICTORS
from core.monitor.recipe import METHODS
from core.monitor.score import SCORES
from core.rollouts import LabelledFlights, RolloutsError
from core.types import Array
from tests.support import oscillator, short_period
from tests.support.short_period import DICTIONARY, DT, LIMITS

RNG = np.random.default_rng
PAPER = MonitorRecipe()
PEAK = MonitorRecipe(predictor=PREDICTORS["peak_ridge"], score=SCORES["rest_of_card"])
USUAL = MonitorRecipe(
    predictor=PREDICTORS["ensemble"], score=SCORES["highest_risk"], guarantee="95%"
)
RECIPES = pytest.mark.parametrize("recipe", [PAPER, PEAK, USUAL], ids=["paper", "peak", "usual"])


@cache
def flights(seed: int, n: int) -> LabelledFlights:
    theta, y = short_period.fly(RNG(seed), n)
    return LabelledFlights.of(y, dt=DT, channels=DICTIONARY, limits=LIMITS, theta=theta)


@cache
def trained(recipe: MonitorRecipe = PAPER) -> Monitor:
    learn, fresh = flights(1, 1600).split((0.5, 0.5))
    more = fresh.y, fresh.fail_index
    return train(Dataset.from_flights(learn), recipe, [more], rollouts=more)


def of_channels(n: int) -> Dictionary:
    names = [channel(f"x{k}", f"x{k}", "m", f"signal {k}") for k in range(n - 4)]
    return Dictionary("many", (*names, *DICTIONARY.channels)[-n:])


@RECIPES
def test_the_promise_holds_for_a_pitch_doublet(recipe: MonitorRecipe) -> None:
    fresh = flights(2, 2400)
    counts = evaluate(trained(recipe), fresh.y, fresh.fail_index, np.array([0.1]))
    error = np.sqrt(0.1 * 0.9 * (1 / counts.n_unsafe + 1 / len(trained(recipe).alphas)))
    assert counts.n_unsafe > 300
    assert counts.miss_rate[0] <= 0.1 + 3 * error
    assert counts.power[0] > 0.5
    assert counts.safe_withdrawn[0] <= 0.05 * counts.n_safe


@RECIPES
@pytest.mark.parametrize("n", [1, 3, 4, 7, 32])
def test_stream_batch_and_file_agree_to_the_bit(n: int, recipe: MonitorRecipe) -> None:
    dictionary = of_channels(n)
    source = flights(1, 400)
    y = short_period.with_channels(source.y, n, RNG(3))
    controls = dictionary.of_role("control")
    assert controls == (n - 1,)
    dataset = Dataset.from_rollouts(
        y, dt=DT, channels=dictionary, fail_index=source.fail_index, n_obs=20
    )
    more = y[::2], source.fail_index[::2]
    monitor = train(dataset, recipe, [more], rollouts=more)
    again = from_bytes(monitor.to_bytes())
    assert again.dictionary == dictionary
    flight = y[int(np.flatnonzero(~source.fails)[0])]
    stream = again.stream()
    states = [stream.update(k * DT, sample) for k, sample in enumerate(flight)]
    streamed = np.array([np.nan if s.p_value is None else s.p_value for s in states])
    np.testing.assert_array_equal(streamed, monitor.p_values(flight))
    assert np.isfinite(streamed).sum() > 40


def test_another_aircraft_is_invalid_and_the_own_one_is_not() -> None:
    _, y = short_period.fly(RNG(5), 40)
    monitor, safe = trained(), ~LIMITS.envelope.exceeds(y).any(axis=1)
    y = y[safe]
    reversed_pitch = y.copy()
    reversed_pitch[..., 1] *= -1.0
    n = np.full(len(y), y.shape[1])
    assert (monitor.first_withdrawn(y, n) < n).mean() <= 0.15
    assert (monitor.first_withdrawn(reversed_pitch, n) < n).all()


def test_a_reason_names_the_channel_of_the_dictionary() -> None:
    fresh = flights(2, 2400)
    y = fresh.y[~fresh.fails][0].copy()
    y[30:, 1] += 0.5
    stream = trained().stream()
    reasons = [stream.update(k * DT, sample).reason for k, sample in enumerate(y)]
    assert "mostly q" in reasons[-1]


def test_a_channel_that_never_moves_changes_nothing_but_is_kept() -> None:
    source = flights(1, 400)
    y = np.concatenate([np.full((*source.y.shape[:2], 1), 7.0), source.y], axis=2)
    y[np.isnan(y[..., 1])] = np.nan
    dictionary = Dictionary("still", (channel("c", "c", "m", "still"), *DICTIONARY.channels))
    monitor = train(Dataset.from_rollouts(y, dt=DT, channels=dictionary, limits=None,
                                          fail_index=source.fail_index))  # fmt: skip
    plain = train(Dataset.from_rollouts(source.y, dt=DT, channels=DICTIONARY,
                                        fail_index=source.fail_index))  # fmt: skip
    np.testing.assert_allclose(monitor.alphas, plain.alphas, rtol=1e-6, atol=1e-9)


# --- limits ---------------------------------------------------------------------------------------


def test_a_margin_is_1_at_each_limit_and_0_at_rest() -> None:
    envelope = LIMITS.envelope
    y = np.zeros((4, 4))
    y[:, 2] = 1.0, 2.9, -1.1, -2.15
    np.testing.assert_allclose(envelope.margin(y), [0.0, 1.0, 1.0, 1.5])
    assert envelope.exceeds(y).tolist() == [False, True, True, True]
    assert [bool(envelope.exceeds(sample)) for sample in y] == [False, True, True, True]
    assert envelope.first_exceedance(y[np.newaxis]).tolist() == [1]


def test_magnitudes_are_intervals_around_zero() -> None:
    limits = Limits(Ny=0.5, beta=0.1)
    y = RNG(0).normal(0, 0.5, (20, 50, 6))
    np.testing.assert_array_equal(
        limits.envelope.margin(y), np.abs(y / limits.magnitudes).max(axis=2)
    )
    np.testing.assert_array_equal(
        Envelope.of_magnitudes(limits.magnitudes).exceeds(y),
        (np.abs(y) >= limits.magnitudes).any(axis=2),
    )


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ({}, "give low, high or both"),
        ({"low": 1.0, "high": 0.5}, "must be between"),
        ({"high": 0.5, "rest": 0.6}, "must be between"),
    ],
)
def test_an_impossible_interval_is_refused(interval: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        SafeInterval(**interval)


def test_limits_of_an_unknown_channel_are_refused_with_the_nearest() -> None:
    with pytest.raises(ValueError, match="did you mean alpha"):
        IntervalLimits(DICTIONARY, {"alfa": SafeInterval(high=0.3)})


# --- what a dictionary cannot have ----------------------------------------------------------------


def test_what_knows_only_lateral_channels_says_so() -> None:
    dataset = Dataset.from_flights(flights(1, 400))
    predictor, score = METHODS["test_card"]
    card = MonitorRecipe(predictor=predictor, score=score)
    magnitude = MonitorRecipe(score=SCORES["negative_magnitude"])
    for recipe in (card, magnitude):
        with pytest.raises(ValueError, match="knows only beta, p, r"):
            train(dataset, recipe)


def test_a_sample_of_other_channels_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="alpha, q, Nz, delta_e"):
        trained().stream().update(0.0, np.zeros(6))


def test_lateral_datasets_keep_their_digest() -> None:
    dataset = oscillator.collect(RNG(0), 20)
    named = Dataset(**{**vars(dataset), "dictionary": LATERAL})
    other = Dataset(**{**vars(dataset), "dictionary": Dictionary("mine", LATERAL.channels)})
    assert named.digest() == dataset.digest() != other.digest()


# --- rollouts -------------------------------------------------------------------------------------


def labelled(y: Array, **given: object) -> LabelledFlights:
    return LabelledFlights.of(y, **({"dt": DT, "channels": DICTIONARY, "limits": LIMITS} | given))  # pyright: ignore[reportArgumentType]


def test_the_label_wins_over_the_limits_and_the_findings_count_it() -> None:
    source = flights(1, 400)
    fail = np.where(source.fails, source.fail_index, -1)
    first, late, *_ = np.flatnonzero(source.fails).tolist()
    fail[first] = -1
    fail[late] += 1
    _, y = short_period.fly(RNG(1), 400)
    checked = labelled(y, fail_index=fail)
    assert checked.fail_index[first] == y.shape[1]
    assert any("disagree in 1 of 400" in text for text in checked.findings)
    assert any("1 of 400 flights exceed a limit before" in text for text in checked.findings)


def test_implausible_flights_are_left_out_and_reported() -> None:
    _, y = short_period.fly(RNG(1), 400)
    safe = np.flatnonzero(~LIMITS.envelope.exceeds(y).any(axis=1))
    y[safe[0], 60:] = np.nan
    y[safe[1]] = y[safe[2]]
    checked = labelled(y)
    assert len(checked.y) == 398
    assert any("1 safe flight" in text and "before 4 s" in text for text in checked.findings)
    assert any("duplicate flights left out: 1" in text for text in checked.findings)


def test_a_channel_that_leaks_the_label_is_named() -> None:
    source = flights(1, 400)
    _, y = short_period.fly(RNG(1), 400)
    y[..., 1] += 10.0 * source.fails[:, np.newaxis]
    assert any("first sample of q tells" in text for text in labelled(y).findings)


def test_failures_of_one_setting_are_reported() -> None:
    source = flights(1, 400)
    theta = np.where(source.fails, 0.0, np.arange(400.0))[:, np.newaxis]
    _, y = short_period.fly(RNG(1), 400)
    assert any("same parameters" in text for text in labelled(y, theta=theta).findings)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"channels": ["alpha", "q", "Nz", "delta_x"]}, "did you mean delta_"),
        ({"channels": ["alpha", "q"]}, "give \\(flights, samples, 2\\)"),
        ({"dt": 0.0}, "positive sample interval"),
        ({"limits": None}, "neither labels nor limits"),
        ({"fail_index": np.full(40, 500)}, "first failing sample or -1"),
        ({"fail_index": np.full(40, -1)}, "0 of 40 flights fail"),
        ({"theta": np.zeros(40)}, "one row for each"),
        ({"limits": Limits()}, "limits are of other channels"),
    ],
)
def test_rollouts_that_cannot_train_are_refused(given: dict[str, object], words: str) -> None:
    _, y = short_period.fly(RNG(1), 40)
    with pytest.raises(RolloutsError, match=words):
        labelled(y, **given)


def test_parts_are_disjoint_by_parameter_setting() -> None:
    source = flights(1, 400)
    setting = np.repeat(np.arange(100.0), 4)[:, np.newaxis]
    whole = LabelledFlights(
        source.y, source.fail_index, setting, DT, DICTIONARY, LIMITS, ("number",)
    )
    parts = whole.split((0.5, 0.2, 0.3), seed=3)
    numbers = [set(part.theta[:, 0].tolist()) for part in parts]
    assert sum(map(len, numbers)) == len(set.union(*numbers)) == 100
    assert sum(len(part.y) for part in parts) == 400
    shares = [part.fails.mean() for part in parts]
    assert max(shares) - min(shares) < 0.15
