/**
 * A channel at a glance: least and greatest values over the whole recording, in a few hundred pixels.
 *
 * createMiniPlot(name, channel) -> {element, show(tiles | null)}     channel: of the catalog
 *     tiles: {t, low, high, min, max}; null in low and high where nothing was recorded
 */

import { h, svg } from "../lib/dom.js";
import { followUnits, magnitude, shownIn } from "../lib/numbers.js";

const [WIDTH, HEIGHT, PAD] = [240, 44, 4];

export function createMiniPlot(name, channel) {
  const zero = svg("path.mini-zero");
  const line = svg("path.mini-line");
  const box = { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", "aria-hidden": true };
  const drawing = svg("svg.mini-svg", box, zero, line);
  const words = h("figcaption.mini-words");
  const element = h("figure.mini-plot", drawing, words);

  let tiles = null;
  followUnits(words, tell);

  function show(given) {
    tiles = given;
    const known = tiles !== null && Number.isFinite(tiles.min);
    element.toggleAttribute("data-empty", !known);
    drawing.toggleAttribute("hidden", !known);
    tell();
    if (!known) return;
    const { min, max } = tiles;
    const room = max - min || 1;
    const y = (value) => HEIGHT - PAD - ((value - min) / room) * (HEIGHT - 2 * PAD);
    line.setAttribute("d", lineOf(tiles, y));
    zero.setAttribute("d", min <= 0 && max >= 0 ? `M0 ${y(0)}H${WIDTH}` : "");
  }

  function tell() {
    if (tiles === null || !Number.isFinite(tiles.min)) {
      words.textContent = tiles === null ? "" : "no values";
      return;
    }
    words.textContent = `${magnitude(channel, tiles.min, 3)} to ${magnitude(channel, tiles.max, 3)} ${shownIn(channel).unit}`;
    element.setAttribute("aria-label", `${name}, ${words.textContent}`);
  }

  return { element, show };
}

/** A line through the greatest and the least value of each bin, broken where nothing was recorded. */
function lineOf({ t, low, high }, y) {
  const length = t.at(-1) - t[0] || 1;
  const place = (k, value) => `${Math.round((10 * (t[k] - t[0]) * WIDTH) / length) / 10} ${Math.round(10 * y(value)) / 10}`;
  const isKnown = (k) => (low[k] ?? null) !== null;
  const step = (k) => `${isKnown(k - 1) ? "L" : "M"}${place(k, high[k])}L${place(k, low[k])}`;
  return t.map((_, k) => (isKnown(k) ? step(k) : "")).join("");
}
