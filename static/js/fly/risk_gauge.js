/**
 * The large risk gauge: "risk (higher is worse)", its threshold, and what the monitor can say now.
 *
 * Every state has a word, a shape and a colour. There is a number only where the sample was assessed;
 * otherwise the dial is hatched grey and the word stands in the number's place.
 *
 * Exports
 *   createRiskGauge(element, {timeline, scale}) -> {update(reading), clear(), destroy()}
 *     reading: {p_value, epsilon, state, alert, reason, note}, any frame with its epsilon will do;
 *     note stands below the number; state
 *       ok, warming_up, stale, invalid (between manoeuvres: NOT ASSESSED), over (the flight has ended), or null for no data.
 *     timeline: the strips' clock; with it the gauge turns stale by itself when samples stop.
 *     scale "sqrt" | "linear": spacing of 0..1, as on the risk strip.
 */

import { shownState } from "../charts/readout.js";
import { addDrawer } from "../lib/draw_loop.js";
import { riskText } from "../lib/numbers.js";

const NS = "http://www.w3.org/2000/svg";
const CENTRE = { x: 170, y: 150 };
const RADIUS = 122;
const FROM = -205; // degrees, clockwise from three o'clock
const SWEEP = 230;
const MARGIN = 30; // of the dial on either side, for epsilon's label

const FACES = {
  ok: { word: "OK", shape: "check" },
  alert: { word: "ALERT", shape: "warning" },
  warming_up: { word: "WARMING UP", shape: "hourglass" },
  stale: { word: "STALE", shape: "clock" },
  invalid: { word: "INVALID", shape: "cross" },
  not_assessed: { word: "NOT ASSESSED", shape: "ring" },
  over: { word: "OVER", shape: "dash" },
  none: { word: "NO DATA", shape: "dash" },
};

const SHAPES = {
  check: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M-6 0l4.5 5l8-9.5",
  warning: "M0-14L15 12H-15ZM0-6V4M0 7.5v1",
  hourglass: "M-9-13H9L-9 13H9Z",
  clock: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M0-8V0L6 4",
  cross: "M-10-10L10 10M10-10L-10 10",
  dash: "M-12 0H12",
  ring: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M-6 0H6",
};

/**
 * @typedef {object} Reading
 * @property {string | null} state  ok, warming_up, stale, invalid; null: no data
 * @property {number | null} [p_value] @property {number | null} [epsilon]
 * @property {boolean | null} [alert] @property {string} [reason]
 */

let gauges = 0;

export function createRiskGauge(element, { timeline = null, scale = "sqrt" } = {}) {
  const share = scale === "sqrt" ? Math.sqrt : (value) => value;
  const id = `risk-hatch-${++gauges}`;
  element.classList.add("risk-gauge");
  element.replaceChildren();
  const heading = html(element, "h2", "gauge-heading", "risk (higher is worse)");
  heading.id = `${id}-heading`;
  const svg = make(element, "svg", { viewBox: `${-MARGIN} 0 ${340 + 2 * MARGIN} 228`, class: "gauge-dial" });
  addHatches(svg, id);
  make(svg, "path", { d: arc(0, 1), class: "gauge-track" });
  const unassessed = make(svg, "path", { d: arc(0, 1), stroke: `url(#${id}-grey)`, class: "gauge-wide" });
  const beyond = make(svg, "path", { stroke: `url(#${id}-red)`, class: "gauge-wide gauge-beyond" });
  const bar = make(svg, "path", { class: "gauge-bar" });
  const needle = make(svg, "path", { d: "M0 0L-8-13H8Z", class: "gauge-needle" });
  const threshold = make(svg, "path", { class: "gauge-threshold" });
  const thresholdText = make(svg, "text", { class: "gauge-threshold-text" });
  for (const value of [0, 0.5, 1]) {
    const at = value === 0.5 ? polar(share(value), RADIUS - 32) : polar(value, RADIUS);
    const y = value === 0.5 ? at.y + 5 : at.y + 20; // the ends' labels stand below the arc
    make(svg, "text", { x: at.x, y, class: "gauge-tick" }).textContent = String(value);
  }
  const number = make(svg, "text", { x: CENTRE.x, y: 164, class: "gauge-number" });
  const face = make(svg, "g", { class: "gauge-face" });
  const shape = make(face, "path", { class: "gauge-shape" });
  const word = make(face, "text", { class: "gauge-word" });
  const reason = html(element, "p", "gauge-reason", "");
  const spoken = html(element, "p", "visually-hidden", "");
  spoken.setAttribute("role", "status");
  /** @type {Reading} */
  let reading = { state: null };
  let shown = "";

  function update(given) {
    reading = given;
    render(performance.now());
  }

  function render(wall) {
    const key = faceOf(reading, timeline, wall);
    const assessed = key === "ok" || key === "alert";
    const { p_value: risk = null, epsilon = null } = reading;
    const digits = assessed ? riskText(risk, epsilon) : "";
    const why = assessed ? (reading.note ?? "") : whyOf(key, reading, timeline, wall);
    const now = `${key}|${digits}|${epsilon}|${why}`;
    if (now === shown) return;
    if (now.split("|")[0] !== shown.split("|")[0]) drawFace(key, assessed);
    shown = now;
    number.textContent = digits;
    number.setAttribute("font-size", digits.length > 4 ? "58" : "74");
    reason.textContent = why;
    drawThreshold(epsilon, assessed);
    if (assessed) {
      const at = Math.max(0.001, share(Math.min(1, Math.max(0, risk))));
      bar.setAttribute("d", arc(0, at));
      const tip = polar(at, RADIUS - 13);
      needle.setAttribute("transform", `translate(${tip.x} ${tip.y}) rotate(${angle(at) - 90})`);
    }
    speak(key, assessed, digits, epsilon, why);
  }

  function drawFace(key, assessed) {
    element.dataset.state = key;
    shape.setAttribute("d", SHAPES[FACES[key].shape]);
    word.textContent = FACES[key].word;
    const letters = FACES[key].word.length;
    const size = assessed ? 26 : letters > 10 ? 23 : letters > 8 ? 32 : 40;
    word.setAttribute("font-size", String(size));
    const half = (size * 0.66 * FACES[key].word.length + 40) / 2;
    const y = assessed ? 206 : 160;
    shape.setAttribute("transform", assessed ? `translate(${CENTRE.x - half + 14} ${y - 9})` : "translate(170 98) scale(1.7)");
    word.setAttribute("x", String(assessed ? CENTRE.x + 18 : CENTRE.x));
    word.setAttribute("y", String(y));
    show(bar, assessed);
    show(needle, assessed);
    show(unassessed, !assessed);
    spoken.textContent = `risk ${FACES[key].word.toLowerCase()}`; // spoken when it changes, not at 50 Hz
  }

  function drawThreshold(epsilon, assessed) {
    const known = Number.isFinite(epsilon);
    for (const part of [threshold, thresholdText]) show(part, known);
    show(beyond, known && assessed);
    if (!known) return;
    const at = share(epsilon);
    const [inner, outer, text] = [RADIUS - 18, RADIUS + 16, RADIUS + 30].map((r) => polar(at, r));
    threshold.setAttribute("d", `M${inner.x} ${inner.y}L${outer.x} ${outer.y}`);
    thresholdText.setAttribute("x", String(text.x));
    thresholdText.setAttribute("y", String(text.y + 4));
    thresholdText.setAttribute("text-anchor", at < 0.42 ? "end" : at > 0.58 ? "start" : "middle");
    thresholdText.textContent = `ε ${epsilon}`;
    const room = MARGIN + Math.min(text.x, 340 - text.x);
    thresholdText.style.fontSize = `${Math.min(18, room / (0.58 * thresholdText.textContent.length))}px`;
    beyond.setAttribute("d", arc(at, 1));
  }

  function speak(key, assessed, digits, epsilon, why) {
    const threshold = Number.isFinite(epsilon) ? `, alerts above ${epsilon}` : "";
    svg.setAttribute("role", assessed ? "meter" : "img"); // a meter must have a value
    svg.setAttribute("aria-label", assessed ? "risk, higher is worse" : `risk not assessed: ${why || FACES[key].word}`);
    const meter = {
      "aria-valuemin": "0",
      "aria-valuemax": "1",
      "aria-valuenow": digits,
      "aria-valuetext": `${digits}, ${FACES[key].word.toLowerCase()}${threshold}`,
    };
    for (const [name, value] of Object.entries(meter)) {
      if (assessed) svg.setAttribute(name, value);
      else svg.removeAttribute(name);
    }
  }

  const stop = timeline === null ? () => {} : addDrawer(render);
  render(performance.now());
  return {
    update,
    clear: () => update({ state: null, epsilon: reading.epsilon }),
    destroy: () => {
      stop();
      element.replaceChildren();
    },
  };
}

/** @param {Reading} reading */
function faceOf({ state: given, reason, alert, p_value: risk }, timeline, wall) {
  const state = shownState({ state: given, reason });
  if (state == null) return "none";
  if (timeline !== null && timeline.stale(wall)) return "stale";
  if (state !== "ok") return state in FACES ? state : "invalid";
  if (!Number.isFinite(risk)) return "invalid";
  return alert ? "alert" : "ok";
}

/** @param {string} key @param {Reading} reading */
function whyOf(key, { reason, state }, timeline, wall) {
  if (key === "none") return "no sample has been assessed yet";
  if (key === "stale" && timeline !== null && Number.isFinite(timeline.age(wall))) {
    return `last sample ${timeline.age(wall).toFixed(0)} s ago`;
  }
  return reason || (state === "ok" ? "the assessment has no p-value" : "");
}

function addHatches(svg, id) {
  const defs = make(svg, "defs", {});
  for (const [name, turn] of [["grey", 45], ["red", -45]]) {
    const tile = { id: `${id}-${name}`, width: 8, height: 8, patternUnits: "userSpaceOnUse" };
    const pattern = make(defs, "pattern", { ...tile, patternTransform: `rotate(${turn})` });
    make(pattern, "rect", { width: 8, height: 8, class: `gauge-hatch-ground gauge-hatch-${name}` });
    make(pattern, "rect", { width: 3, height: 8, class: `gauge-hatch-${name}` });
  }
}

function angle(share) {
  return FROM + SWEEP * share;
}

function polar(share, radius) {
  const turn = (angle(share) * Math.PI) / 180;
  return { x: CENTRE.x + radius * Math.cos(turn), y: CENTRE.y + radius * Math.sin(turn) };
}

function arc(from, to) {
  const [begin, end] = [polar(from, RADIUS), polar(to, RADIUS)];
  const large = SWEEP * (to - from) > 180 ? 1 : 0;
  return `M${begin.x} ${begin.y}A${RADIUS} ${RADIUS} 0 ${large} 1 ${end.x} ${end.y}`;
}

function show(element, visible) {
  element.setAttribute("visibility", visible ? "visible" : "hidden");
}

function html(parent, tag, className, text) {
  const element = document.createElement(tag);
  element.className = className;
  element.textContent = text;
  parent.append(element);
  return element;
}

function make(parent, tag, attributes) {
  const element = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  parent.append(element);
  return element;
}
