"""The report: one self-contained file with every outcome and no false praise."""

import re
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree

import pytest

from app.assessment.outcome import OUTCOMES
from app.report.facts import MOST_NOTES, alerts, drawn, headline, notes, outcome_of
from app.report.page import report
from app.report.subject import ReportSubject
from core.channels import LONGITUDINAL
from core.dataset import Dataset
from core.limits.limits import IntervalLimits, SafeInterval
from core.monitor import Monitor, MonitorRecipe, train
from tests.support.reported import exceedance, manoeuvre, subject_of

WARNED = manoeuvre(0, "timely_alert", exceedance=exceedance(0), lead=0.5, alerts=[[1.5, 1.6]])
MISSED = manoeuvre(1, "missed", exceedance=exceedance(1))
QUIET, INVALID = manoeuvre(2, "quiet"), manoeuvre(3, "invalid")


@pytest.fixture(scope="module")
def monitor(dataset: Dataset) -> Monitor:
    return train(dataset, MonitorRecipe())


@pytest.fixture
def subject(monitor: Monitor) -> ReportSubject:
    return subject_of(monitor, [WARNED, MISSED, QUIET, INVALID])


def sections_of(html: str) -> list[str]:
    """The section of each manoeuvre."""
    return [part.split("</section>")[0] for part in html.split("<section>")[1:]]


def test_it_needs_no_other_file_and_runs_no_script(subject: ReportSubject) -> None:
    html = report(subject)
    assert re.findall(r"(?:src|href)\s*=", html) == []
    assert re.findall(r"url\((?!#hatch\))|@import", html) == []
    assert "<script" not in html
    assert 'id="hatch"' in html


RAW = QUIET | {"recorded_exceedance": exceedance(2)}


@pytest.mark.parametrize(
    ("given", "level", "words"),
    [
        (WARNED, "caution", "LIMIT EXCEEDED, warned 0.50 s before the limit"),
        (MISSED, "bad", "LIMIT EXCEEDED, missed: no alert before the limit"),
        (
            INVALID | {"exceedance": exceedance(3)},
            "bad",
            "LIMIT EXCEEDED, INVALID, no verdict",
        ),
        (QUIET, "good", "no alert, no limit exceeded"),
        (
            RAW,
            "caution",
            "LIMIT EXCEEDED as recorded, not from trim; no alert, no limit exceeded",
        ),
    ],
)
def test_an_exceedance_has_the_same_words_as_elsewhere(
    given: dict[str, Any], level: str, words: str
) -> None:
    assert outcome_of(given)[1:] == (words, level)


def test_an_exceedance_only_as_recorded_is_a_caution() -> None:
    level, words = headline([RAW])
    assert level == "caution"
    assert words.startswith("No limit was exceeded from trim")
    assert words.endswith("a limit was exceeded as recorded, not from trim")


def test_its_figures_are_complete(subject: ReportSubject) -> None:
    pictures = re.findall(r'<svg class="chart".*?</svg>', report(subject), re.DOTALL)
    assert len(pictures) == 1 + 4 + 1
    for picture in pictures:
        ElementTree.fromstring(picture)
        assert "nan" not in picture


def test_values_are_in_degrees(monitor: Monitor) -> None:
    moved = manoeuvre(0, "missed", exceedance={"t": 2.1, "channel": "beta", "value": -0.08727})
    html = report(subject_of(monitor, [moved | {"trim": [0.0, 0.1, 0.0, 0.0, 0.0, None]}]))
    plain = html.replace("\N{NO-BREAK SPACE}", " ")
    assert "−5 deg" in plain
    assert "5.73 deg/s" in plain
    assert " rad" not in plain


def test_names_and_notes_are_escaped(monitor: Monitor) -> None:
    html = report(subject_of(monitor, [manoeuvre(0, "quiet", name="<u>doublet</u>")]))
    assert "&lt;b&gt;flight&lt;/b&gt; &amp; more.csv" in html
    assert "gust &lt;here&gt;" in html
    assert "&lt;i&gt;comment&lt;/i&gt;" in html
    assert "&lt;u&gt;doublet" in html
    assert not re.search("<[bui]>", html)


def test_every_outcome_and_hash_is_listed(subject: ReportSubject) -> None:
    html = report(subject)
    for outcome in ("timely_alert", "missed", "quiet", "invalid"):
        assert OUTCOMES[outcome].text in html
    assert "A limit was exceeded without a timely alert" in html
    assert "Look first at manoeuvre 2 (" in html
    assert "It holds for 3 of the 4 manoeuvres" in html
    for digest in ("ab" * 32, "cd" * 32, "ef" * 32, subject.monitor.dataset_digest):
        assert digest in html


def test_each_manoeuvre_lists_its_guarantee_remarks_and_checks(subject: ReportSubject) -> None:
    sections = sections_of(report(subject))
    assert len(sections) == 4
    manoeuvres = subject.scoring["manoeuvres"]
    for number, (section, scored) in enumerate(zip(sections, manoeuvres, strict=True)):
        assert scored["guarantee"] in section
        assert f"it begins late, {number}" in section
        for check in scored["validity"]["checks"]:
            assert check["text"] in section
        assert "◇ unknown" in section
        assert ("✕ no" in section) == (scored["outcome"] == "invalid")


def test_channels_are_listed_with_source_and_confidence(subject: ReportSubject) -> None:
    html = report(subject)
    assert "61 %" in html
    assert "its sign is turned" in html
    assert "reversed" in html
    assert "derived: lateral acceleration minus gravity" in html
    assert "not in the file" in html
    assert "line 7: 12 cells" in html
    assert "proposed by the program, not confirmed" in html
    assert html.count("beta: 3 gaps.") == 1
    assert "Confidence" not in report(replace(subject, rationales={}))


def test_sensor_comparisons_are_listed_with_their_intervals(subject: ReportSubject) -> None:
    html = report(subject).replace("\N{NO-BREAK SPACE}", " ")
    assert "<td>0.8 (0.78 to 0.82)</td>" in html
    assert "0.573 (−0.573 to 1.72) deg/s" in html
    assert "◇ roll rate reads 0.80 times." in html
    assert "They change no verdict; remarked on beyond 0.1." in html
    assert "not checked: without heading" in html
    assert "sensors disagree by kinematics" in html
    quality = {**subject.scoring["quality"]}
    del quality["compatibility"]
    before = report(replace(subject, scoring={**subject.scoring, "quality": quality}))
    assert "kinematics" not in before


def test_unchecked_data_are_not_called_faultless(subject: ReportSubject) -> None:
    html = report(replace(subject, scoring={**subject.scoring, "quality": None}))
    assert "Not checked" in html
    assert "No gaps" not in html


def test_a_report_of_invalid_manoeuvres_gives_no_guarantee(monitor: Monitor) -> None:
    html = report(subject_of(monitor, [manoeuvre(0, "invalid"), manoeuvre(1, "invalid")]))
    assert "The guarantee is withdrawn for this recording" in html
    assert "P(no timely alert" not in html
    assert "No limit was exceeded" not in html


def test_an_unchecked_manoeuvre_has_no_guarantee(monitor: Monitor) -> None:
    unknown = manoeuvre(0, "quiet")
    unknown["validity"] = unknown["validity"] | {"valid": None, "p_value": None}
    html = report(subject_of(monitor, [unknown]))
    assert "No guarantee for this recording" in html
    assert "◇ Not checked" in html
    assert "◆ The monitor was not tested on fresh flights: " in html
    assert "P(no timely alert" not in html


@pytest.mark.parametrize(
    ("manoeuvres", "level", "words"),
    [
        (
            [WARNED, QUIET],
            "caution",
            "A limit was exceeded; every exceedance had a timely alert",
        ),
        ([QUIET], "good", "No limit was exceeded, and there was no alert"),
        ([WARNED, INVALID], "caution", "had a timely alert"),
        ([WARNED, manoeuvre(3, "invalid", exceedance=exceedance(3))], "bad", "is not applicable"),
        ([INVALID], "invalid", "No verdict"),
        ([manoeuvre(0, "false_alert")], "caution", "but there was an alert"),
        ([WARNED, MISSED, INVALID], "bad", "without a timely alert"),
    ],
)
def test_the_headline_is_the_worst_event(manoeuvres, level: str, words: str) -> None:
    actual = headline(manoeuvres)
    assert actual[0] == level
    assert words in actual[1]


def test_the_headline_covers_valid_manoeuvres_and_counts_the_others() -> None:
    warned = WARNED | {"validity": WARNED["validity"] | {"valid": False}}
    level, words = headline([QUIET, warned])
    assert level == "caution"
    assert words == (
        "A limit was exceeded, warned in time, without a guarantee; "
        "1 of the 2 manoeuvres is not valid, no guarantee for it"
    )
    late = warned | {"outcome": "late_alert"}
    assert headline([late])[0] == "bad"
    assert "warned too late, without a guarantee" in headline([late])[1]
    since = {"withdrawn_t": 4.3, "withdrawn_reason": "p is outside training"}
    _, words = headline([late | since])
    assert words.endswith("before the monitor was withdrawn at 4.30 s (p is outside training)")
    level, words = headline([QUIET, INVALID, INVALID])
    assert level == "caution"
    assert words.startswith(
        "No limit was exceeded, and there was no alert; 2 of the 3 manoeuvres are"
    )


def test_an_alert_before_the_withdrawal_is_in_the_table(monitor: Monitor) -> None:
    warned = WARNED | {"validity": WARNED["validity"] | {"valid": False}}
    html = report(subject_of(monitor, [warned]))
    assert ">INVALID</td>" not in html
    assert html.count(f'<td class="number">{warned["lead"]:.2f}</td>') == 2


def test_seconds_of_the_day_come_with_the_time_of_day(monitor: Monitor) -> None:
    subject = subject_of(monitor, [WARNED])
    assert "time of day" not in report(subject)
    typed = subject.scoring["mapping"] | {
        "times": {"": {"signal": "", "unit": "s", "rate": 25.0, "start": 45065.0}}
    }
    html = report(replace(subject, scoring={**subject.scoring, "mapping": typed}))
    assert f"{WARNED['exceedance']['t']:.2f}, 00:00:0{WARNED['exceedance']['t']:.2f}, " in html
    assert "1.50<br>00:00:01.50</td>" in html


def test_look_ahead_of_resampling_is_reported_with_the_lead(monitor: Monitor) -> None:
    html = report(subject_of(monitor, [WARNED | {"look_ahead": 0.5}]))
    assert "waits up to 0.5 s for later ones" in html
    assert "Resampling" not in report(subject_of(monitor, [WARNED]))


def test_an_alert_after_the_limit_has_no_lead() -> None:
    crossed = manoeuvre(0, "late_alert", exceedance=exceedance(0), alerts=[[1.9, 2.0], [3.0, 4.0]])
    rows = alerts([crossed])
    assert [row["lead"] for row in rows] == [pytest.approx(0.1), None]
    assert [row["first"] for row in rows] == [True, False]


def test_only_the_most_important_of_many_manoeuvres_are_drawn(
    subject: ReportSubject, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.report.facts.MOST_DRAWN", 2)
    assert drawn([QUIET, INVALID, WARNED, MISSED]) == {2, 3}
    sections = sections_of(report(subject))
    assert ["<figure>" in section for section in sections] == [True, True, False, False]
    assert ["No figure" in section for section in sections] == [False, False, True, True]


def test_thirty_manoeuvres_make_less_than_a_megabyte(monitor: Monitor) -> None:
    outcomes = ["quiet", "timely_alert", "invalid"] * 10
    html = report(subject_of(monitor, [manoeuvre(k, name) for k, name in enumerate(outcomes)]))
    assert len(html.encode()) < 1_000_000
    assert html.count("<section>") == 30
    assert html.count('<td class="name">manoeuvre ') == 30


def test_notes_are_distinct_and_limited() -> None:
    assert notes(["a", "b"], ["a", "c"], apart_from=["b"]) == (["a", "c"], 0)
    first, more = notes([str(k) for k in range(100)])
    assert (len(first), more) == (MOST_NOTES, 100 - MOST_NOTES)


OUTSIDE = {"t": 20.3, "channel": "Ny", "value": 0.48}


@pytest.mark.parametrize(
    ("manoeuvres", "outside", "level", "words"),
    [
        ([manoeuvre(0, "unseen")], [], "caution", "may have been exceeded"),
        ([manoeuvre(0, "unseen", exceedance=exceedance(0))], [], "bad", "samples are missing"),
        ([WARNED, manoeuvre(2, "unseen")], [], "caution", "may have been exceeded"),
        ([QUIET], [OUTSIDE], "caution", "in a manoeuvre, .* a limit was exceeded outside every"),
        ([WARNED], [OUTSIDE], "caution", "also exceeded outside every manoeuvre"),
        ([MISSED], [OUTSIDE], "bad", "without a timely alert; one was also exceeded outside"),
    ],
)
def test_unseen_and_unjudged_flights_are_never_good(manoeuvres, outside, level, words) -> None:
    actual = headline(manoeuvres, outside)
    assert actual[0] == level
    assert re.search(words, actual[1])


def test_limits_exceeded_outside_the_manoeuvres_have_rows(monitor: Monitor) -> None:
    subject = subject_of(monitor, [manoeuvre(0, "quiet")])
    html = report(
        replace(subject, scoring={**subject.scoring, "outside_exceedances": [OUTSIDE] * 30})
    )
    assert html.count('<strong class="caution">outside every manoeuvre</strong>') == 20
    assert "and 10 more times outside every manoeuvre" in html


def test_withdrawn_and_unconfirmed_results_are_marked(subject: ReportSubject) -> None:
    html = report(subject)
    assert html.count(">INVALID</td>") == 2
    assert "Mapping not confirmed" in html
    assert "Mapping not confirmed" not in report(replace(subject, mapped="confirmed by the user"))
    assert "has no test on fresh flights" in html


def test_a_report_has_the_channels_and_limits_of_its_monitor(monitor: Monitor) -> None:
    limits = {"Nz": SafeInterval(-1.4, 4.9, 1.0), "alpha": SafeInterval(None, 0.2)}
    pitching = replace(
        monitor, dictionary=LONGITUDINAL, specification=IntervalLimits(LONGITUDINAL, limits)
    )
    pushed = exceedance(1, value=-1.6) | {"channel": "Nz"}
    subject = subject_of(pitching, [QUIET, MISSED | {"exceedance": pushed}])
    quality = {"sentences": [], "clocks": [], "faults": []}
    html = report(replace(subject, scoring={**subject.scoring, "quality": quality}))
    for words in (
        "−1.4\N{NO-BREAK SPACE}g to 4.9\N{NO-BREAK SPACE}g",
        "at most 11.5\N{NO-BREAK SPACE}deg",
        "−1.6\N{NO-BREAK SPACE}g",
        "true airspeed",
        "elevator",
    ):
        assert words in html
    assert "either sign" not in html
