"""Missing data give no verdict and no miss; exceedances outside manoeuvres are reported."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from app.assessment import ScoredManoeuvre, ScoringRecipe
from app.assessment.coverage import why_warning_unknown
from app.assessment.outcome import (
    APART,
    MOST_OUTSIDE,
    Hole,
    Limited,
    RecordedExceedance,
    exceedances_outside,
    notes_on_outside,
)
from app.assessment.trim import TrimSteps
from app.assessment.wording import verdict
from app.report.facts import headline
from app.telemetry.recording import Trace, Traces
from core.channels import KEYS, LATERAL
from core.limits.limits import Limits
from core.monitor import Assessments, Monitor
from core.monitor.assessment import STATES, State
from tests.app.assessment.test_wording import assessments
from tests.support.attas import fly, record, recorded, score

NY = KEYS.index("Ny")


@pytest.fixture(scope="module")
def calm(attas: Monitor) -> np.ndarray:
    """A valid flight: 3 s of rest and one doublet without exceedance."""
    for y in fly(40, 5).y:
        (manoeuvre,) = score(attas, recorded(y)).manoeuvres
        if manoeuvre.validity.valid and manoeuvre.outcome == "quiet":
            return y
    raise AssertionError("no quiet flight among 40")


def only(monitor: Monitor, traces: Traces, recipe: ScoringRecipe | None = None) -> ScoredManoeuvre:
    (manoeuvre,) = score(monitor, traces, recipe).manoeuvres
    return manoeuvre


def without(y: np.ndarray, start: int, stop: int, column: int) -> np.ndarray:
    lost = y.copy()
    lost[start:stop, column] = np.nan
    return lost


@pytest.mark.parametrize("column", [NY, 0])
def test_a_manoeuvre_with_data_missing_is_not_quiet(attas: Monitor, calm: np.ndarray, column: int):
    manoeuvre = only(attas, recorded(without(calm, 100, 150, column)))
    assert manoeuvre.outcome == "unseen"
    assert manoeuvre.validity.valid is None
    assert "samples are missing or were not assessed; the limit is 10%" in manoeuvre.guarantee
    assert manoeuvre.guarantee.startswith("No guarantee")
    assert any(line.startswith("data missing: no sample ") for line in manoeuvre.remarks)
    assert headline([asdict(manoeuvre)])[0] == "caution"


def test_the_missing_channel_is_named_where_no_sample_is_assessed(attas: Monitor, calm: np.ndarray):
    lost = calm.copy()
    lost[len(calm) // 4 :: 2, NY] = np.nan
    lost[len(calm) // 4 + 1 :: 4, NY] = np.nan
    validity = only(attas, recorded(lost)).validity
    checks = {check.name: check for check in validity.checks}
    assert validity.valid is False
    assert checks["rate"].ok is not False
    assert checks["coverage"].ok is False
    assert "Ny is missing in" in checks["coverage"].text


def test_a_single_lost_sample_changes_nothing(attas: Monitor, calm: np.ndarray):
    manoeuvre = only(attas, recorded(without(calm, 100, 101, NY)))
    assert manoeuvre.outcome == "quiet"
    assert manoeuvre.validity.valid


@pytest.mark.parametrize(("column", "value"), [(NY, 1e3), (0, 1e3)])
def test_a_single_implausible_sample_of_a_limited_channel_is_not_quiet(
    attas: Monitor, calm: np.ndarray, column: int, value: float
):
    odd = calm.copy()
    odd[100, column] = value
    manoeuvre = only(attas, recorded(odd))
    assert manoeuvre.outcome == ("unseen" if column == NY else "quiet")
    assert any("check the sensor" in line for line in manoeuvre.remarks) == (column == NY)


@pytest.mark.parametrize("way", ["cut", "nan"])
def test_the_real_doublet_without_its_exceedance_is_unseen(attas: Monitor, way: str):
    channels = {}
    for key, trace in record("attas_rud1").channels.items():
        hole = (trace.t > 7.96) & (trace.t < 10.4)
        if way == "cut":
            channels[key] = replace(trace, t=trace.t[~hole], values=trace.values[~hole])
        elif key == "Ny":
            channels[key] = replace(trace, values=np.where(hole, np.nan, trace.values))
        else:
            channels[key] = trace
    manoeuvre = score(attas, Traces(channels)).manoeuvres[0]
    assert manoeuvre.outcome == "unseen"
    assert manoeuvre.validity.valid is not True
    assert any("no sample of Ny from 7.96 to 10.40 s" in line for line in manoeuvre.remarks)


def assessed(*lost: int) -> Assessments:
    """41 assessments from 8 s on, a tenth of a second each; those lost are invalid."""
    result = assessments(*[0.05] * 41)
    result.state[list(lost)] = STATES.index(State.INVALID)
    return result


@pytest.mark.parametrize(
    ("hole", "lost", "alerts", "text"),
    [
        ((8.16, 9.0), (), (), "could not warn: no sample from 8.16 to 9.00 s; the limit was"),
        ((8.16, 9.0), (), ((8.1, 8.1),), "unknown whether the alert was timely"),
        ((8.66, 9.0), (), ((8.1, 8.1),), ""),
        ((8.96, 9.0), (), (), ""),
        ((8.0, 8.6), (), (), ""),
        (None, range(3, 9), (), "could not warn: no sample assessed from 8.50 to 8.70"),
        (None, range(3, 7), (), ""),
        (None, range(3, 9), ((8.1, 8.1),), ""),
        (None, range(10), (), "limit exceeded at 9.00 s, before it could be assessed"),
        (None, (), (), ""),
    ],
)
def test_a_gap_before_the_exceedance_is_not_a_miss(hole, lost, alerts, text: str):
    exceedance = RecordedExceedance(9.0, "Ny", 0.21)
    holes = () if hole is None else (Hole("Ny", hole[0], hole[1], hole[1] - hole[0] - 0.02),)
    limited = Limited(exceedance, (), 0.0, holes)
    reason = why_warning_unknown(limited, exceedance, assessed(*lost), alerts, 0.25, 0.1)
    assert reason.startswith(text)
    assert bool(reason) == bool(text)


def test_no_alert_before_a_gap_that_hides_the_exceedance_is_unseen(attas: Monitor, calm):
    y = calm.copy()
    y[120:140, NY], y[140:143, NY] = np.nan, 0.5
    manoeuvre = only(attas, recorded(y), ScoringRecipe(epsilon=0.9))
    assert manoeuvre.exceedance is not None
    if manoeuvre.validity.valid is not False:
        assert manoeuvre.outcome == "unseen"
        assert any("the limit was exceeded in between" in line for line in manoeuvre.remarks)


def test_exceedances_outside_every_manoeuvre_are_reported(attas: Monitor, calm: np.ndarray):
    y = np.vstack([calm, np.tile(calm[-1:], (200, 1))])
    y[-100:-96, NY], y[-40:-36, NY] = 0.48, -0.4
    scored = score(attas, recorded(y))
    dt = attas.dt
    assert [c.t for c in scored.outside_exceedances] == pytest.approx(
        [(len(y) - k) * dt for k in (100, 40)]
    )
    assert {c.channel for c in scored.outside_exceedances} == {"Ny"}
    assert scored.outside_exceedances[0].value == pytest.approx(
        0.48 - (scored.manoeuvres[0].trim[NY] or 0.0)
    )
    assert any("outside every manoeuvre" in note and "2 times" in note for note in scored.notes)
    assert any(line.startswith("outside every manoeuvre") for line in verdict(attas, scored))
    assert score(attas, recorded(y), ScoringRecipe(manoeuvres="entire")).outside_exceedances == ()
    assert score(attas, recorded(calm)).outside_exceedances == ()
    assert notes_on_outside((), LATERAL) == ()


def test_an_exceedance_belongs_to_the_manoeuvre_it_begins_in():
    t = np.arange(0.0, 100.0, 0.1)
    value = np.where((t > 9.5) & (t < 12.0), 0.5, 0.0)
    value[[500, 505, 700]] = 0.6
    traces = Traces({"Ny": Trace(t, value)})
    limits = Limits(Ny=0.2).envelope
    found = exceedances_outside(
        traces, LATERAL, limits, [(5.0, 10.0), (65.0, 75.0)], TrimSteps.constant(np.zeros(6))
    )
    assert [c.t for c in found] == pytest.approx([50.0])
    assert APART > 0.5
    assert MOST_OUTSIDE >= 1


def test_many_exceedances_outside_suggest_a_wrong_mapping():
    often = tuple(RecordedExceedance(20.0 * n, "Ny", 0.6) for n in range(23))
    rare = tuple(RecordedExceedance(5.0 + n, "beta", 0.3) for n in range(2))
    doubt, note = notes_on_outside(often + rare, LATERAL)
    assert doubt.startswith("Ny exceeded its limit 23 times outside every manoeuvre: ")
    assert all(word in doubt for word in ("signal", "unit", "sign", "offset"))
    assert "25 times" in note
    assert len(notes_on_outside(often[:2] + rare, LATERAL)) == 1


def test_an_invalid_manoeuvre_shows_alert_and_lead_as_invalid(attas: Monitor, calm: np.ndarray):
    lines = verdict(attas, score(attas, recorded(calm, V=180.0)))
    assert "  first alert        INVALID" in lines
    assert "  warning lead time  INVALID" in lines


def test_a_trim_longer_than_recorded_reports_the_length_used(attas: Monitor, calm: np.ndarray):
    manoeuvre = only(attas, recorded(calm), ScoringRecipe(trim=100.0))
    (line,) = (line for line in manoeuvre.remarks if line.startswith("trim from 100 s"))
    assert "only 3.00 s" in line or "2.9" in line
    short = only(attas, recorded(calm), ScoringRecipe(trim=1.0))
    assert not any(line.startswith("trim from") for line in short.remarks)


def test_a_sensor_slower_than_its_recorder_is_judged_at_its_own_rate(
    attas: Monitor, calm: np.ndarray
) -> None:
    held = calm.copy()
    held[:, 1] = np.repeat(calm[::4, 1], 4)[: len(calm)]
    rate = next(c for c in only(attas, recorded(held)).validity.checks if c.name == "rate")
    assert rate.ok is False
    assert "p recorded at 5 Hz" in rate.text
    assert "repeats in 4 rows" in rate.text


def test_an_exceedance_hidden_by_trim_is_reported(attas: Monitor, calm: np.ndarray) -> None:
    skidding = calm.copy()
    skidding[:, NY] += np.sign(calm[:, NY][np.abs(calm[:, NY]).argmax()]) * 0.2
    manoeuvre = only(attas, recorded(skidding))
    assert manoeuvre.exceedance is None
    assert any("as recorded, with trim, is" in line for line in manoeuvre.remarks)
