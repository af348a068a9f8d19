"""Events beside the time shown, and the words of a headline, which page and server share."""

from typing import Any

import pytest

from core.monitor.assessment import Cause
from core.monitor.status import (
    LEVELS,
    WORDS,
    Facts,
    Headline,
    Level,
    Status,
    headline,
    in_words,
)
from tests.browser.strips import Open

SORTED = """async () => {
  const { createEventList } = await import("/static/js/lib/event_list.js");
  const host = document.createElement("section");
  const events = createEventList(host, { go: () => {} });
  const [now, later] = host.querySelectorAll("ol");
  const texts = (list) => [...list.querySelectorAll(".event-text")].map((one) => one.textContent);
  const seen = () => [texts(now), texts(later), later.parentElement.hidden];
  for (const t of [1, 5, 8]) events.add({ t, text: `at ${t}` });
  events.add({ t: null, text: "connected again" });
  const shown = [seen()];
  for (const t of [2, 5, 9]) {
    events.showUntil(t);
    if (t === 2) events.add({ t: 8, text: "at 8" }); // a second pass finds it again
    shown.push(seen());
  }
  return shown;
}"""
WORDED = """async ([headlines, cause]) => {
  const { textOf } = await import("/static/js/fly/headline.js");
  return headlines.map((one) => textOf(one, cause).replace(/^[▲◆✓] /, ""));
}"""


def test_what_lies_ahead_of_the_time_shown_is_set_apart_until_it_is_passed(strips: Open) -> None:
    page = strips()
    assert page.evaluate(SORTED) == [
        [["connected again", "at 8", "at 5", "at 1"], [], True],
        [["connected again", "at 1"], ["at 8", "at 5"], False],
        [["at 5", "connected again", "at 1"], ["at 8"], False],
        [["at 8", "at 5", "connected again", "at 1"], [], True],
    ]


def test_late_intervals_with_a_warning_are_named_before_others(strips: Open) -> None:
    words = strips().evaluate("""async () => {
      const { lossText } = await import("/static/js/fly/source/live_panel.js");
      const late = [1, 3, 5, 7, 9].map((start) => ({ start, end: start === 9 ? null : start + 1 }));
      return lossText({ batches: 1, counts: { accepted: 1 }, late }, [7.5, 12]).at(-1);
    }""")
    warned = "7.00 s to 8.00 s (with a warning), 9.00 s to the end (with a warning)"
    assert words == f"display stale, samples late: 1.00 s to 2.00 s, {warned} and 2 more times"


def test_events_stand_in_the_order_of_their_time_whenever_they_are_told(strips: Open) -> None:
    told = strips().evaluate("""async () => {
      const { createEventList } = await import("/static/js/lib/event_list.js");
      const { acknowledgementOf } = await import("/static/js/fly/panels.js");
      const host = document.createElement("section");
      const events = createEventList(host, { go: () => {} });
      const alarm = { t: 2, number: 1, level: "warning", by: "Op",
        raised: "2026-01-01T00:00:00Z", acknowledged: "2026-01-01T00:00:05Z" };
      for (const t of [2, 9, 4, 6]) events.add({ t, text: `at ${t}` });
      events.add(acknowledgementOf(alarm, true));
      return [...host.querySelectorAll(".event-text")].map((one) => one.textContent);
    }""")
    assert told == ["at 9", "alarm 1 (2.00 s) acknowledged by Op", "at 6", "at 4", "at 2"]


def test_words_of_moments_that_are_close_stand_one_below_the_other_the_most_urgent_first(
    strips: Open,
) -> None:
    rows = strips().evaluate("""async () => {
      const { stacked } = await import("/static/js/charts/strip_frame.js");
      const labels = [
        { text: "manoeuvre 1", colour: "text", left: 0, right: 80 },
        { text: "ABORT", colour: "alert", left: 60, right: 110 },
        { text: "KNOCK IT OFF", colour: "caution", left: 70, right: 160 },
        { text: "limits", colour: "caution", left: 200, right: 240 },
      ];
      const told = (placed) => placed.map(({ text, row }) => [text, row]);
      return [3, 1].map((rows) => told(stacked(labels, rows)));
    }""")
    apart, crowded = rows
    assert apart == [["ABORT", 0], ["KNOCK IT OFF", 1], ["limits", 0], ["manoeuvre 1", 2]]
    assert [row for _, row in crowded] == [0, 0, 0, 0]
    assert crowded[0] == ["ABORT", 0]  # drawn last, over the others


def plain(said: Headline) -> dict[str, Any]:
    return said._asdict() | {"beside": list(said.beside)}


RESULT = """async (flight) => {
  const { resultOf } = await import("/static/js/fly/headline.js");
  return resultOf(flight);
}"""


def test_a_list_names_the_data_that_were_missing_and_no_exceedance(strips: Open) -> None:
    verdict = {"exceeded_t": None, "lead": None, "text": "DATA MISSING: no sample", "warning": ""}
    flight = {"progress": "ended", "verdict": verdict, "cause": None}
    told = strips().evaluate(RESULT, plain(headline(Facts(caution=True))) | flight)
    parts = ["◆ CAUTION", "DATA MISSING: no sample"]
    assert told == {"words": " · ".join(parts), "parts": parts, "level": "caution"}


@pytest.mark.parametrize(
    ("cause", "text", "words"),
    [
        (None, "LIMIT EXCEEDED, warned", "▲ LIMIT EXCEEDED, warned · INVALID"),
        (None, "LIMIT EXCEEDED, INVALID", "▲ LIMIT EXCEEDED, INVALID"),
        (Cause.BETWEEN, "LIMIT EXCEEDED, warned", "▲ LIMIT EXCEEDED, warned"),
    ],
)
def test_a_withdrawn_monitor_is_named_beside_the_verdict_of_an_ended_flight(
    strips: Open, cause: Cause | None, text: str, words: str
) -> None:
    verdict = {"exceeded_t": 8.76, "lead": 1.4, "text": text, "warning": "Warned"}
    flight = {"progress": "ended", "verdict": verdict, "cause": cause}
    facts = Facts(alarm=True, invalid=True, exceeded_t=8.76)
    told = strips().evaluate(RESULT, plain(headline(facts)) | flight)
    assert told["words"] == words
    acknowledged = plain(headline(facts._replace(alarm=False))) | flight
    assert strips().evaluate(RESULT, acknowledged)["words"] == words.replace("▲", "◆")


def test_a_list_calls_a_flight_between_manoeuvres_as_its_page_does(strips: Open) -> None:
    invalid = plain(headline(Facts(invalid=True)))
    flight = invalid | {"progress": "ended", "verdict": None, "cause": Cause.BETWEEN}
    told = strips().evaluate(RESULT, flight)
    word = "◆ NOT ASSESSED"
    assert told == {"words": word, "parts": [word], "level": "caution"}


def test_page_and_scene_word_a_headline_alike(strips: Open) -> None:
    alone = [Headline(status, level) for status, level in LEVELS.items()]
    facts = Facts(alarm=True, stale=True, invalid=True, exceeded_t=8.76)
    several = [headline(facts), headline(Facts(exceeded_t=8.76)), headline(Facts(exceeds=True))]
    calm = headline(Facts(calibrated=False, exceeded_t=8.76))
    page = strips()
    for cause in (None, *Cause):
        said = [*alone, *several, calm]
        words = page.evaluate(WORDED, [[plain(one) for one in said], cause])
        assert words == [in_words(one, cause) for one in said]
    assert in_words(Headline(Status.INVALID, Level.CAUTION), Cause.BETWEEN) == "NOT ASSESSED"
    assert set(WORDS) == set(Status)
