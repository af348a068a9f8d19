"""The report: one file that stands alone, says every outcome plainly, and never flatters."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from app.report.figures import envelope
from app.report.page import OUTCOMES, ReportSubject, alerts, certificate, report
from core.dataset import Dataset
from core.monitor import MonitorRecipe, train
from tests.oscillator import DT
from tests.samples import SAMPLE_LIKE

N = 400


def stretch(number: int, outcome: str, **more: Any) -> dict[str, Any]:
    """A plain scored stretch of 100 samples."""
    first = 100 * number
    return {
        "name": f"Manoeuvre {number + 1}",
        "start": first * DT,
        "end": (first + 99) * DT,
        "first": first,
        "last": first + 99,
        "trim": [0.0] * 6,
        "peak_risk": 0.31,
        "peak_t": (first + 40) * DT,
        "alerts": [],
        "crossing": None,
        "lead": None,
        "outcome": outcome,
        "validity": {
            "valid": outcome != "invalid",
            "p_value": 0.4,
            "residual_p": 0.4,
            "distance_p": 0.6,
            "reasons": ["N_y was off its forecast by 9 sigma"] if outcome == "invalid" else [],
            "checks": [{"name": "rate", "ok": True, "text": "20 Hz, as the monitor needs"}],
        },
    } | more


@pytest.fixture
def subject(dataset: Dataset) -> ReportSubject:
    monitor = train(dataset, MonitorRecipe())
    samples = np.zeros(N, SAMPLE_LIKE)
    samples["t"] = DT * np.arange(N)
    samples["y"] = 0.1 * np.sin(samples["t"])[:, None]
    samples["p_value"], samples["withdrawn"] = 0.2, np.nan
    samples["p_value"][300:], samples["withdrawn"][300:], samples["state"][300:] = np.nan, 0.7, 3
    crossing = {"t": 2.0, "channel": "Ny", "value": -0.53}
    warned = stretch(0, "timely_alert", crossing=crossing, lead=0.5, alerts=[[1.5, 1.6]])
    missed = stretch(1, "missed", crossing={"t": 7.0, "channel": "Ny", "value": 0.6})
    return ReportSubject(
        recording={
            "name": "<b>flight</b> & more.csv", "digest": "ab" * 32, "size": 1_234_567,
            "format": "csv", "aircraft": "PH-LAB", "start": "", "n_bad_rows": 2,
            "bad_rows": [{"line": 7, "reason": "12 cells where the header has 11", "text": "x"}],
            "notes": ["the comma is the decimal mark"],
        },
        scoring={
            "created": "2030-01-01", "epsilon": 0.1, "dt": DT, "n_samples": N, "start": 0.0,
            "end": 20.0, "notes": ["resampled"], "quality": None, "digest": "cd" * 32,
            "stretches": [warned, missed, stretch(2, "quiet"), stretch(3, "invalid")],
            "mapping": {
                "times": {}, "channels": {
                    "beta": {"signal": "AOSS", "unit": "deg", "sign": -1, "offset": 0.0,
                             "derivation": ""},
                    "Ny": {"signal": "", "unit": "", "sign": 1, "offset": 0.02,
                           "derivation": "without_gravity"},
                },
            },
        },
        monitor=monitor,
        monitor_name="oscillator",
        monitor_digest="ef" * 32,
        evaluation=None,
        samples=samples,
        markers=[{"t": 3.0, "end": None, "kind": "note", "text": "gust <here>"}],
    )  # fmt: skip


def test_it_needs_no_other_file_and_runs_nothing(subject: ReportSubject) -> None:
    html = report(subject)
    assert re.findall(r'(?:src|href)="(?!data:image/svg\+xml;base64,)', html) == []
    assert "<script" not in html
    assert "url(" not in html.split("</style>")[0]


def test_words_of_the_file_and_the_crew_are_text(subject: ReportSubject) -> None:
    html = report(subject)
    assert "&lt;b&gt;flight&lt;/b&gt; &amp; more.csv" in html
    assert "gust &lt;here&gt;" in html


def test_every_outcome_and_hash_is_said(subject: ReportSubject) -> None:
    html = report(subject)
    for outcome in ("timely_alert", "missed", "quiet", "invalid"):
        assert OUTCOMES[outcome][1] in html
    assert "A limit was reached without an alert in time" in html
    assert "It is withdrawn for the 1 manoeuvre marked" in html
    assert "N_y was off its forecast by 9 sigma" in html
    for digest in ("ab" * 32, "cd" * 32, "ef" * 32, subject.monitor.dataset_digest):
        assert digest in html
    assert "line 7: 12 cells" in html
    assert "derived: without_gravity" in html
    assert "<strong>missing</strong>" in html


def test_a_report_of_invalid_manoeuvres_alone_promises_nothing(subject: ReportSubject) -> None:
    alone = {**subject.scoring, "stretches": [stretch(3, "invalid")]}
    html = report(replace(subject, scoring=alone))
    assert "The guarantee is withdrawn for this recording" in html
    assert "P(no timely alert" not in html
    assert "No limit was reached" not in html


def test_an_alert_after_the_limit_has_no_lead() -> None:
    crossed = stretch(
        0, "late_alert", crossing={"t": 2.0, "channel": "Ny", "value": 1}, alerts=[[1.9, 2], [3, 4]]
    )
    assert [row["lead"] for row in alerts([crossed])] == [pytest.approx(0.1), None]


def test_the_certificate_is_of_the_nearest_epsilon_that_was_tested() -> None:
    evaluation = {
        "epsilon": 0.1, "n_unsafe": 100, "n_safe": 200,
        "at_epsilon": {"misses": 9, "false_alerts": 20},
        "curves": {"epsilon": [0.05, 0.2], "misses": [4, 19], "false_alerts": [50, 10]},
    }  # fmt: skip
    found = certificate(evaluation, 0.06)
    assert found is not None
    assert (found["epsilon"], found["miss"]["count"]) == (0.05, 4)
    assert found["fail_given_alert"]["total"] == 96 + 50
    at = certificate(evaluation, 0.1)
    assert at is not None
    assert at["miss"]["low"] < 0.09 < at["miss"]["high"]
    assert at["power"]["share"] == 0.9
    assert certificate(None, 0.1) is None


def test_the_envelope_keeps_every_peak() -> None:
    rng = np.random.default_rng(1)
    t, values = np.arange(100_000.0), rng.standard_normal(100_000)
    values[123:130] = np.nan
    thin_t, thin = envelope(t, values, 500)
    assert len(thin) < 1500
    assert (np.diff(thin_t) >= 0).all()
    assert np.nanmax(thin) == np.nanmax(values)
    assert np.nanmin(thin) == np.nanmin(values)
