"""Events beside the time shown, and the words of a headline, which page and server share."""

from typing import Any

from core.monitor.status import (
    BETWEEN,
    LEVELS,
    NOT_ASSESSED,
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
WORDED = """async ([headlines, reason]) => {
  const { textOf } = await import("/static/js/fly/headline.js");
  return headlines.map((one) => textOf(one, reason).replace(/^[▲◆✓] /, ""));
}"""


def test_what_lies_ahead_of_the_time_shown_is_set_apart_until_it_is_passed(strips: Open) -> None:
    page = strips()
    assert page.evaluate(SORTED) == [
        [["connected again", "at 8", "at 5", "at 1"], [], True],
        [["connected again", "at 1"], ["at 8", "at 5"], False],
        [["at 5", "connected again", "at 1"], ["at 8"], False],
        [["at 8", "at 5", "connected again", "at 1"], [], True],
    ]


def plain(said: Headline) -> dict[str, Any]:
    return said._asdict() | {"beside": list(said.beside)}


def test_a_list_calls_a_flight_between_manoeuvres_as_its_page_does(strips: Open) -> None:
    invalid = plain(headline(Facts(invalid=True)))
    flight = invalid | {"progress": "ended", "verdict": None, "reason": BETWEEN}
    told = strips().evaluate(
        """async (flight) => {
          const { resultOf } = await import("/static/js/fly/headline.js");
          return resultOf(flight);
        }""",
        flight,
    )
    assert told == {"words": "◆ NOT ASSESSED", "level": "caution"}


def test_page_and_scene_word_a_headline_alike(strips: Open) -> None:
    alone = [Headline(status, level) for status, level in LEVELS.items()]
    facts = Facts(alarm=True, stale=True, invalid=True, exceeded_t=8.76)
    several = [headline(facts), headline(Facts(exceeded_t=8.76)), headline(Facts(exceeds=True))]
    calm = headline(Facts(calibrated=False, exceeded_t=8.76))
    page = strips()
    for reason in ("", BETWEEN):
        said = [*alone, *several, calm]
        words = page.evaluate(WORDED, [[plain(one) for one in said], reason])
        assert words == [in_words(one, reason) for one in said]
    assert in_words(Headline(Status.INVALID, Level.CAUTION), BETWEEN) == NOT_ASSESSED
    assert set(WORDS) == set(Status)
