"""Sentences about a manoeuvre: withdrawn assessments, peaks, exceedances."""

from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.assessment.outcome import (
    Limited,
    Peak,
    RecordedExceedance,
    against_limits,
    lead_words,
    notes_on_outside,
    wording_of,
)
from app.assessment.scored import ScoredManoeuvre, Validity
from app.assessment.trim import TrimSteps
from app.assessment.wording import remarks, verdict, withdrawn
from app.telemetry.recording import Trace, Traces
from core.channels import KEYS, LATERAL
from core.limits.limits import Limits
from core.monitor import Assessments

NONE = Limited(None, (Peak("Ny", 0.1, -0.2, 0.2, 0.1),), 0.0)


def assessments(*p_values: float) -> Assessments:
    """Assessments at 8.0, 8.1, ... s; all other fields are 0."""
    n = len(p_values)
    given: dict[str, Any] = {field.name: np.zeros(n) for field in fields(Assessments)}
    given["t"], given["p_value"] = 8.0 + 0.1 * np.arange(n), np.array(p_values)
    return Assessments(**given)


def exceeded(t: float) -> Limited:
    return NONE._replace(exceedance=RecordedExceedance(t, "Ny", 0.2))


def of_remarks(limited: Limited) -> tuple[str, ...]:
    planned: Any = SimpleNamespace(
        limits_known=True, trim_segment_s=1.0, dt=0.1, dictionary=LATERAL
    )
    segment: Any = SimpleNamespace(is_rest=False, requested=None, rest=None, onset=None, first=0)
    return remarks(planned, segment, limited, assessments(0.1))


@pytest.mark.parametrize(
    ("limited", "end"),
    [
        (NONE, "0.1 at 8.20 s"),
        (exceeded(8.51), "0.1 at 8.20 s, 0.31 s before the exceedance"),
        (exceeded(8.2), "0.1 at 8.20 s, 0.00 s before the exceedance"),
        (exceeded(8.0), "0.1 at 8.20 s, 0.20 s after the exceedance"),
    ],
)
def test_a_withdrawn_alert_is_reported_with_its_lead(limited: Limited, end: str):
    words = withdrawn(assessments(np.nan, 0.1, 0.11, 0.9), 1, limited, 0.1, ())
    assert words == f"without the withdrawal the risk would have exceeded {end}"


def test_an_alert_before_the_withdrawal_remains():
    about = assessments(np.nan, 0.1, 0.11, 0.9), 3, exceeded(8.51), 0.1
    words = withdrawn(*about, ((8.2, 8.2),))
    assert words.startswith("the alert at 8.20 s remains, 0.31 s before the exceedance: ")
    assert words.endswith("withdrawn from 8.30 s on")
    assert "counts as no warning" in withdrawn(*about, ())


def test_a_withdrawn_manoeuvre_without_alert_reports_its_peak_risk():
    words = withdrawn(assessments(np.nan, 0.05, 0.031), 1, NONE, 0.1, ())
    assert words.endswith("stayed at or below 0.1, at most 0.050 at 8.10 s")
    assert "no sample was assessed" in withdrawn(assessments(np.nan, np.nan), 0, NONE, 0.1, ())


SKID = RecordedExceedance(8.5, "beta", float(np.radians(-7.0)))


def test_peaks_are_in_display_units():
    within, limit, beyond = np.radians([4.0, 5.0, 6.0]).tolist()
    limited = Limited(None, (Peak("beta", within, -limit, limit, beyond),), 0.0)
    inside, as_recorded = of_remarks(limited)
    assert inside.endswith(": |beta| 4 deg of 5 deg from trim")
    assert "is 6 deg, beyond the limit of 5 deg:" in as_recorded
    biased = limited._replace(peaks=(limited.peaks[0]._replace(bias=float(np.radians(2.0))),))
    _, as_recorded = of_remarks(biased)
    assert "trim and the bias of 2 deg that the mapping removes, is 6 deg" in as_recorded


def test_a_limited_channel_without_trim_may_have_exceeded_its_limit():
    traces = Traces({key: Trace(np.arange(3.0), np.full(3, 0.1)) for key in KEYS})
    limits = Limits(Ny=0.2).envelope
    limited = against_limits(
        traces, LATERAL, limits, TrimSteps.constant(np.full(len(KEYS), np.nan)), 0.0, 2.0
    )
    (line,) = of_remarks(limited)
    assert line.startswith("trim of Ny unknown, as recorded |Ny| 0.1 g of 0.2 g")


@pytest.mark.parametrize(
    ("largest", "recorded", "line"),
    [
        (0.19996, 0.201, "exceeded a limit from trim: |Ny| 0.19996 g of 0.2 g from trim"),
        (0.19996, 0.19996, "exceeded a limit: |Ny| 0.19996 g of 0.2 g from trim"),
        (5e-20, 5e-20, "exceeded a limit: |Ny| 0 g of 0.2 g from trim"),
    ],
)
def test_a_value_within_its_limit_does_not_read_as_the_limit(
    largest: float, recorded: float, line: str
) -> None:
    limited = NONE._replace(peaks=(Peak("Ny", largest, -0.2, 0.2, recorded),))
    assert of_remarks(limited)[0] == f"no recorded sample {line}"


def test_exceedances_and_trim_are_in_display_units():
    manoeuvre = ScoredManoeuvre(
        "doublet", 8.0, 9.0, 0, 9, (None, float(np.radians(1.5)), 0.0, 0.0213, 0.0, 0.0),
        Validity(True), "missed", "promised", peak_risk=0.2, peak_t=8.1, exceedance=SKID,
    )  # fmt: skip
    scored: Any = SimpleNamespace(
        manoeuvres=(manoeuvre,), outside_exceedances=(SKID,), epsilon=0.1, alert_above=0.0495
    )
    recipe = SimpleNamespace(guarantee="95%")
    monitor: Any = SimpleNamespace(n_unsafe=99, lead=0.25, recipe=recipe, dictionary=LATERAL)
    lines = verdict(monitor, scored)
    assert "  exceedance         at 8.50 s (beta -7 deg)" in lines
    assert any(line.startswith("  trim               p 1.5 deg/s, ") for line in lines)
    assert any("Ny 0.0213 g" in line for line in lines)
    above = "0.0495, the threshold for ε = 0.1 with 95 % confidence"
    assert f"  alerts above       {above}" in lines
    assert lines[-1] == "outside every manoeuvre: at 8.50 s (beta -7 deg)"
    of_day = verdict(monitor, scored, of_day=True)
    assert of_day[0].startswith("doublet, 8.00 to 9.00 s, 00:00:08.00 to 00:00:09.00: ")
    assert "  exceedance         at 8.50 s, 00:00:08.50 (beta -7 deg)" in of_day
    assert notes_on_outside((SKID,), LATERAL)[0].endswith("once beta -7 deg at 8.50 s.")


@pytest.mark.parametrize(
    ("lead", "words"), [(1.345, "1.34"), (1.3499, "1.34"), (1.3499999999, "1.35"), (0.3, "0.30")]
)
def test_a_lead_is_never_rounded_up(lead: float, words: str) -> None:
    """Except for rounding errors of floats."""
    assert lead_words(lead) == words


@pytest.mark.parametrize("outcome", ["quiet", "invalid", "unassessed"])
def test_an_exceedance_as_recorded_is_at_least_a_caution(outcome: str) -> None:
    raw = {"t": 3.0, "channel": "Ny", "value": 0.6, "doubt": "trim unknown"}
    about = {"exceedance": None, "recorded_exceedance": raw, "validity": {}}
    wording = wording_of({"outcome": outcome, **about})
    assert wording.level == "caution"
    assert wording.word.startswith("LIMIT EXCEEDED as recorded, trim unknown; ")
