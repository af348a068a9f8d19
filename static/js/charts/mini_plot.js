/**
 * A channel at a glance: least and greatest values over the whole recording, in a few hundred pixels.
 *
 * createMiniPlot(name, channel null) -> {element, show(tiles | null)}     channel: of the catalog; null: in the unit of the tiles
 *     tiles: {t, low, high, unit, min, max}; null in low and high where nothing was recorded
 */

import { h, svg } from "../lib/dom.js";
import { followUnits, magnitude, shownIn } from "../lib/numbers.js";

const [WIDTH, HEIGHT, PAD] = [240, 44, 4];

export function createMiniPlot(name, channel = null) {
  const zero = svg("path.mini-zero");
  const area = svg("path.mini-area");
  const box = { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", "aria-hidden": true };
  const drawing = svg("svg.mini-svg", box, zero, area);
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
    area.setAttribute("d", areaOf(tiles, y));
    zero.setAttribute("d", min <= 0 && max >= 0 ? `M0 ${y(0)}H${WIDTH}` : "");
  }

  function tell() {
    if (tiles === null || !Number.isFinite(tiles.min)) {
      words.textContent = tiles === null ? "" : "no values";
      return;
    }
    const shown = channel ?? { unit: tiles.unit };
    words.textContent = `${magnitude(shown, tiles.min, 3)} to ${magnitude(shown, tiles.max, 3)} ${shownIn(shown).unit}`;
    element.setAttribute("aria-label", `${name}, ${words.textContent}`);
  }

  return { element, show };
}

/** One closed path for each unbroken segment; at least a line thick. */
function areaOf({ t, low, high }, y) {
  const length = t.at(-1) - t[0] || 1;
  const x = (k) => ((t[k] - t[0]) / length) * WIDTH;
  const round = (value) => Math.round(10 * value) / 10;
  const pieces = [];
  let piece = [];
  for (let k = 0; k <= t.length; k++) {
    if (k < t.length && low[k] !== null && high[k] !== null) piece.push(k);
    else if (piece.length) {
      pieces.push(piece);
      piece = [];
    }
  }
  return pieces
    .map((segment) => {
      const upper = segment.map((k) => `${round(x(k))} ${round(y(high[k]) - 0.8)}`);
      const lower = segment.map((k) => `${round(x(k))} ${round(y(low[k]) + 0.8)}`).reverse();
      return `M${[...upper, ...lower].join("L")}Z`;
    })
    .join("");
}
