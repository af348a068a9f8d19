/**
 * The large gauge: the risk on a dial with its alert level, or why there is none.
 *
 * A number is shown only where the sample was assessed; otherwise the dial is hatched grey, with the monitor's state as a
 * word and a shape. Risks are spaced by their square root, as on the risk strip.
 *
 * createRiskGauge(element, timeline) -> {update(reading), draw(wall, headline)}     timeline: the strips' clock
 *     reading: {p_value, alertAbove, state, alert, reason, said}, as a frame has them
 *       state: null for no data
 *       said: cause of the last sample, where none follows
 */

import { STATE_WORDS, stripState, WITHDRAWN } from "../../lib/states.js";
import { h, svg } from "../../lib/dom.js";
import { figure, riskText } from "../../lib/numbers.js";
import { isStale, staleText } from "../headline.js";

const CENTRE = { x: 170, y: 150 };
const RADIUS = 122;
const FROM = -205; // degrees, clockwise from three o'clock
const SWEEP = 230;
const MARGIN = 30; // of the dial on either side, for alertAbove's label
const LARGEST = 30; // letters of the word
const [WIDEST, BOLD] = [204, 0.75]; // inside of the dial; width of a letter as a share of its size
const SHAPES = {
  alert: "M0-14L15 12H-15ZM0-6V4M0 7.5v1",
  warming_up: "M-9-13H9L-9 13H9Z",
  stale: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M0-8V0L6 4",
  invalid: "M-10-10L10 10M10-10L-10 10",
  not_assessed: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M-6 0H6",
  none: "M-12 0H12",
};

let gauges = 0;

export function createRiskGauge(element, timeline = null) {
  const share = Math.sqrt;
  const id = `risk-hatch-${++gauges}`;
  const unassessed = svg("path.gauge-wide", { d: arc(0, 1), stroke: `url(#${id}-grey)` });
  const beyond = svg("path.gauge-wide.gauge-beyond", { stroke: `url(#${id}-red)` });
  const bar = svg("path.gauge-bar");
  const needle = svg("path.gauge-needle", { d: "M0 0L-8-13H8Z" });
  const threshold = svg("path.gauge-threshold");
  const thresholdText = svg("text.gauge-threshold-text");
  const ticks = [0, 0.5, 1].map((value) => {
    const { x, y } = value === 0.5 ? polar(share(value), RADIUS - 32) : polar(value, RADIUS);
    return svg("text.gauge-tick", { x, y: value === 0.5 ? y + 5 : y + 20 }, String(value)); // the ends' labels are below the arc
  });
  const number = svg("text.gauge-number", { x: CENTRE.x, y: 160 });
  const shape = svg("path.gauge-shape", { transform: "translate(170 89) scale(1.7)" });
  const word = svg("text.gauge-word", { x: CENTRE.x, y: 160 });
  const track = svg("path.gauge-track", { d: arc(0, 1) });
  const dial = svg("svg.gauge-dial", { viewBox: `${-MARGIN} 0 ${340 + 2 * MARGIN} 234`, role: "img" },
    hatches(id), track, unassessed, beyond, bar, needle, threshold, thresholdText, ticks, number, svg("g.gauge-face", shape, word));
  const level = h("p.gauge-level"); // on the wall, in place of the label on the arc
  const reason = h("p.gauge-reason");
  element.classList.add("risk-gauge");
  element.replaceChildren(h("h2.gauge-heading", "risk (higher is worse)"), dial, level, reason);
  let reading = /** @type {any} */ ({ state: null });
  let shown = "";

  function draw(wall, headline = null) {
    const { p_value: risk = null, alertAbove = null, alert } = reading;
    const key = keyOf(headline);
    const assessed = key === "ok";
    const digits = assessed ? riskText(risk, alertAbove) : "";
    const why = assessed ? "" : whyOf(key, reading, timeline, wall);
    const now = `${key} ${headline?.level}|${digits}|${alertAbove}|${why}|${alert}`;
    if (now === shown) return;
    shown = now;
    element.dataset.state = key;
    element.dataset.level = headline?.level ?? "";
    element.toggleAttribute("data-alert", assessed && alert === true);
    number.textContent = digits;
    reason.textContent = why;
    drawFace(key, assessed, alert === true);
    drawThreshold(alertAbove, assessed);
    if (assessed) {
      const at = Math.max(0.001, share(Math.min(1, Math.max(0, risk))));
      bar.setAttribute("d", arc(0, at));
      const tip = polar(at, RADIUS - 13);
      needle.setAttribute("transform", `translate(${tip.x} ${tip.y}) rotate(${angle(at) - 90})`);
    }
    const above = Number.isFinite(alertAbove) ? `, alerts above ${figure(alertAbove)}` : "";
    dial.setAttribute("aria-label", assessed ? `risk ${digits}, higher is worse${above}` : `risk not assessed: ${why || STATE_WORDS[key]}`);
  }

  /** "ok" where there is a risk, else the state in its place. */
  function keyOf(headline) {
    const { state, p_value: risk, cause, said = cause } = reading;
    if (isStale(headline)) return "stale";
    if (state == null || headline?.status === "no_data") return "none";
    const isInvalid = [headline?.status, ...(headline?.beside ?? [])].includes("invalid");
    const without = state === "ok" && !Number.isFinite(risk);
    return isInvalid || without ? stripState({ state: "invalid", cause: said }) : stripState({ state, cause });
  }

  function drawFace(key, assessed, isAlert) {
    const text = assessed ? "" : STATE_WORDS[key];
    word.textContent = text;
    word.setAttribute("font-size", String(fitting(text)));
    const sign = assessed ? isAlert && SHAPES.alert : (SHAPES[WITHDRAWN.includes(key) ? "invalid" : key] ?? SHAPES.none);
    shape.setAttribute("d", sign || "");
    show(bar, assessed);
    show(needle, assessed);
    show(unassessed, !assessed);
  }

  function drawThreshold(alertAbove, assessed) {
    const known = Number.isFinite(alertAbove);
    level.textContent = known ? `alert above ${figure(alertAbove)}` : "";
    for (const part of [threshold, thresholdText]) show(part, known);
    show(beyond, known && assessed);
    if (!known) return;
    const at = share(alertAbove);
    const [inner, outer, text] = [RADIUS - 18, RADIUS + 16, RADIUS + 30].map((r) => polar(at, r));
    threshold.setAttribute("d", `M${inner.x} ${inner.y}L${outer.x} ${outer.y}`);
    thresholdText.setAttribute("x", String(text.x));
    thresholdText.setAttribute("y", String(text.y + 4));
    thresholdText.setAttribute("text-anchor", at < 0.42 ? "end" : at > 0.58 ? "start" : "middle");
    thresholdText.textContent = `> ${figure(alertAbove)}`;
    const room = MARGIN + Math.min(text.x, 340 - text.x);
    thresholdText.style.fontSize = `${Math.min(18, room / (0.58 * thresholdText.textContent.length))}px`;
    beyond.setAttribute("d", arc(at, 1));
  }

  draw(performance.now());
  return {
    draw,
    update: (given) => {
      reading = given;
    },
  };
}

function whyOf(key, { reason, state }, timeline, wall) {
  if (key === "none") return "no sample has been assessed yet";
  if (key === "stale" && timeline !== null && Number.isFinite(timeline.age(wall))) {
    return staleText(state === "stale" ? reason : "", timeline.age(wall));
  }
  return reason || (state === "ok" ? "the assessment has no p-value" : "");
}

const fitting = (text) => Math.min(LARGEST, WIDEST / (BOLD * Math.max(1, text.length)));

function hatches(id) {
  const patterns = [["grey", 45], ["red", -45]].map(([name, turn]) =>
    svg("pattern", { id: `${id}-${name}`, width: 8, height: 8, patternUnits: "userSpaceOnUse", patternTransform: `rotate(${turn})` },
      svg(`rect.gauge-hatch-ground.gauge-hatch-${name}`, { width: 8, height: 8 }),
      svg(`rect.gauge-hatch-${name}`, { width: 3, height: 8 })),
  );
  return svg("defs", patterns);
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
