/**
 * Cross plots beside the strips: the user adds, removes, moves and magnifies them, and chooses the two channels of each.
 *
 * createCrossPanel({channels, strips, dt, scale, simulated, address, changed}) -> CrossPanel
 *     strips: of the chart, whose limits are drawn.   scale: of the axes, as for stripOf of ../strips.js   simulated: of ../simulated.js, or null
 *     address: keeps the choice, see ../../lib/address.js.   changed(): plots were added, removed or exchanged
 * usualPairs(channels) -> [[across, up]]     those of the field among these channels
 * crossedIn(text) -> [{word, pair: [across, up], isLarge}]     pair: undefined for a word that cannot be read; of the address: "delta_r:beta*2,beta:Ny"
 *   element, add()
 *   roomy      whether an axis will narrow
 *   measure(), setPalette(palette), draw(frame)     as a part of ../strip_chart.js
 */

import { reason } from "../../lib/api.js";
import { channelName } from "../../lib/catalog.js";
import { secondsText } from "../../lib/clock.js";
import { button, h, piecesOf, put } from "../../lib/dom.js";
import { isLimited } from "../../lib/limits.js";
import { limitsAt, stripOf } from "../strips.js";
import { createCrossPlot } from "./cross_plot.js";

const [CROSS, TRAIL] = ["cross", "trail"]; // names in the address
const MOST = 6;
const TRAILS = [2, 5, 10, 30, 60]; // s
const USUAL_TRAIL = 10;
const USUAL = [["delta_r", "beta"], ["beta", "Ny"], ["Nz", "alpha"]]; // [across, up]
const DESCRIBED_EVERY = 1000; // ms

/** "Ny lateral acceleration": an option has no subscripts. */
const nameOf = (channel) => piecesOf(channelName(channel)).flat().join("");

export function usualPairs(channels) {
  const known = new Set(channels.map(({ key }) => key));
  return USUAL.filter((pair) => pair.every((key) => known.has(key)));
}

export function crossedIn(text) {
  return text.split(",").filter((word) => word !== "").map((word) => {
    const [, across, up, large] = /^([^:*]+):([^:*]+)(\*2)?$/.exec(word) ?? [];
    return { word, pair: up === undefined ? undefined : [across, up], isLarge: large !== undefined };
  });
}

export function createCrossPanel({ channels, strips, dt, scale = {}, simulated, address, changed }) {
  const held = h("div.cross-plots");
  const trailSelect = h("select", { "aria-label": "Length of the trail", onchange: () => setTrail(Number(trailSelect.value)) }, TRAILS.map((seconds) => h("option", { value: seconds }, `${seconds} s`)));
  const bar = h("div.cross-bar", h("h2.cross-title", "Cross plots"), h("label.row", h("span.dim", "trail"), trailSelect), button("Add", add, { class: "button button-small", "aria-label": "Add a cross plot" }));
  const element = h("section.cross-panel", { "aria-label": "Cross plots" }, bar, held);
  const known = new Set(channels.map(({ key }) => key));
  let seconds = TRAILS.find((each) => String(each) === address.get(TRAIL)) ?? USUAL_TRAIL;
  let strange = []; // what the link asks for and this view does not have: it stays in the address until the user changes the plots
  let plots = plotsOf(address.get(CROSS));
  address.follow(CROSS, (text) => {
    plots = plotsOf(text);
    show();
  });
  address.follow(TRAIL, (text) => setTrail(Number(text ?? USUAL_TRAIL)));
  show();

  function plotsOf(text) {
    const isKnown = ({ pair }) => pair?.every((key) => known.has(key));
    const asked = crossedIn(text ?? "");
    strange = asked.filter((each) => !isKnown(each)).map(({ word }) => word);
    const those = asked.filter(isKnown);
    return those.slice(0, MOST).map(({ pair, isLarge }) => plotOf(pair, isLarge));
  }

  function add() {
    if (plots.length < MOST) plots.push(plotOf(nextPair()));
    keep();
  }

  /** The usual ones first, then a limited channel against each other one. */
  function nextPair() {
    const taken = plots.map(({ pair }) => String(pair));
    const first = channels.filter(({ role }) => role === "control").concat(channels);
    const limited = channels.filter(isLimited).concat(channels);
    const any = limited.flatMap((up) => first.filter(({ key }) => key !== up.key).map((across) => [across.key, up.key]));
    return [...usualPairs(channels), ...any].find((pair) => !taken.includes(String(pair))) ?? any[0] ?? [channels[0].key, channels[0].key];
  }

  function plotOf(pair, isLarge = false) {
    const canvas = h("canvas", { role: "img" });
    const note = h("p.cross-note.dim", { hidden: true });
    const selects = pair.map((key, side) => {
      const choose = () => exchange(plot, side, select.value);
      const select = h("select", { "aria-label": side === 1 ? "Channel upwards" : "Channel across", onchange: choose }, channels.map((channel) => h("option", { value: channel.key }, nameOf(channel))));
      select.value = key;
      return select;
    });
    const close = button("✕", () => remove(plot), { class: "button button-small", "aria-label": "✕ Remove this cross plot" });
    const earlier = button("▲", () => move(plot), { class: "button button-small", "aria-label": "▲ Move this cross plot up" });
    const size = button("⤢", () => magnify(plot, size), { class: "button button-small", "aria-label": "⤢ Large cross plot", "aria-pressed": String(isLarge) });
    const head = h("div.cross-head", selects[1], h("span.dim", "against"), selects[0], earlier, size, close);
    const plot = { pair, isLarge, canvas, element: h("figure.cross-plot", { "data-large": String(isLarge) }, head, h("div.cross-canvas", canvas), note), described: -1e9 };
    plot.drawing = drawingOf(plot, canvas);
    ground(plot, note);
    return plot;
  }

  function drawingOf(plot, canvas) {
    const [x, y] = plot.pair.map((key) => stripOf(key, channels, scale));
    plot.axes = [x.axis, y.axis];
    return createCrossPlot(canvas, { x, y, dt });
  }

  async function ground(plot, note) {
    if (simulated === null) return;
    try {
      const { reason: why, ...flights } = await simulated.flights(...plot.pair);
      if (why === "") plot.drawing.setFlights(flights);
      else tell(`No simulated flights: ${why}.`);
    } catch (error) {
      tell(`Simulated flights could not be read: ${reason(error)}`);
    }
    changed();

    function tell(words) {
      put(note, words);
      note.hidden = false;
    }
  }

  function exchange(plot, side, key) {
    const pair = plot.pair.with(side, key);
    plots = plots.map((each) => (each === plot ? plotOf(pair, plot.isLarge) : each));
    keep();
  }

  function move(plot) {
    const at = plots.indexOf(plot);
    plots.splice(Math.max(0, at - 1), 0, ...plots.splice(at, 1));
    const focused = document.activeElement;
    keep();
    if (focused instanceof HTMLElement) focused.focus();
  }

  function magnify(plot, button) {
    plot.isLarge = !plot.isLarge;
    plot.element.dataset.large = button.ariaPressed = String(plot.isLarge);
    keep();
  }

  function remove(plot) {
    plots = plots.filter((each) => each !== plot);
    keep();
  }

  function setTrail(wanted) {
    seconds = TRAILS.find((each) => each === wanted) ?? USUAL_TRAIL;
    show();
  }

  function keep() {
    strange = [];
    show();
  }

  function show() {
    trailSelect.value = String(seconds);
    const words = plots.map(({ pair, isLarge }) => `${pair.join(":")}${isLarge ? "*2" : ""}`);
    address.set(CROSS, [...words, ...strange].join(",") || null);
    address.set(TRAIL, seconds === USUAL_TRAIL ? null : String(seconds));
    if (plots.length !== held.childElementCount || plots.some(({ element: each }, k) => held.children[k] !== each)) held.replaceChildren(...plots.map((plot) => plot.element));
    element.hidden = plots.length === 0;
    changed();
  }

  function measure() {
    for (const { canvas, drawing } of plots) {
      const { width, height } = canvas.parentElement.getBoundingClientRect();
      if (width > 0) drawing.resize(width, height);
    }
  }

  function draw(frame) {
    for (const plot of plots) {
      drawOn(plot.drawing, plot, frame);
      if (frame.wall - plot.described < DESCRIBED_EVERY) continue;
      plot.described = frame.wall;
      plot.canvas.setAttribute("aria-label", plot.drawing.describe());
    }
  }

  function drawOn(drawing, { pair }, { cursor, tip, trail, word, wall }) {
    const to = Number.isFinite(cursor) ? cursor : tip;
    const [x, y] = pair.map((key) => limitsNow(key, to));
    const old = Number.isFinite(cursor) ? `AT ${secondsText(cursor)}` : "";
    drawing.draw({ trail, from: to - seconds, to, word, at: old, limits: { x, y }, wall });
  }

  function limitsNow(key, t) {
    const strip = strips.find((each) => each.key === key);
    return strip === undefined ? null : limitsAt(strip, t);
  }

  return {
    element,
    add,
    measure,
    setPalette: (given) => {
      for (const { drawing } of plots) drawing.setPalette(given);
    },
    draw,
    get roomy() {
      return plots.some(({ axes }) => axes.some((axis) => axis.roomy));
    },
  };
}
