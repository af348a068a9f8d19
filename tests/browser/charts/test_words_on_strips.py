"""Where words are written on a strip: on no limit line, and what holds for all strips only once."""

import pytest

from tests.browser.strips import Open, run

DRAW = """
  const words = [];
  const lines = {};
  const pens = CanvasRenderingContext2D.prototype;
  const { fillText, fillRect } = pens;
  const keyOf = (pen) => pen.canvas.closest?.('.strip')?.dataset.key;
  const heightOf = (pen, y) => pen.getTransform().transformPoint({ x: 0, y }).y;
  pens.fillText = function (text, x, y) {
    const key = keyOf(this);
    if (key && this.textAlign !== 'right') words.push({ key, text, y: heightOf(this, y) });
    return fillText.call(this, text, x, y);
  };
  pens.fillRect = function (x, y, wide, high) {
    if (keyOf(this) && high === 1.5) (lines[keyOf(this)] ??= []).push(heightOf(this, y + 0.75));
    return fillRect.call(this, x, y, wide, high);
  };
  h.feed(0, 2, 2000, { state: 'warming_up' });
  h.feed(2, 9, 9000, { growth: 0.6 });
  h.feed(10, 13.5, 13500, { growth: 0.6 });
  const ends = (size) => ({ low: Array(20).fill(-size), high: Array(20).fill(size) });
  const band = (size) => ({ ...ends(size), predicted: null, possible: null });
  const t = Array.from({ length: 20 }, (_, k) => 13.5 + 0.2 * k);
  const ahead = { peak: null, why: '', t, channels: { Ny: band(0.2), beta: band(0.01) } };
  h.chart.push([{ ...h.frame(13.54), ahead }], 13540);
  words.length = 0;
  for (const key of Object.keys(lines)) delete lines[key];
  h.draw(13560);
  return { words, lines };
"""


@pytest.mark.parametrize("height", [480, 560, 660, 760, 900])
def test_no_word_lies_on_a_limit_line(strips: Open, height: int) -> None:
    page = strips("seconds=12&lead=1.5")
    page.set_viewport_size({"width": 1440, "height": height})
    drawn = run(page, DRAW)
    assert drawn["words"]
    for word in drawn["words"]:
        for line in drawn["lines"].get(word["key"], []):
            assert abs(word["y"] - line) > 8, (word, line)


def test_the_words_of_the_forecast_stand_once_where_they_fit(strips: Open) -> None:
    page = strips("seconds=12&lead=1.5")
    page.set_viewport_size({"width": 1920, "height": 900})
    told = [word["text"] for word in run(page, DRAW)["words"]]
    assert told.count("90 % forecast to the end of the card") == 1
    assert "+1.50 s" in told
    assert told.count("GAP") == 7


def test_no_word_of_the_risk_strip_lies_on_another(strips: Open) -> None:
    page = strips("seconds=12")
    page.set_viewport_size({"width": 1440, "height": 760})
    drawn = run(
        page,
        DRAW.replace(
            "words.length = 0;",
            """
            for (const [t, word] of [[0.8, 'MANOEUVRE'], [1.2, 'ABORT'], [3, 'NOTE']])
              h.chart.flag({ key: null, t, word, colour: 'caution' });
            h.timeline.setWindow(0, 12);
            words.length = 0;
            """,
        ).replace("y: heightOf", "x, wide: this.measureText(text).width, y: heightOf"),
    )
    words = [word for word in drawn["words"] if word["key"] == "risk"]
    assert {"MANOEUVRE", "ABORT", "WARMING UP"} <= {word["text"] for word in words}
    for k, word in enumerate(words):
        for other in words[:k]:
            apart = abs(word["x"] - other["x"]) >= (word["wide"] + other["wide"]) / 2
            assert apart or abs(word["y"] - other["y"]) >= 14, (word, other)
