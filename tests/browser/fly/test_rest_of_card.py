"""The rest of the test card in words: the forecast, or why there is none."""

from typing import Any

import pytest

from tests.browser.strips import Open

SAID = """async ({ noRest, frames, stale, headline }) => {
  const { createRestOfCard } = await import("/static/js/fly/assessment/rest_of_card.js");
  const { aheadOf, isCurrent } = await import("/static/js/charts/live/flight_chart.js");
  const element = document.createElement("section");
  const rest = createRestOfCard(element, noRest);
  const channels = [{ key: "Ny", symbol: "N_y", unit: "g", label: "", limit: 0.5 }];
  let known = null;
  for (const frame of frames) known = aheadOf(known, [frame], frame);
  const newest = frames.at(-1);
  const shown = newest && isCurrent(known, newest.t) ? known : null;
  rest.draw(stale ?? false, shown, newest?.t ?? 0, newest?.state ?? null, channels, headline);
  return [element.hidden, element.dataset.level, element.querySelector("p").textContent];
}"""
PEAK = {"t": [], "channels": {}, "peak": {"mean": 0.8, "low": 0.6, "high": 1.1}}
OVER = {"t": [], "channels": {}, "why": "nothing is left of the test card"}
BAND = {"t": [1, 2], "channels": {"Ny": {"low": [0, 0], "high": [1, 1], "predicted": 1.9}}}
BAND["channels"]["Ny"]["possible"] = 1.2  # pyright: ignore


def frame(t: float, ahead: Any = None, state: str = "ok") -> dict[str, Any]:
    return {"t": t, "state": state} | ({"ahead": ahead} if ahead else {})


@pytest.mark.parametrize(
    ("about", "level", "words"),
    [
        ({"frames": []}, "unknown", "not known"),
        (
            {"frames": [frame(1, state="warming_up")]},
            "unknown",
            "not known: too few samples yet",
        ),
        ({"frames": [frame(1, PEAK)]}, "possible", "◇ may exceed, peak ahead"),
        ({"frames": [frame(1, PEAK), frame(1.25)]}, "possible", "◇ may exceed, peak ahead"),
        ({"frames": [frame(1, PEAK), frame(1.3)]}, "unknown", "not known"),
        ({"frames": [frame(1, PEAK), frame(0.9)]}, "unknown", "not known"),
        (
            {"frames": [frame(1, PEAK), frame(1.05, state="invalid")]},
            "unknown",
            "not known: the monitor is not applicable",
        ),
        ({"frames": [frame(1, PEAK), frame(1.1, OVER)]}, "unknown", OVER["why"]),
        (
            {"frames": [frame(1, PEAK)], "stale": True},
            "unknown",
            "not known: the display is stale",
        ),
        ({"frames": [frame(1, BAND)]}, "predicted", "▲ Ny predicted to exceed 0.5 g in 0.9 s"),
        (
            {"frames": [frame(1, BAND)], "headline": {"status": "exceeding", "exceeded_t": 1.0}},
            "unknown",
            "a limit is exceeded now",
        ),
        (
            {"frames": [frame(1, BAND)], "headline": {"status": "ok", "exceeded_t": 0.5}},
            "predicted",
            "▲ Ny predicted to exceed 0.5 g again in",
        ),
    ],
)
def test_the_rest_of_the_card_is_forecast_or_the_reason_given(
    strips: Open, about: dict[str, Any], level: str, words: str
) -> None:
    hidden, shown, said = strips().evaluate(SAID, {"noRest": "", **about})
    assert (hidden, shown) == (False, level)
    assert said.startswith(words)


def test_a_method_without_a_forecast_shows_no_rest_of_the_card(strips: Open) -> None:
    hidden, _, _ = strips().evaluate(SAID, {"noRest": "gives none", "frames": [frame(1, PEAK)]})
    assert hidden


DRAWN_AGAIN = """async (band) => {
  const { createRestOfCard } = await import("/static/js/fly/assessment/rest_of_card.js");
  const element = document.createElement("section");
  const rest = createRestOfCard(element, "");
  let reads = 0;
  const ahead = { made: 1, t: band.t, get channels() { reads += 1; return band.channels; } };
  const channels = (limit) => [{ key: "Ny", symbol: "N_y", unit: "g", label: "", limit }];
  const said = [];
  for (const [times, shown] of [[3, channels(0.5)], [2, channels(0.6)]]) {
    for (let n = 0; n < times; n++) rest.draw(false, ahead, 1 + n / 10, "ok", shown);
    said.push([reads, element.querySelector("p").textContent]);
  }
  return said;
}"""


def test_the_exceedance_of_a_forecast_is_looked_for_once_for_each_limit(strips: Open) -> None:
    words = "▲ Ny predicted to exceed {} g in {} s"
    assert strips().evaluate(DRAWN_AGAIN, BAND) == [
        [1, words.format(0.5, 0.7)],
        [2, words.format(0.6, 0.8)],
    ]


PLACED = """async () => {
  const { drawEnvelope } = await import("/static/js/charts/trace.js");
  const pen = document.createElement("canvas").getContext("2d");
  const placed = [];
  const word = (text, x) => placed.push([x - 120, x + 120]);
  const tools = { line: () => {}, wide: () => 240, free: (wanted) => wanted, word };
  const face = { pen, y: () => 0, height: 60, palette: {}, ...tools };
  const band = { t: [0, 1], low: [0, 0], high: [1, 1], word: "ahead" };
  for (let end = 150; end <= 600; end += 50) {
    drawEnvelope(face, band, { x: (t) => 100 + t * (end - 100), now: 0, width: 500 });
  }
  return placed;
}"""


def test_the_words_of_the_forecast_stand_within_it(strips: Open) -> None:
    """Or not at all, where it is too short; up to the strip's edge, beyond which none is seen."""
    placed = strips().evaluate(PLACED)
    assert len(placed) == 6
    assert all(left >= 100 and right <= 500 for left, right in placed)
