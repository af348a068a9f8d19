"""A trained monitor over a flight: stream and batch agree, and each state is what it says."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.dataset import Dataset
from core.monitor import Assessments, Monitor, MonitorRecipe, State, train
from core.monitor.assessment import REASONS, STATES, Withdrawal
from core.monitor.calibration import confident_rank
from core.monitor.file.loading import from_bytes
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from tests.support import oscillator
from tests.support.oscillator import DT, N_SAMPLES, TIMES, Array
from tests.support.repetition import examples

STREAMED = [
    MonitorRecipe(p_value="exact"),
    MonitorRecipe(calibration="pointwise", p_value="exact", n_delay=0, scaling="raw"),
    MonitorRecipe(predictor=PREDICTORS["pca"], n_delay=4),
    MonitorRecipe(calibration="pointwise", score=SCORES["unsafe_distance"]),
    MonitorRecipe(predictor=PREDICTORS["identity"], score=SCORES["safe_distance"]),
    MonitorRecipe(calibration="pointwise", score=SCORES["negative_magnitude"]),
]
STEPS = st.sampled_from([1.0] * 12 + [0.0, 0.4, 0.6, 1.4, 1.6, 7.0, -1.0, np.nan, np.inf])
DEFECTS = st.sampled_from([None] * 12 + [np.nan, np.inf, -np.inf])


@pytest.fixture(scope="module", params=range(len(STREAMED)))
def streamed(request: pytest.FixtureRequest, dataset: Dataset) -> Monitor:
    return train(oscillator.with_early_failures(dataset, 1), STREAMED[request.param])


def assert_stream_equals_batch(monitor: Monitor, t: Array, y: Array) -> Assessments:
    """Field by field, to the bit; returns the batch."""
    stream, batch = monitor.stream(), monitor.assess(t, y)
    assert len(batch) == len(t)
    for i, code in enumerate(batch.state):
        said = stream.update(t[i], y[i])
        assert said.state is STATES[code]
        assert said.reason == REASONS[code]
        np.testing.assert_array_equal([said.t, batch.t[i]], t[i])
        ok = said.state is State.OK
        assert ok == (said.p_value is not None) == (said.alert is not None)
        assert ok == (said.score is not None) == (not np.isnan(batch.p_value[i]))
        forecast = ok and monitor.recipe.predictor.forecasts
        assert forecast == (said.y_hat is not None) == (not np.isnan(batch.y_hat[i]).any())
        if ok:
            assert said.p_value == batch.p_value[i]
            assert said.alert is bool(batch.alert[i])
            assert said.score == batch.score[i]
        else:
            assert not batch.alert[i]
            assert np.isnan(batch.score[i])
        if said.y_hat is not None:
            assert said.y_hat.tobytes() == batch.y_hat[i].tobytes()
        for exemplar, point, where, of in (
            (said.nearest_unsafe, batch.nearest_unsafe[i], monitor.unsafe_where, "unsafe"),
            (said.nearest_safe, batch.nearest_safe[i], monitor.safe_where, "safe"),
        ):
            assert (exemplar is None) == (point == -1)
            if exemplar:
                rollout, sample = where[point].tolist()
                theta = getattr(monitor, f"theta_{of}")[rollout]
                assert (exemplar.rollout, exemplar.t) == (rollout, sample * DT)
                assert list(exemplar.theta.values()) == theta.tolist()
    return batch


@settings(max_examples=examples(60))
@given(
    start=st.floats(-1e3, 1e3),
    steps=st.lists(STEPS, min_size=N_SAMPLES, max_size=N_SAMPLES),
    defects=st.lists(DEFECTS, min_size=N_SAMPLES, max_size=N_SAMPLES),
    flight=st.integers(0, 19),
)
def test_stream_equals_batch_to_the_bit(
    start: float, steps: list, defects: list, flight: int, streamed: Monitor, flights: Array
) -> None:
    """Through unknown values, gaps, repeated times and steps back."""
    y, t = flights[flight].copy(), np.empty(N_SAMPLES)
    for i, (step, defect) in enumerate(zip(steps, defects, strict=True)):
        before = t[i - 1] if i else start
        t[i] = (before if np.isfinite(before) else start) + step * DT
        if defect is not None:
            y[i, i % 6] = defect
    with np.errstate(invalid="ignore"):
        assert_stream_equals_batch(streamed, t, y)


def test_stream_equals_batch_on_whole_flights(streamed: Monitor, flights: Array) -> None:
    for y in flights[:5]:
        batch = assert_stream_equals_batch(streamed, TIMES, y)
        assert (batch.state == 0).all()
        assert (batch.p_value == streamed.p_values(y)).all()


@settings(max_examples=examples(60))
@given(
    size=st.sampled_from([0.3, 1.0, 3.0, 1e160]),
    defects=st.lists(DEFECTS, min_size=2 * N_SAMPLES, max_size=2 * N_SAMPLES),
    pair=st.permutations(range(20)),
)
def test_p_values_alone_are_those_of_assessed_samples(
    size: float, defects: list, pair: list[int], streamed: Monitor, flights: Array
) -> None:
    """To the bit, though most neighbours are not looked up: through steps, defects and ties."""
    y = size * np.vstack([flights[pair[0]], flights[pair[1]]])
    for i, defect in enumerate(defects):
        if defect is not None:
            y[i, i % 6] = defect
    with np.errstate(over="ignore", invalid="ignore"):
        expected = streamed.assess(np.arange(len(y)) * DT, y).p_value
        assert streamed.p_values(y).tobytes() == expected.tobytes()


def test_p_values_alone_tie_with_the_failures_they_are_calibrated_on(
    streamed: Monitor, dataset: Dataset
) -> None:
    for y, fail in zip(dataset.unsafe, dataset.fail_index.tolist(), strict=True):
        flown = y[: fail + 1]
        expected = streamed.assess(TIMES[: fail + 1], flown).p_value
        assert streamed.p_values(flown).tobytes() == expected.tobytes()


def test_columns_say_what_each_sample_says(streamed: Monitor, flights: Array) -> None:
    y, t = flights[0].copy(), TIMES.copy()
    y[7, 2], t[20] = np.nan, t[19]
    whole = streamed.assess(t, y)
    exemplars = {"nearest_unsafe", "nearest_safe"}
    for batch in (whole, whole.withdrawn_from(Withdrawal(30, "outside training"))):
        columns = batch.columns()
        for k in range(len(batch)):
            said = batch[k].as_dict()
            said["y_hat"] = said["y_hat"] and [*said["y_hat"].values()]
            assert {key: said[key] for key in said.keys() - exemplars} == {
                key: values[k] for key, values in columns.items()
            }


def states(monitor: Monitor, t: list[float], y: Array | None = None) -> str:
    """First letter of each state: o(k), w(arming up), s(tale), i(nvalid)."""
    y = np.zeros((len(t), 6)) if y is None else y
    with np.errstate(invalid="ignore"):
        batch = assert_stream_equals_batch(monitor, np.array(t) * DT, y)
    return "".join(STATES[code][0] for code in batch.state)


@pytest.mark.parametrize("n_delay", [0, 1, 2, 5])
def test_history_warms_up_for_n_delay_samples_after_a_gap_but_not_at_the_start(
    n_delay: int, dataset: Dataset
) -> None:
    monitor, y = train(dataset, MonitorRecipe(n_delay=n_delay)), np.zeros((20, 6))
    warm = "w" * n_delay
    assert states(monitor, [*range(5), *range(7, 17)]) == "ooooo" + warm + "o" * (10 - n_delay)
    y[5, 2] = np.nan
    assert states(monitor, [*range(20)], y) == "oooooi" + warm + "o" * (14 - n_delay)
    y[0, 0] = np.nan
    assert states(monitor, [*range(20)], y)[:6] == ("i" + warm + "oooo")[:5] + "i"


@pytest.mark.parametrize(
    ("t", "expected"),
    [
        ([0, 1, 1, 1, 2, 3], "oossoo"),  # repeated
        ([0, 1, 2.4, 3.0, 4.4], "ooooo"),  # jitter within half an interval
        ([0, 1.3, 2.6, 3.9, 5.2, 6.5], "ooiwiw"),  # another rate
        ([k / 1.5 for k in range(7)], "ooiwiwi"),  # another rate
        ([k * 1.001 for k in range(40)], "o" * 40),  # a clock that is a little off
        ([0, 1, 2.51, 3.51, 4.51, 5.51], "oowwoo"),  # gap
        ([0, 1, 1.4, 2.4, 3.4, 4.4, 5.4], "ooiwwoo"),  # too soon
        ([0, 1, 2, 1, 2, 3, 4], "oooiwwo"),  # back
        ([0, 1, np.nan, 3, 4, 5, 6], "ooiiwwo"),
        ([0, 1, np.inf, 3, 4, 5, 6], "ooiiwwo"),
        ([np.nan, 1, 2, 3, 4], "iiwwo"),
    ],
)
def test_state_follows_the_clock(t: list[float], expected: str, dataset: Dataset) -> None:
    assert states(train(dataset), t) == expected


def test_a_stale_sample_leaves_the_history_unharmed(dataset: Dataset, flights: Array) -> None:
    monitor = train(dataset, MonitorRecipe(p_value="exact"))
    y, t = np.repeat(flights[1], 2, axis=0), np.repeat(TIMES, 2)
    y[1::2] = np.nan
    batch = assert_stream_equals_batch(monitor, t, y)
    assert [STATES[code] for code in batch.state] == [State.OK, State.STALE] * N_SAMPLES
    assert (batch.p_value[::2] == monitor.p_values(flights[1])).all()


def test_after_a_gap_a_monitor_forgets_what_came_before(dataset: Dataset, flights: Array) -> None:
    """Not so its exact trajectory-level p-value: an alert before the gap stays an alert."""
    monitor, y = train(dataset), flights[2]
    t = np.where(np.arange(N_SAMPLES) < 30, np.arange(N_SAMPLES), np.arange(N_SAMPLES) + 4) * DT
    assert (monitor.assess(t, y).p_value[32:] == monitor.p_values(y)[32:]).all()


def test_alert_is_p_value_above_epsilon_strictly(dataset: Dataset, flights: Array) -> None:
    monitor, t = train(dataset), TIMES
    y = max(flights, key=lambda y: len(np.unique(monitor.p_values(y))))
    p = monitor.p_values(y)
    assert len(np.unique(p)) > 4
    for epsilon in np.unique(p[p < 1]).tolist():
        assert (monitor.assess(t, y, epsilon).alert == (p > epsilon)).all()
        stream = monitor.stream(epsilon)
        alerts = [stream.update(*sample).alert for sample in zip(t, y, strict=True)]
        assert alerts == (p > epsilon).tolist()
    for refused in (monitor.stream, lambda epsilon: monitor.assess(t, y, epsilon)):
        with pytest.raises(ValueError, match=r"epsilon=0\.01 needs at least 99 unsafe rollouts"):
            refused(0.01)


def test_the_exemplar_is_the_nearest_failure_at_its_last_timely_sample(
    dataset: Dataset, flights: Array
) -> None:
    monitor = train(dataset)
    stream = monitor.stream()
    for t, y in zip(TIMES[:30], flights[0], strict=False):
        stream.update(t, y)
    said = stream.update(TIMES[30], flights[0][30])
    assert said.y_hat is not None
    assert said.nearest_unsafe
    distances = np.linalg.norm(monitor.unsafe_points - said.y_hat / monitor.scale, axis=1)
    rollout = int(distances.argmin())
    assert said.nearest_unsafe.rollout == rollout
    assert said.nearest_unsafe.t == (dataset.fail_index[rollout] - monitor.h) * DT
    assert said.nearest_unsafe.distance == pytest.approx(distances.min(), rel=1e-9)
    assert said.nearest_unsafe.theta == dict(
        zip(oscillator.THETA, dataset.theta_unsafe[rollout].tolist(), strict=True)
    )


def test_a_stream_without_exemplars_says_the_rest(dataset: Dataset, flights: Array) -> None:
    monitor = train(dataset)
    told, untold = monitor.stream(), monitor.stream(exemplars=False)
    none, expected = {"nearest_unsafe": None, "nearest_safe": None}, {}
    for t, y in zip(TIMES, flights[0], strict=True):
        expected, assessment = told.update(t, y).as_dict(), untold.update(t, y).as_dict()
        assert assessment == expected | none
    assert expected["nearest_unsafe"] is not None


def test_an_assessment_is_plain_data(dataset: Dataset, flights: Array) -> None:
    monitor = train(dataset)
    said, stream = monitor.assess([0.0], flights[0][:1]), monitor.stream()
    data = stream.update(0, flights[0][0]).as_dict()
    assert data["p_value"] == said.p_value[0]
    assert data["state"] == "ok"
    assert list(data["y_hat"]) == ["beta", "p", "r", "Ny", "delta_a", "delta_r"]
    assert data["nearest_safe"]["theta"].keys() == set(oscillator.THETA)
    data = stream.update(1.0, np.full(6, np.nan)).as_dict()
    assert data["p_value"] is data["alert"] is data["y_hat"] is data["nearest_unsafe"] is None
    assert "not finite" in data["reason"]


@pytest.mark.parametrize("shape", [(5,), (1, 6), ()])
def test_a_sample_of_another_shape_is_refused(shape: tuple, dataset: Dataset) -> None:
    with pytest.raises(ValueError, match="give the 6 channels beta, p"):
        train(dataset).stream().update(0, np.zeros(shape))


def test_a_trajectory_of_another_shape_is_refused(dataset: Dataset) -> None:
    monitor = train(dataset)
    with pytest.raises(ValueError, match=r"y has shape \(6,\): give \(n_samples, 6\)"):
        monitor.p_values(np.zeros(6))
    with pytest.raises(ValueError, match=r"one flight at a time, as y\[0\]"):
        monitor.p_values(np.zeros((1, 5, 6)))
    for wrong, kind in ((np.zeros((5, 6)) + 1j, "complex"), (np.full((5, 6), "1.5"), "text")):
        with pytest.raises(ValueError, match=f"y holds {kind}"):
            monitor.p_values(wrong)
    with pytest.raises(ValueError, match=r"t has shape \(2,\): give one time per sample"):
        monitor.assess([0, 1], np.zeros((3, 6)))
    assert monitor.p_values(np.zeros((0, 6))).shape == (0,)


# --- the promise of one monitor ------------------------------------------------------------------


def test_a_monitor_that_promises_with_confidence_alerts_above_its_rank(
    dataset: Dataset, flights: Array
) -> None:
    sure = train(dataset, MonitorRecipe(epsilon=0.3, guarantee="95%"))
    n = sure.n_unsafe
    above = confident_rank(0.3, n) / (n + 1)
    assert sure.alert_above() == above < 0.3
    assert sure.check_epsilon() == 0.3
    kept = from_bytes(sure.to_bytes())
    assert kept.recipe.guarantee == "95%"
    for y in flights[:3]:
        batch = assert_stream_equals_batch(kept, TIMES, y)
        assert (batch.alert == (batch.p_value > above)).all()
        assert batch[5].alert_above == above == kept.stream().update(0.0, y[0]).alert_above


def test_a_promise_with_confidence_that_would_always_alert_is_refused(dataset: Dataset) -> None:
    sure = train(dataset, MonitorRecipe(epsilon=0.3, guarantee="95%"))
    early = replace(sure, n_early=confident_rank(0.3, sure.n_unsafe))
    for ask in (early.stream, early.check_epsilon, early.alert_above):
        with pytest.raises(ValueError, match=r"would alert on every flight: .* too early"):
            ask()
    with pytest.raises(ValueError, match="95 % confidence needs at least 59 unsafe rollouts"):
        sure.stream(0.05)
    with pytest.raises(ValueError, match="guarantee='sure' was given: choose average or 95%"):
        MonitorRecipe(guarantee="sure")  # pyright: ignore[reportArgumentType]
