"""A recording is scored manoeuvre by manoeuvre, where the monitor is applicable."""

import json
import sys
from dataclasses import asdict, replace

import numpy as np
import pytest

from app.assessment import (
    BETWEEN,
    Interval,
    ScoringRecipe,
    manoeuvres_in,
    sample_type,
    score_at_each,
)
from app.assessment.outcome import RecordedExceedance, against_limits, outcome
from app.assessment.planned_test import needed_channels
from app.assessment.trim import GUARD_S, TrimSteps
from app.assessment.wording import verdict
from app.report import facts
from app.telemetry.recording import TelemetryError, Trace, Traces
from app.telemetry.timing.repair import repair
from core.channels import KEYS, LATERAL
from core.limits.limits import Limits
from core.monitor import Monitor, MonitorRecipe
from core.monitor.assessment import STATES, State
from core.monitor.calibration import confident_rank
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from core.monitor.validity import verdict as flight_verdict
from core.planned_test.planned_test import LateralSimulator, SensorNoise
from core.simulation.aircraft import PublishedAircraft
from core.simulation.maneuver import Doublet
from core.simulation.published import ModelName
from tests.support.attas import TEST, fly, record, recorded, score, trained

INVALID = STATES.index(State.INVALID)
UNTOUCHED = ScoringRecipe(trim=None, manoeuvres="entire")
NY = KEYS.index("Ny")


def planned(n: int, seed: int) -> np.ndarray:
    """(n, n_samples, 6) fresh flights of the planned test."""
    return LateralSimulator(TEST).rollouts(n, np.random.default_rng(seed)).y


@pytest.fixture(scope="module")
def calm(attas: Monitor) -> np.ndarray:
    """A valid flight: 3 s of rest and one doublet."""
    for y in fly(20, 5).y:
        if score(attas, recorded(y)).manoeuvres[0].validity.valid:
            return y
    raise AssertionError("no valid flight among 20")


def the_only_manoeuvre(monitor: Monitor, traces: Traces, recipe: ScoringRecipe | None = None):
    (manoeuvre,) = score(monitor, traces, recipe).manoeuvres
    return manoeuvre


def failed(monitor: Monitor, traces: Traces, recipe: ScoringRecipe | None = None) -> dict[str, str]:
    """Text of each failed check of the only manoeuvre."""
    checks = the_only_manoeuvre(monitor, traces, recipe).validity.checks
    return {check.name: check.text for check in checks if check.ok is False}


def test_scoring_without_trim_gives_the_monitors_own_bits(attas: Monitor):
    for y in planned(5, 1):
        samples = score(attas, recorded(y), UNTOUCHED).samples
        assessments = attas.assess(np.arange(len(y)) * attas.dt, y)
        raw = np.where(np.isnan(samples["p_value"]), samples["withdrawn"], samples["p_value"])
        assert (raw == assessments.p_value).all()
        np.testing.assert_array_equal(samples["y"], y)
        np.testing.assert_array_equal(samples["y_hat"], assessments.y_hat)


def test_a_manoeuvre_smaller_than_planned_gets_a_remark(attas: Monitor, calm: np.ndarray):
    amplitude = the_only_manoeuvre(attas, recorded(calm)).amplitude
    assert amplitude is not None
    assert amplitude == pytest.approx(np.abs(calm[:, 5]).max() / np.deg2rad(3.7), abs=0.005)
    scored = score(attas, recorded(0.5 / amplitude * calm))
    (small,) = scored.manoeuvres
    assert small.validity.valid
    assert small.amplitude == pytest.approx(0.5)
    (remark,) = (line for line in small.remarks if "largest deflection" in line)
    assert "50 % of the planned amplitude; 98 % of fresh flights without an exceedance" in remark
    assert (
        "no limit exceeded, on a manoeuvre of 50 % of the planned amplitude"
        in verdict(attas, scored)[0]
    )
    _, headline = facts.headline([asdict(small)])
    assert headline.endswith("on a manoeuvre of 50 % of the planned amplitude")


def test_each_manoeuvre_is_scored_like_a_flight_of_its_own(attas: Monitor):
    flights = fly(3, 2).y
    rest = np.tile(flights[0, :1], (200, 1))
    together = np.vstack([part for y in flights for part in (y, rest)])
    scored = score(attas, recorded(together))
    assert len(scored.manoeuvres) == 3
    assert [manoeuvre.name for manoeuvre in scored.manoeuvres] == [
        f"manoeuvre {k}" for k in (1, 2, 3)
    ]
    for number, (manoeuvre, y) in enumerate(zip(scored.manoeuvres, flights, strict=True)):
        alone = the_only_manoeuvre(attas, recorded(y))
        shift = number * (len(y) + len(rest))
        assert (manoeuvre.first - shift, manoeuvre.outcome) == (alone.first, alone.outcome)
        assert manoeuvre.peak_risk == alone.peak_risk
        part = scored.samples[manoeuvre.first : manoeuvre.last + 1]
        assert (part["manoeuvre"] == number).all()


def test_columns_are_released_from_memory_between_manoeuvres(
    attas: Monitor, monkeypatch: pytest.MonkeyPatch
):
    flights = fly(3, 2).y
    rest = np.tile(flights[0, :1], (200, 1))
    traces = recorded(np.vstack([part for y in flights for part in (y, rest)]))
    expected = score(attas, traces)
    released: list[np.ndarray] = []
    module = sys.modules["app.assessment.score"]
    monkeypatch.setattr(module, "JUDGED_TOGETHER", 1)
    monkeypatch.setattr(module, "release", released.append)
    scored = score(attas, traces)
    assert len(released) == len(scored.manoeuvres) * len(traces.channels) > len(traces.channels)
    assert scored.samples.tobytes() == expected.samples.tobytes()


def test_a_detected_manoeuvre_has_the_planned_trim_segment_and_length(attas: Monitor):
    for y in fly(10, 3).y:
        manoeuvre = the_only_manoeuvre(attas, recorded(y, start=3358.0))
        moved = np.flatnonzero(np.abs(y[:, 5]) > 5 * TEST.noise.delta_r)[0]
        assert manoeuvre.first == pytest.approx(moved - 1 - 0.5 / attas.dt, abs=2)
        assert manoeuvre.begins == pytest.approx(manoeuvre.start + 0.5)
        assert manoeuvre.end - manoeuvre.start == pytest.approx(TEST.maneuver.duration_s, abs=1e-6)
        assert manoeuvres_in(attas, repair(recorded(y, start=3358.0))) == (
            Interval(manoeuvre.start, manoeuvre.end, "manoeuvre 1"),
        )


def test_samples_between_manoeuvres_have_no_assessment(attas: Monitor, calm: np.ndarray):
    scored = score(attas, recorded(calm))
    between = scored.samples[scored.samples["manoeuvre"] == BETWEEN]
    assert len(between) == len(calm) - 121
    assert (between["state"] == INVALID).all()
    assert np.isnan(between["p_value"]).all()
    assert np.isnan(between["withdrawn"]).all()
    assert not between["alert"].any()


def test_trim_is_the_mean_of_the_manoeuvres_own_trim_segment(attas: Monitor, calm: np.ndarray):
    offset = np.array([0.02, -0.01, 0.005, 0.03, -0.02, 0.04])
    plain, moved = (score(attas, recorded(y)) for y in (calm, calm + offset))
    (manoeuvre,), (other,) = plain.manoeuvres, moved.manoeuvres
    onset = manoeuvre.first + 10
    candidates = [calm[end - 10 : end].mean(axis=0) for end in range(onset - 7, onset)]
    assert any(manoeuvre.trim == pytest.approx(trim) for trim in candidates)
    assert np.array(other.trim) - manoeuvre.trim == pytest.approx(offset)
    begun = manoeuvre.first
    np.testing.assert_allclose(moved.samples["y"][begun:], plain.samples["y"][begun:], atol=1e-12)
    assert other.outcome == manoeuvre.outcome


def test_trim_in_seconds_is_the_mean_just_before_the_input(attas: Monitor, calm):
    manoeuvre = the_only_manoeuvre(attas, recorded(calm), ScoringRecipe(trim=2.0))
    end = manoeuvre.first + 10 - round(GUARD_S / attas.dt)
    assert manoeuvre.trim == pytest.approx(calm[end - 40 : end].mean(axis=0))
    whole = the_only_manoeuvre(attas, recorded(calm), ScoringRecipe(trim=2.0, manoeuvres="entire"))
    assert whole.trim == pytest.approx(calm[:40].mean(axis=0))


def test_a_recording_without_input_is_scored_as_one(attas: Monitor, calm: np.ndarray):
    scored = score(attas, recorded(calm[:60]))
    assert [s.name for s in scored.manoeuvres] == ["entire recording"]
    assert any("No control input detected" in note for note in scored.notes)
    assert manoeuvres_in(attas, repair(recorded(calm[:60]))) == ()


def test_marked_manoeuvres_are_scored_between_their_times(attas: Monitor, calm: np.ndarray):
    recipe = ScoringRecipe(manoeuvres=(Interval(8.5, 9.5, "tail"), Interval(2.5, 8.5)))
    first, tail = score(attas, recorded(calm), recipe).manoeuvres
    assert (first.name, first.first, first.last) == ("manoeuvre 1", 50, 170)
    assert (tail.name, tail.first, tail.last) == ("tail", 170, 190)


@pytest.mark.parametrize(
    ("intervals", "message"),
    [
        (
            (Interval(-2.0, 3.0),),
            "-2 to 3 s is not inside the recording, which lasts from 0 to 10 s",
        ),
        ((Interval(4.0, 30.0),), "4 to 30 s is not inside"),
        ((Interval(1.0, 4.0), Interval(3.0, 5.0)), "1 to 4 s and 3 to 5 s overlap"),
        ((Interval(4.0, 4.0),), "has no length"),
        ((Interval(4.0, float("nan")),), "has no length"),
        ((Interval(4.001, 4.002),), "fewer than two samples"),
        ((), "no manoeuvre is marked"),
    ],
)
def test_impossible_manoeuvres_are_refused(attas: Monitor, calm, intervals, message: str):
    with pytest.raises(TelemetryError, match=message):
        score(attas, recorded(calm), ScoringRecipe(manoeuvres=intervals))


@pytest.mark.parametrize(
    ("recipe", "message"),
    [
        ({"trim": 0.0}, "give a length above zero"),
        ({"trim": "lead-in"}, "trim is 'lead-in'; give trim_segment"),
        ({"manoeuvres": "some"}, "give detected or entire"),
    ],
)
def test_meaningless_recipes_are_refused(recipe: dict, message: str):
    with pytest.raises(TelemetryError, match=message):
        ScoringRecipe(**recipe)


def test_a_trim_segment_longer_than_the_manoeuvre_is_refused(attas: Monitor, calm: np.ndarray):
    with pytest.raises(TelemetryError, match=r"20 s is longer than entire recording \(10 s\)"):
        score(attas, recorded(calm), ScoringRecipe(trim=20.0, manoeuvres="entire"))


@pytest.mark.parametrize(
    ("alerts", "exceedance", "expected"),
    [
        (((1.0, 1.1),), None, ("false_alert", None)),
        ((), None, ("quiet", None)),
        ((), 3.0, ("missed", None)),
        (((3.1, 3.2),), 3.0, ("missed", None)),
        (((2.75, 2.8),), 3.0, ("timely_alert", 0.25)),
        (((2.8, 3.0),), 3.0, ("late_alert", 0.2)),
        (((1.0, 1.1), (2.9, 3.0)), 3.0, ("timely_alert", 2.0)),
        (((3.0, 3.2),), 3.0, ("late_alert", 0.0)),
    ],
)
def test_an_alert_is_timely_from_the_promised_lead_on(alerts, exceedance, expected):
    limit = None if exceedance is None else RecordedExceedance(exceedance, "Ny", 0.21)
    result, lead = outcome(alerts, limit, 0.25)
    assert (result, lead) == (expected[0], pytest.approx(expected[1]))


def test_an_exceedance_between_the_monitors_samples_counts():
    t = np.arange(0.0, 10.0, 0.01)
    values = np.where(np.arange(len(t)) == 502, -0.25, 0.01)
    traces = Traces({"Ny": Trace(t, values)})
    limits = Limits(Ny=0.2).envelope
    trim = TrimSteps.constant(np.full(6, 0.01))
    limited = against_limits(traces, LATERAL, limits, trim, 2.0, 8.0)
    assert limited.exceedance == RecordedExceedance(float(t[502]), "Ny", -0.25 - 0.01)
    assert limited.lost == 0.0
    later = against_limits(traces, LATERAL, limits, trim, 6.0, 8.0)
    assert later.exceedance is None
    assert later.peaks[0][:4] == ("Ny", pytest.approx(0.0), -0.2, 0.2)


def test_removing_a_bias_does_not_hide_an_exceedance_as_recorded(attas: Monitor, calm: np.ndarray):
    small = 0.5 * calm
    traces = recorded(small)
    ny = traces.channels["Ny"]
    biased = Traces(traces.channels | {"Ny": replace(ny, bias=0.3)})
    scored = score(attas, biased)
    (manoeuvre,) = scored.manoeuvres
    assert (manoeuvre.outcome, manoeuvre.exceedance) == ("quiet", None)
    raw = manoeuvre.recorded_exceedance
    assert raw is not None
    assert (raw.t, raw.channel) == (manoeuvre.start, "Ny")
    first = manoeuvre.first
    assert raw.value == pytest.approx(small[first, NY] + 0.3)
    assert "the bias of 0.3 g that the mapping removes" in " ".join(manoeuvre.remarks)
    line = "LIMIT EXCEEDED as recorded, not from trim; no alert, no limit exceeded from trim"
    assert line in verdict(attas, scored)[0]
    assert the_only_manoeuvre(attas, traces).recorded_exceedance is None


def test_lost_samples_of_a_limited_channel_are_reported(attas: Monitor, calm: np.ndarray):
    holed = calm.copy()
    holed[100:125, NY] = np.nan
    manoeuvre = the_only_manoeuvre(attas, recorded(holed))
    assert any("1.25 s missing" in line for line in manoeuvre.remarks)
    assert any("25 invalid" in line for line in manoeuvre.remarks)


def test_outcomes_of_flights_follow_the_limit_and_the_alert(attas: Monitor):
    flights = fly(40, 6)
    outcomes = []
    for y, fail in zip(flights.y, flights.fail_index, strict=True):
        manoeuvre = the_only_manoeuvre(attas, recorded(y))
        outcomes.append(manoeuvre.outcome)
        if manoeuvre.outcome == "invalid":
            continue
        # sensor noise: the record may exceed the limit earlier than the aircraft, or alone
        near = np.abs(y[manoeuvre.first : manoeuvre.last, NY]).max() > 0.19
        assert (manoeuvre.exceedance is not None) <= near
        assert (fail < manoeuvre.last) <= near
        assert (manoeuvre.lead is not None) == (manoeuvre.outcome in ("timely_alert", "late_alert"))
        end = np.inf if manoeuvre.exceedance is None else manoeuvre.exceedance.t
        alerted = bool(manoeuvre.alerts) and manoeuvre.alerts[0][0] <= end
        assert alerted == (manoeuvre.outcome not in ("quiet", "missed"))
    assert {"timely_alert", "quiet"} <= set(outcomes)


def test_a_manoeuvre_outside_the_flight_condition_is_withdrawn_as_a_whole(attas: Monitor, calm):
    scored = score(attas, recorded(calm, V=180.0))
    (manoeuvre,) = scored.manoeuvres
    part = scored.samples[manoeuvre.first : manoeuvre.last + 1]
    valid = score(attas, recorded(calm, V=131.0)).samples[manoeuvre.first : manoeuvre.last + 1]
    assert manoeuvre.validity.valid is False
    assert (manoeuvre.outcome, manoeuvre.peak_risk, manoeuvre.alerts) == ("invalid", None, ())
    assert (part["state"] == INVALID).all()
    assert np.isnan(part["p_value"]).all()
    assert not part["alert"].any()
    np.testing.assert_array_equal(part["withdrawn"], valid["p_value"])
    assert manoeuvre.guarantee.startswith("Guarantee withdrawn: 180.0 m/s, +37.4% from")


def test_a_valid_manoeuvre_states_the_guarantee_with_its_numbers(attas: Monitor, calm: np.ndarray):
    manoeuvre = the_only_manoeuvre(attas, recorded(calm, V=128.0, h=4800.0))
    validity = manoeuvre.validity
    assert validity.valid is True
    assert all(check.ok is not False for check in validity.checks)
    assert validity.p_value is not None
    assert validity.p_value > 0.02
    text = {check.name: check.text for check in validity.checks}
    assert (
        "128.0 m/s, -2.3% from the model's 131.0 m/s; altitude 4800 m" in text["flight condition"]
    )
    assert "20 Hz" in text["rate"]
    assert manoeuvre.guarantee.startswith("At most 0.1 of the flights")
    assert "0.25 s" in manoeuvre.guarantee
    unknown = the_only_manoeuvre(attas, recorded(calm)).guarantee
    assert "no airspeed recorded." in unknown


@pytest.mark.parametrize(
    ("check", "text", "change"),
    [
        (
            "units",
            "degrees read as radians?",
            lambda y: np.degrees(y) * [1, 1, 1, np.pi / 180, 1, 1],
        ),
        ("manoeuvre", "moved the other way first", lambda y: y * [1, 1, 1, 1, 1, -1]),
        ("manoeuvre", "barely flown", lambda y: 0.2 * y),
        (
            "manoeuvre",
            "although the planned manoeuvre does not use it",
            lambda y: y[:, [0, 1, 2, 3, 5, 5]],
        ),
        ("trim", "trim of r unknown: the aircraft moved before", lambda y: y + swinging(y)),
    ],
)
def test_the_monitor_is_not_applicable_to_an_unplanned_manoeuvre(
    attas: Monitor, calm, check, text, change
):
    assert text in failed(attas, recorded(change(calm)))[check]


def swinging(y: np.ndarray) -> np.ndarray:
    """A yawing motion that starts before the input."""
    motion = np.zeros_like(y)
    motion[:, 2] = 0.1 * np.sin(2.0 * np.arange(len(y)) * TEST.dt)
    return motion


def test_a_manoeuvre_longer_than_planned_is_not_covered(attas: Monitor, calm: np.ndarray):
    long = np.vstack([calm, np.tile(calm[-1:], (100, 1))])
    whole = ScoringRecipe(manoeuvres="entire")
    assert "mark the manoeuvre by itself" in failed(attas, recorded(long), whole)["length"]
    a_little = ScoringRecipe(manoeuvres=(Interval(2.0, 9.0),))
    checks = the_only_manoeuvre(attas, recorded(long), a_little).validity.checks
    (length,) = (check for check in checks if check.name == "length")
    assert length.ok is None
    assert "the rest is not covered" in length.text


def test_the_monitor_is_not_applicable_to_observations_unlike_training(
    attas: Monitor, calm: np.ndarray
):
    gust = calm.copy()
    gust[100:110, 0] += 0.05
    text = failed(attas, recorded(gust))["observations within training"]
    assert "off its forecast" in text
    assert ", mostly beta (" in text


def test_an_invalid_manoeuvre_is_withdrawn_where_a_stream_withdraws(
    attas: Monitor, calm: np.ndarray, monkeypatch: pytest.MonkeyPatch
):
    gust = calm.copy()
    gust[100:110, 0] += 0.05
    followed = []
    follow = flight_verdict.follow
    monkeypatch.setattr(
        flight_verdict, "follow", lambda *given: (followed.append(len(given[2])), follow(*given))[1]
    )
    (manoeuvre,) = (scored := score(attas, recorded(gust))).manoeuvres
    passes = list(followed)
    onset = manoeuvre.first + round(TEST.maneuver.lead_in_s / attas.dt)
    part = slice(onset - attas.recipe.n_delay - 1, manoeuvre.last + 1)
    t, y = scored.samples["t"][part], gust[part] - np.array(manoeuvre.trim)
    withdrawal = attas.assess(t, y).withdrawal
    assert withdrawal is not None
    assert manoeuvre.withdrawn_t == t[withdrawal.first]
    assert manoeuvre.withdrawn_reason == withdrawal.reason
    assert manoeuvre.validity.reasons == (withdrawal.reason,)
    assert passes[1:] == [withdrawal.first + 1]


def test_the_monitor_is_applicable_to_fresh_flights(attas: Monitor):
    """At most the stated level of failing and of safe flights is invalid (3 sigma)."""
    flights = fly(150, 7)
    manoeuvres = [the_only_manoeuvre(attas, recorded(y)) for y in flights.y]
    wrong = np.array([manoeuvre.validity.valid is False for manoeuvre in manoeuvres])
    failing = flights.fail_index <= np.array([manoeuvre.last for manoeuvre in manoeuvres])
    assert attas.support is not None
    level = attas.support.level
    for kind in (failing, ~failing):
        bound = level + 3.0 * np.sqrt(level * (1.0 - level) / kind.sum())
        assert wrong[kind].mean() <= bound


def test_detection_and_trim_cost_no_timely_alert(attas: Monitor):
    """They add misses in at most 4 % of the failing flights (fixed seed)."""
    flights = fly(300, 8)
    start = round(2.5 / attas.dt)  # start of the planned test in these longer flights
    missed = np.zeros(2)
    failing = np.flatnonzero(flights.fail_index < start + 121)
    for i in failing:
        y, last = flights.y[i], flights.fail_index[i] - attas.h
        samples = score(attas, recorded(y)).samples
        risk = np.fmax(samples["p_value"], samples["withdrawn"])
        plain = attas.assess(np.arange(len(y) - start) * attas.dt, y[start:])
        in_time = risk[: last + 1] > attas.recipe.epsilon, plain.alert[: last - start + 1]
        missed += [not alerts.any() for alerts in in_time]
    assert missed[0] <= missed[1] + 0.04 * len(failing)


def test_without_calibrated_validity_there_is_no_guarantee(attas, calm):
    manoeuvre = the_only_manoeuvre(replace(attas, support=None), recorded(calm))
    assert manoeuvre.validity.valid is None
    assert manoeuvre.validity.checks[-1].ok is None
    assert "not calibrated" in manoeuvre.guarantee
    assert manoeuvre.guarantee.startswith("No guarantee")
    assert manoeuvre.peak_risk is not None


def test_a_missing_needed_channel_is_named_with_its_derivation(attas: Monitor, calm):
    traces = recorded(calm)
    without = Traces({key: trace for key, trace in traces.channels.items() if key != "beta"})
    with pytest.raises(TelemetryError, match=r"needs beta, which .*, or choose"):
        score(attas, without)
    with_speeds = recorded(calm, v=1.0, V=131.0)
    del with_speeds.channels["beta"]
    with pytest.raises(TelemetryError, match=r"does not have: .* derive beta from v and V,"):
        score(attas, with_speeds)


def test_a_channel_that_the_monitor_does_not_read_may_be_missing(calm: np.ndarray):
    silent = replace(TEST, noise=replace(TEST.noise, delta_a=0.0), n_unsafe=40)
    monitor = trained(silent)
    assert needed_channels(monitor).tolist() == [True] * 4 + [
        False,
        True,
    ]
    still = calm * [1, 1, 1, 1, 0, 1]
    whole = score(monitor, recorded(still))
    traces = recorded(still)
    del traces.channels["delta_a"]
    part = score(monitor, traces)
    assert any("not read by the monitor: delta_a" in note for note in part.notes)
    np.testing.assert_array_equal(part.samples["p_value"], whole.samples["p_value"])
    assert np.isnan(part.samples["y"][:, KEYS.index("delta_a")]).all()
    assert part.manoeuvres[0].trim[KEYS.index("delta_a")] is None


def test_several_epsilons_differ_only_in_their_alerts(attas: Monitor, calm: np.ndarray):
    loose, strict = score_at_each(attas, repair(recorded(calm)), ScoringRecipe(), (0.5, 0.05))
    assert (loose.epsilon, strict.epsilon) == (0.5, 0.05)
    for name in sample_type(6).names or ():
        if name != "alert":
            np.testing.assert_array_equal(loose.samples[name], strict.samples[name])
    for scored in (loose, strict):
        p_value = scored.samples["p_value"]
        assert (scored.samples["alert"] == (p_value > scored.epsilon)).all()
        alone = score(attas, recorded(calm), ScoringRecipe(epsilon=scored.epsilon))
        assert alone.samples.tobytes() == scored.samples.tobytes()
    with pytest.raises(ValueError, match="needs at least 999"):
        score(attas, recorded(calm), ScoringRecipe(epsilon=0.001))


def test_a_guarantee_with_confidence_alerts_above_its_rank(attas: Monitor, calm: np.ndarray):
    confident = replace(attas, recipe=replace(attas.recipe, guarantee="95%"))
    scored = score(confident, recorded(calm), ScoringRecipe(epsilon=0.5))
    above = confident_rank(0.5, confident.n_unsafe) / (confident.n_unsafe + 1)
    assert (scored.epsilon, scored.alert_above) == (0.5, above)
    samples = scored.samples
    assert (samples["alert"] == (samples["p_value"] > above)).all()
    guarantee = scored.manoeuvres[0].guarantee
    assert guarantee.startswith("At most 0.5 of the flights")
    assert "with 95 % confidence" in guarantee


def test_the_same_recipe_gives_the_same_bytes(attas: Monitor, calm: np.ndarray):
    first, second = (score(attas, recorded(calm, V=131.0)) for _ in range(2))
    assert first.samples.tobytes() == second.samples.tobytes()
    plain = [[asdict(s) for s in scored.manoeuvres] for scored in (first, second)]
    assert plain[0] == plain[1]
    assert json.dumps(plain[0], allow_nan=False)


def test_attitude_is_stored_as_recorded(attas: Monitor, calm: np.ndarray):
    samples = score(attas, recorded(calm, phi=0.1, psi=2.0)).samples
    assert (samples["attitude"][:, [0, 2]] == [0.1, 2.0]).all()
    assert np.isnan(samples["attitude"][:, 1]).all()


def test_the_real_doublet_is_valid_and_gets_a_timely_alert():
    """The monitor is trained with the usual imperfections and hands of any usual softness."""
    usual = replace(TEST, maneuver=Doublet(amplitude_deg=-3.7), noise=SensorNoise()).as_trained()
    manoeuvre, after = score(trained(usual), record("attas_rud1")).manoeuvres
    assert after.validity.valid is False  # the rudder moves on while the aircraft still swings
    assert manoeuvre.validity.valid is True
    assert manoeuvre.outcome == "timely_alert"
    assert manoeuvre.exceedance is not None
    assert (manoeuvre.exceedance.channel, manoeuvre.exceedance.t) == ("Ny", pytest.approx(8.76))
    assert manoeuvre.start == pytest.approx(5.3, abs=0.3)


@pytest.mark.parametrize(("name", "limit"), [("dc8_15k_m0p44", 0.1), ("f4c_35k_m0p6", 0.07)])
def test_the_real_doublet_is_invalid_under_another_aircrafts_monitor(name: ModelName, limit: float):
    """With a validity check of the outputs alone it was valid and missed."""
    other = replace(
        TEST,
        aircraft=PublishedAircraft(name, n_states=4),
        maneuver=Doublet(amplitude_deg=-3.7),
        specification=Limits(Ny=limit),
        noise=SensorNoise(),
    ).as_flown()
    verdict = score(trained(other), record("attas_rud1")).manoeuvres[0].validity
    assert verdict.valid is False
    assert (verdict.residual_p or 1.0) <= 0.01


def test_another_manoeuvre_of_the_same_aircraft_is_invalid_with_a_reason(attas: Monitor):
    manoeuvres = score(attas, record("attas_ail1")).manoeuvres
    assert all(manoeuvre.validity.valid is False for manoeuvre in manoeuvres)
    texts = {check.name: check.text for check in manoeuvres[0].validity.checks}
    assert "aileron moved by 14 deg, although" in texts["manoeuvre"]
    assert "off its forecast" in texts["observations within training"]


@pytest.fixture(scope="module")
def of_ny_alone() -> Monitor:
    """A monitor that reads only N_y, at the Citation's rate."""
    recipe = MonitorRecipe(
        predictor=PREDICTORS["last_output"], score=SCORES["negative_magnitude"], t_early=0.3
    )
    return trained(replace(TEST, dt=0.1, n_unsafe=40), recipe)


def test_a_record_without_sideslip_is_refused_by_a_monitor_that_reads_it():
    slow = trained(replace(TEST, dt=0.1, n_unsafe=40))
    with pytest.raises(TelemetryError, match=r"needs beta, which the recording does not have"):
        score(slow, record("citation_20190312_dutchroll"))


def test_a_record_too_slow_for_the_monitor_is_refused_with_the_numbers(attas: Monitor, calm):
    with pytest.raises(TelemetryError, match=r"0\.1 s"):
        score(attas, recorded(calm[::2], dt=0.1))


@pytest.mark.parametrize("name", ["citation_20190312_dutchroll", "citation_20190312_dutchroll_yd"])
def test_a_monitor_of_fewer_channels_scores_it_and_detects_another_aircraft(of_ny_alone, name: str):
    traces = record(name)
    reversed_ = {
        key: replace(traces.channels[key], values=-traces.channels[key].values)
        for key in ("delta_a", "delta_r")
    }
    scored = score(of_ny_alone, Traces(traces.channels | reversed_))
    assert any("not read by the monitor: beta" in note for note in scored.notes)
    assert all(manoeuvre.validity.valid is False for manoeuvre in scored.manoeuvres)
    manoeuvre = scored.manoeuvres[0]
    text = {check.name: check for check in manoeuvre.validity.checks}
    assert text["flight condition"].ok is False
    assert "from the model's 131.0 m/s" in text["flight condition"].text
    assert text["observations within training"].ok is None
    part = scored.samples[manoeuvre.first : manoeuvre.last + 1]
    begun = np.flatnonzero(np.isfinite(part["withdrawn"]))[0]
    assert np.isfinite(part["withdrawn"][begun:]).all()


def test_a_trim_segment_of_any_length_takes_what_is_recorded(attas: Monitor, calm: np.ndarray):
    (longest,) = score(attas, recorded(calm), ScoringRecipe(trim=1e308)).manoeuvres
    (long,) = score(attas, recorded(calm), ScoringRecipe(trim=1e4)).manoeuvres
    assert longest.trim == long.trim


@pytest.mark.parametrize("calls", [(), (9.0,), (0.5,)])
def test_a_recording_that_ends_within_a_manoeuvre_has_no_verdict(attas: Monitor, calls):
    """An alert followed by a call is an abort; an exceedance keeps its verdict."""
    outcomes = set()
    for y in fly(40, 6).y:
        manoeuvre = the_only_manoeuvre(attas, recorded(y))
        stop = manoeuvre.first + 60
        (part,) = score(attas, recorded(y[:stop]), calls=calls).manoeuvres
        if manoeuvre.outcome == "invalid" or part.outcome == "invalid":
            continue
        if part.exceedance is not None:
            assert part.outcome == manoeuvre.outcome
            continue
        is_aborted = bool(part.alerts) and any(t >= part.alerts[0][0] for t in calls)
        assert part.outcome == ("aborted" if is_aborted else "cut")
        assert part.validity.valid is None
        assert part.guarantee.startswith("No guarantee: the recording ends within the manoeuvre")
        level, words = facts.headline([asdict(part)])
        assert (level, words.endswith("no verdict")) == ("caution", True)
        outcomes.add(part.outcome)
    assert outcomes == ({"cut", "aborted"} if 9.0 in calls else {"cut"})
