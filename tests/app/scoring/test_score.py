"""A recording is scored manoeuvre by manoeuvre, and only where the monitor has a right to speak."""

import json
from dataclasses import replace

import numpy as np
import pytest

from app.scoring import BETWEEN, SAMPLE, ScoringOrder, Span, manoeuvres_in, score_at_each
from app.scoring.outcome import Crossing, against_limits, outcome
from app.scoring.plan import needed_channels, plan_of
from app.telemetry.recording import TelemetryError
from app.telemetry.timing.repair import repair
from app.telemetry.traces import Trace, Traces
from core.channels import KEYS
from core.collection import Simulator
from core.monitor import Monitor, MonitorRecipe
from core.monitor.assessment import STATES, State
from core.monitor.predictor import PREDICTORS
from core.monitor.score import SCORES
from tests.support.attas import TEST, fly, record, recorded, score, trained

INVALID = STATES.index(State.INVALID)
UNTOUCHED = ScoringOrder(trim=None, manoeuvres="whole")
NY = KEYS.index("Ny")


def planned(n: int, seed: int) -> np.ndarray:
    """(n, n_samples, 6) fresh flights of the test as it was planned."""
    return Simulator(TEST).rollouts(n, np.random.default_rng(seed)).y


@pytest.fixture(scope="module")
def calm(attas: Monitor) -> np.ndarray:
    """A flight of 3 s of rest and one doublet, whose right to speak is beyond doubt."""
    for y in fly(20, 5).y:
        if score(attas, recorded(y)).stretches[0].validity.valid:
            return y
    raise AssertionError("no valid flight among 20")


def the_only_stretch(monitor: Monitor, traces: Traces, order: ScoringOrder | None = None):
    (stretch,) = score(monitor, traces, order).stretches
    return stretch


def failed(monitor: Monitor, traces: Traces, order: ScoringOrder | None = None) -> dict[str, str]:
    """What each failed check of the only stretch says."""
    checks = the_only_stretch(monitor, traces, order).validity.checks
    return {check.name: check.text for check in checks if check.ok is False}


def test_a_flight_left_as_it_is_gets_the_monitors_own_bits(attas: Monitor):
    for y in planned(5, 1):
        samples = score(attas, recorded(y), UNTOUCHED).samples
        said = attas.assess(np.arange(len(y)) * attas.dt, y)
        raw = np.where(np.isnan(samples["p_value"]), samples["withdrawn"], samples["p_value"])
        assert (raw == said.p_value).all()
        np.testing.assert_array_equal(samples["y"], y)
        np.testing.assert_array_equal(samples["y_hat"], said.y_hat)


def test_each_manoeuvre_is_a_flight_of_its_own(attas: Monitor):
    flights = fly(3, 2).y
    rest = np.tile(flights[0, :1], (200, 1))
    together = np.vstack([part for y in flights for part in (y, rest)])
    scored = score(attas, recorded(together))
    assert len(scored.stretches) == 3
    assert [stretch.name for stretch in scored.stretches] == [f"manoeuvre {k}" for k in (1, 2, 3)]
    for number, (stretch, y) in enumerate(zip(scored.stretches, flights, strict=True)):
        alone = the_only_stretch(attas, recorded(y))
        shift = number * (len(y) + len(rest))
        assert (stretch.first - shift, stretch.outcome) == (alone.first, alone.outcome)
        assert stretch.peak_risk == alone.peak_risk
        part = scored.samples[stretch.first : stretch.last + 1]
        assert (part["stretch"] == number).all()


def test_a_found_manoeuvre_begins_with_the_planned_lead_in_and_lasts_as_planned(attas: Monitor):
    for y in fly(10, 3).y:
        stretch = the_only_stretch(attas, recorded(y, start=3358.0))
        moved = np.flatnonzero(np.abs(y[:, 5]) > 5 * TEST.noise.delta_r)[0]
        assert stretch.first == pytest.approx(moved - 1 - 0.5 / attas.dt, abs=2)
        assert stretch.end - stretch.start == pytest.approx(TEST.maneuver.duration_s, abs=1e-6)
        assert manoeuvres_in(attas, repair(recorded(y, start=3358.0))) == (
            Span(stretch.start, stretch.end, "manoeuvre 1"),
        )


def test_between_manoeuvres_nothing_is_said(attas: Monitor, calm: np.ndarray):
    scored = score(attas, recorded(calm))
    between = scored.samples[scored.samples["stretch"] == BETWEEN]
    assert len(between) == len(calm) - 121
    assert (between["state"] == INVALID).all()
    assert np.isnan(between["p_value"]).all()
    assert np.isnan(between["withdrawn"]).all()
    assert not between["alert"].any()


def test_trim_is_the_mean_of_the_manoeuvres_own_lead_in(attas: Monitor, calm: np.ndarray):
    offset = np.array([0.02, -0.01, 0.005, 0.03, -0.02, 0.04])
    plain, moved = (score(attas, recorded(y)) for y in (calm, calm + offset))
    (stretch,), (other,) = plain.stretches, moved.stretches
    rest = calm[stretch.first : stretch.first + 10]
    assert stretch.trim == pytest.approx(rest.mean(axis=0))
    assert np.array(other.trim) - stretch.trim == pytest.approx(offset)
    np.testing.assert_allclose(moved.samples["y"], plain.samples["y"], atol=1e-12)
    assert other.outcome == stretch.outcome


def test_trim_of_seconds_is_the_mean_of_the_last_ones_before_the_input(attas: Monitor, calm):
    stretch = the_only_stretch(attas, recorded(calm), ScoringOrder(trim=2.0))
    onset = stretch.first + 10
    assert stretch.trim == pytest.approx(calm[onset - 40 : onset].mean(axis=0))
    whole = the_only_stretch(attas, recorded(calm), ScoringOrder(trim=2.0, manoeuvres="whole"))
    assert whole.trim == pytest.approx(calm[:40].mean(axis=0))


def test_a_recording_without_input_is_scored_as_one(attas: Monitor, calm: np.ndarray):
    scored = score(attas, recorded(calm[:60]))
    assert [s.name for s in scored.stretches] == ["whole recording"]
    assert any("No control input was found" in note for note in scored.notes)
    assert manoeuvres_in(attas, repair(recorded(calm[:60]))) == ()


def test_marked_stretches_are_scored_between_their_times(attas: Monitor, calm: np.ndarray):
    order = ScoringOrder(manoeuvres=(Span(8.5, 9.5, "tail"), Span(2.5, 8.5)))
    first, tail = score(attas, recorded(calm), order).stretches
    assert (first.name, first.first, first.last) == ("stretch 1", 50, 170)
    assert (tail.name, tail.first, tail.last) == ("tail", 170, 190)


@pytest.mark.parametrize(
    ("spans", "message"),
    [
        ((Span(-2.0, 3.0),), "-2 to 3 s is not inside the recording, which lasts from 0 to 10 s"),
        ((Span(4.0, 30.0),), "4 to 30 s is not inside"),
        ((Span(1.0, 4.0), Span(3.0, 5.0)), "1 to 4 s and 3 to 5 s overlap"),
        ((Span(4.0, 4.0),), "has no length"),
        ((Span(4.0, float("nan")),), "has no length"),
        ((Span(4.001, 4.002),), "fewer than two samples"),
        ((), "no stretch was marked"),
    ],
)
def test_stretches_that_cannot_be_are_refused(attas: Monitor, calm, spans, message: str):
    with pytest.raises(TelemetryError, match=message):
        score(attas, recorded(calm), ScoringOrder(manoeuvres=spans))


@pytest.mark.parametrize(
    ("order", "message"),
    [
        ({"trim": 0.0}, "give a length above zero"),
        ({"trim": "lead-in"}, "trim is 'lead-in'; give lead_in"),
        ({"manoeuvres": "some"}, "give found or whole"),
    ],
)
def test_orders_that_mean_nothing_are_refused(order: dict, message: str):
    with pytest.raises(TelemetryError, match=message):
        ScoringOrder(**order)


def test_a_trim_stretch_longer_than_what_is_marked_is_refused(attas: Monitor, calm: np.ndarray):
    with pytest.raises(TelemetryError, match=r"20 s was asked of 10 s \(whole recording\)"):
        score(attas, recorded(calm), ScoringOrder(trim=20.0, manoeuvres="whole"))


@pytest.mark.parametrize(
    ("alerts", "crossing", "expected"),
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
def test_an_alert_is_timely_that_comes_the_promised_lead_before(alerts, crossing, expected):
    limit = None if crossing is None else Crossing(crossing, "Ny", 0.21)
    what, lead = outcome(alerts, limit, 0.25)
    assert (what, lead) == (expected[0], pytest.approx(expected[1]))


def test_a_crossing_between_the_monitors_samples_counts():
    t = np.arange(0.0, 10.0, 0.01)
    values = np.where(np.arange(len(t)) == 502, -0.25, 0.01)
    traces = Traces({"Ny": Trace(t, values)})
    limits = np.array([np.inf, np.inf, np.inf, 0.2, np.inf, np.inf])
    found = against_limits(traces, limits, np.full(6, 0.01), 2.0, 8.0)
    assert found.crossing == Crossing(float(t[502]), "Ny", -0.25 - 0.01)
    assert found.lost == 0.0
    later = against_limits(traces, limits, np.full(6, 0.01), 6.0, 8.0)
    assert later.crossing is None
    assert later.peaks[0][:3] == ("Ny", pytest.approx(0.0), 0.2)


def test_what_a_limited_channel_lost_is_said(attas: Monitor, calm: np.ndarray):
    holed = calm.copy()
    holed[100:125, NY] = np.nan
    stretch = the_only_stretch(attas, recorded(holed))
    assert any("1.25 s of the limited channels are missing" in line for line in stretch.remarks)
    assert any("25 invalid" in line for line in stretch.remarks)


def test_outcomes_of_flights_follow_the_limit_and_the_alert(attas: Monitor):
    flights = fly(40, 6)
    found = []
    for y, fail in zip(flights.y, flights.fail_index, strict=True):
        stretch = the_only_stretch(attas, recorded(y))
        found.append(stretch.outcome)
        if stretch.outcome == "invalid":
            continue
        # sensor noise: the record can reach the limit where the aircraft did not, and before
        near = np.abs(y[stretch.first : stretch.last, NY]).max() > 0.19
        assert (stretch.crossing is not None) <= near
        assert (fail < stretch.last) <= near
        assert (stretch.lead is not None) == (stretch.outcome in ("timely_alert", "late_alert"))
        assert bool(stretch.alerts) == (stretch.outcome not in ("quiet", "missed"))
    assert {"timely_alert", "quiet"} <= set(found)


def test_a_stretch_without_the_right_to_speak_is_withdrawn_as_a_whole(attas: Monitor, calm):
    scored = score(attas, recorded(calm, V=180.0))
    (stretch,) = scored.stretches
    part = scored.samples[stretch.first : stretch.last + 1]
    valid = score(attas, recorded(calm, V=131.0)).samples[stretch.first : stretch.last + 1]
    assert stretch.validity.valid is False
    assert (stretch.outcome, stretch.peak_risk, stretch.alerts) == ("invalid", None, ())
    assert (part["state"] == INVALID).all()
    assert np.isnan(part["p_value"]).all()
    assert not part["alert"].any()
    np.testing.assert_array_equal(part["withdrawn"], valid["p_value"])
    assert stretch.guarantee.startswith("The guarantee is withdrawn: 180.0 m/s, +37.4% from")


def test_a_valid_stretch_carries_the_guarantee_and_its_numbers(attas: Monitor, calm: np.ndarray):
    stretch = the_only_stretch(attas, recorded(calm, V=128.0, h=4800.0))
    validity = stretch.validity
    assert validity.valid is True
    assert all(check.ok is not False for check in validity.checks)
    assert validity.p_value is not None
    assert validity.p_value > 0.02
    text = {check.name: check.text for check in validity.checks}
    assert (
        "128.0 m/s, -2.3% from the model's 131.0 m/s; altitude 4800 m" in text["flight condition"]
    )
    assert "20 Hz" in text["rate"]
    assert "at most 0.1 of them" in stretch.guarantee
    assert "0.25 s" in stretch.guarantee
    unknown = the_only_stretch(attas, recorded(calm)).guarantee
    assert "not wholly known: no airspeed is recorded." in unknown


@pytest.mark.parametrize(
    ("check", "text", "change"),
    [
        ("units", "or is it in degrees?", lambda y: np.degrees(y) * [1, 1, 1, np.pi / 180, 1, 1]),
        ("manoeuvre", "went the other way first", lambda y: y * [1, 1, 1, 1, 1, -1]),
        ("manoeuvre", "it was hardly flown", lambda y: 0.2 * y),
        (
            "manoeuvre",
            "which the planned manoeuvre leaves alone",
            lambda y: y[:, [0, 1, 2, 3, 5, 5]],
        ),
        ("trim", "does not begin at rest", lambda y: y + swinging(y)),
    ],
)
def test_what_was_not_planned_takes_the_right_to_speak(attas: Monitor, calm, check, text, change):
    assert text in failed(attas, recorded(change(calm)))[check]


def swinging(y: np.ndarray) -> np.ndarray:
    """A yawing motion that was there before the input."""
    motion = np.zeros_like(y)
    motion[:, 2] = 0.1 * np.sin(2.0 * np.arange(len(y)) * TEST.dt)
    return motion


def test_a_stretch_longer_than_the_manoeuvre_is_not_covered(attas: Monitor, calm: np.ndarray):
    long = np.vstack([calm, np.tile(calm[-1:], (100, 1))])
    whole = ScoringOrder(manoeuvres="whole")
    assert "mark the manoeuvre alone" in failed(attas, recorded(long), whole)["length"]
    a_little = ScoringOrder(manoeuvres=(Span(2.0, 9.0),))
    checks = the_only_stretch(attas, recorded(long), a_little).validity.checks
    (length,) = (check for check in checks if check.name == "length")
    assert length.ok is None
    assert "what comes later is not covered" in length.text


def test_observations_unlike_training_take_the_right_to_speak(attas: Monitor, calm: np.ndarray):
    gust = calm.copy()
    gust[100:110, 0] += 0.05
    said = failed(attas, recorded(gust))
    assert "beta was off its forecast" in said["observations within training"]


def test_fresh_flights_keep_their_right_to_speak(attas: Monitor):
    """Of failing and of safe flights alike, at most the stated level lose it (3 sigma)."""
    flights = fly(150, 7)
    stretches = [the_only_stretch(attas, recorded(y)) for y in flights.y]
    wrong = np.array([stretch.validity.valid is False for stretch in stretches])
    failing = flights.fail_index <= np.array([stretch.last for stretch in stretches])
    assert attas.support is not None
    level = attas.support.level
    for kind in (failing, ~failing):
        bound = level + 3.0 * np.sqrt(level * (1.0 - level) / kind.sum())
        assert wrong[kind].mean() <= bound


def test_finding_and_trimming_cost_no_alert_in_time(attas: Monitor):
    """Misses of failing flights are as many as without (4 % of flights at most, fixed seed)."""
    flights = fly(300, 8)
    start = round(2.5 / attas.dt)  # where the test as planned begins in these longer flights
    missed = np.zeros(2)
    failing = np.flatnonzero(flights.fail_index < start + 121)
    for i in failing:
        y, last = flights.y[i], flights.fail_index[i] - attas.h
        found = score(attas, recorded(y)).samples
        risk = np.fmax(found["p_value"], found["withdrawn"])
        plain = attas.assess(np.arange(len(y) - start) * attas.dt, y[start:])
        in_time = risk[: last + 1] > attas.recipe.epsilon, plain.alert[: last - start + 1]
        missed += [not alerts.any() for alerts in in_time]
    assert missed[0] <= missed[1] + 0.04 * len(failing)


def test_without_calibration_validity_is_not_known_and_nothing_is_promised(attas, calm):
    stretch = the_only_stretch(replace(attas, support=None), recorded(calm))
    assert stretch.validity.valid is None
    assert stretch.validity.checks[-1].ok is None
    assert "not calibrated" in stretch.guarantee
    assert stretch.guarantee.startswith("Nothing is promised")
    assert stretch.peak_risk is not None


def test_a_needed_channel_that_is_missing_is_named_with_what_derives_it(attas: Monitor, calm):
    traces = recorded(calm)
    without = Traces({key: trace for key, trace in traces.channels.items() if key != "beta"})
    with pytest.raises(TelemetryError, match=r"needs beta, which .* to what is missing, or choose"):
        score(attas, without)
    with_speeds = recorded(calm, v=1.0, V=131.0)
    del with_speeds.channels["beta"]
    with pytest.raises(TelemetryError, match=r"does not have: .* derive beta from v and V,"):
        score(attas, with_speeds)


def test_a_channel_that_the_monitor_does_not_read_may_be_missing(calm: np.ndarray):
    silent = replace(TEST, noise=replace(TEST.noise, delta_a=0.0), n_unsafe=40)
    monitor = trained(silent)
    assert needed_channels(monitor, plan_of(monitor).limits).tolist() == [True] * 4 + [False, True]
    still = calm * [1, 1, 1, 1, 0, 1]
    whole = score(monitor, recorded(still))
    traces = recorded(still)
    del traces.channels["delta_a"]
    part = score(monitor, traces)
    assert any("does not read it: delta_a" in note for note in part.notes)
    np.testing.assert_array_equal(part.samples["p_value"], whole.samples["p_value"])
    assert np.isnan(part.samples["y"][:, KEYS.index("delta_a")]).all()
    assert part.stretches[0].trim[KEYS.index("delta_a")] is None


def test_several_epsilons_differ_in_their_alerts_alone(attas: Monitor, calm: np.ndarray):
    loose, strict = score_at_each(attas, repair(recorded(calm)), ScoringOrder(), (0.5, 0.05))
    assert (loose.epsilon, strict.epsilon) == (0.5, 0.05)
    for name in SAMPLE.names or ():
        if name != "alert":
            np.testing.assert_array_equal(loose.samples[name], strict.samples[name])
    for scored in (loose, strict):
        p_value = scored.samples["p_value"]
        assert (scored.samples["alert"] == (p_value > scored.epsilon)).all()
        alone = score(attas, recorded(calm), ScoringOrder(epsilon=scored.epsilon))
        assert alone.samples.tobytes() == scored.samples.tobytes()
    with pytest.raises(ValueError, match="needs at least 999"):
        score(attas, recorded(calm), ScoringOrder(epsilon=0.001))


def test_the_same_order_gives_the_same_bytes(attas: Monitor, calm: np.ndarray):
    first, second = (score(attas, recorded(calm, V=131.0)) for _ in range(2))
    assert first.samples.tobytes() == second.samples.tobytes()
    plain = [[s.to_plain() for s in scored.stretches] for scored in (first, second)]
    assert plain[0] == plain[1]
    assert json.loads(json.dumps(plain[0], allow_nan=False)) == plain[0]


def test_attitude_is_kept_as_it_was_recorded(attas: Monitor, calm: np.ndarray):
    samples = score(attas, recorded(calm, phi=0.1, psi=2.0)).samples
    assert (samples["attitude"][:, [0, 2]] == [0.1, 2.0]).all()
    assert np.isnan(samples["attitude"][:, 1]).all()


def test_the_real_doublet_is_valid_and_warned_of_in_time(attas: Monitor):
    traces = record("attas_rud1")
    stretch = the_only_stretch(attas, traces)
    assert stretch.validity.valid is True
    assert stretch.outcome == "timely_alert"
    assert stretch.crossing is not None
    assert (stretch.crossing.channel, stretch.crossing.t) == ("Ny", pytest.approx(8.76))
    assert stretch.start == pytest.approx(5.3, abs=0.3)


def test_another_manoeuvre_of_the_same_aircraft_is_invalid_and_says_why(attas: Monitor):
    said = failed(attas, record("attas_ail1"))
    assert "aileron moved by 14°, which the planned manoeuvre leaves alone" in said["manoeuvre"]
    assert "delta_a was off its forecast" in said["observations within training"]


@pytest.fixture(scope="module")
def of_ny_alone() -> Monitor:
    """A monitor that reads N_y only, at the Citation's rate."""
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
def test_a_monitor_that_reads_less_scores_it_and_knows_another_aircraft(of_ny_alone, name: str):
    traces = record(name)
    reversed_ = {
        key: replace(traces.channels[key], values=-traces.channels[key].values)
        for key in ("delta_a", "delta_r")
    }
    scored = score(of_ny_alone, Traces(traces.channels | reversed_))
    (stretch,) = scored.stretches
    assert any("does not read it: beta" in note for note in scored.notes)
    text = {check.name: check for check in stretch.validity.checks}
    assert text["flight condition"].ok is False
    assert "from the model's 131.0 m/s" in text["flight condition"].text
    assert text["observations within training"].ok is None
    part = scored.samples[stretch.first : stretch.last + 1]
    assert np.isfinite(part["withdrawn"]).all()
