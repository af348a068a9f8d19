/**
 * The large gauge: the flight's state, what it is about, and the risk on a dial with its threshold.
 *
 * The word is the flight's headline, its worst condition, and the largest text; each has a shape and the colour of
 * its level. Below it is the worst exceedance with its limit, or else the risk: large in an alert, small otherwise.
 * There is a risk only where the sample was assessed; otherwise the dial is hatched grey.
 * Risks are spaced by their square root, as on the risk strip.
 *
 * createRiskGauge(element, timeline) -> {update(reading), setExceedance({value, limit} | null), draw(wall, headline)}
 *     timeline: the strips' clock
 *     reading: {p_value, alertAbove, state, alert, reason, note, result, last, said}, as a frame has them
 *       state: also over (the flight has ended), or null for no data.   note: below the number
 *       last, said: risk and cause of the last sample, where none follows.   result: {words, level} of an ended flight
 */

import { shownState } from "../../lib/states.js";
import { h, piecesOf, svg } from "../../lib/dom.js";
import { figure, riskText } from "../../lib/numbers.js";
import { besideOf, FACES, isStale, staleText, wordOf } from "../headline.js";

const CENTRE = { x: 170, y: 150 };
const RADIUS = 122;
const FROM = -205; // degrees, clockwise from three o'clock
const SWEEP = 230;
const MARGIN = 30; // of the dial on either side, for alertAbove's label
const LARGEST = 42; // letters of the word
const [WIDEST, BOLD, USUAL] = [204, 0.75, 0.62]; // inside of the dial; width of a letter as a share of its size

const WITHOUT = { over: { word: "ENDED", shape: "dash" }, none: FACES.no_data };

const OVER_LEVELS = { alert: "warning", caution: "caution", advisory: "advisory" }; // of a result

const SHAPES = {
  check: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M-6 0l4.5 5l8-9.5",
  warning: "M0-14L15 12H-15ZM0-6V4M0 7.5v1",
  hourglass: "M-9-13H9L-9 13H9Z",
  clock: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M0-8V0L6 4",
  cross: "M-10-10L10 10M10-10L-10 10",
  dash: "M-12 0H12",
  ring: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M-6 0H6",
  diamond: "M0-14L14 0L0 14L-14 0ZM0-6V2M0 6v1",
  bell: "M-12 8H12M-9 8C-9-4-7-12 0-12S9-4 9 8M-2 12H2",
  query: "M-13 0a13 13 0 1 0 26 0a13 13 0 1 0-26 0M-4-4a4 4 0 1 1 5 4v2M0 6v1",
  flag: "M-8 13V-13L10-7L-8-1",
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
  const value = svg("text.gauge-value", { x: CENTRE.x, y: 170 });
  const limit = svg("text.gauge-limit", { x: CENTRE.x, y: 196 });
  const number = svg("text.gauge-number", { x: CENTRE.x });
  const shape = svg("path.gauge-shape");
  const word = svg("text.gauge-word");
  const track = svg("path.gauge-track", { d: arc(0, 1) });
  const dial = svg("svg.gauge-dial", { viewBox: `${-MARGIN} 0 ${340 + 2 * MARGIN} 234` },
    hatches(id), track, unassessed, beyond, bar, needle, threshold, thresholdText, ticks, number, svg("g.gauge-face", shape, word, value, limit));
  const beside = h("p.gauge-beside");
  const reason = h("p.gauge-reason");
  const spoken = h("p.visually-hidden", { role: "status" });
  element.classList.add("risk-gauge");
  element.replaceChildren(h("h2.gauge-heading", "risk (higher is worse)"), dial, beside, reason, spoken);
  let reading = { state: null };
  let exceedance = null;
  let shown = "";

  function draw(wall, headline = null) {
    const face = faceOf(headline);
    const { key, assessed } = face;
    const { p_value: risk = null, alertAbove = null } = reading;
    const digits = assessed ? riskText(risk, alertAbove) : "";
    const why = assessed ? (reading.note ?? "") : whyOf(face, reading, timeline, wall);
    const isBeyond = exceedance !== null && face.exceeds;
    const drawn = `${key} ${face.word} ${face.level} ${face.beside} ${assessed} ${isBeyond ? exceedance.value : ""}`;
    const now = `${drawn}|${digits}|${alertAbove}|${why}|${reading.alert}`;
    if (now === shown) return;
    if (drawn !== shown.split("|")[0]) drawFace(face, isBeyond);
    shown = now;
    element.toggleAttribute("data-alert", assessed && reading.alert === true);
    const isLarge = reading.alert === true && !isBeyond;
    number.textContent = digits;
    number.setAttribute("font-size", isLarge ? "38" : "18");
    number.setAttribute("y", isBeyond ? "222" : isLarge ? "182" : "178");
    reason.textContent = why;
    drawThreshold(alertAbove, assessed);
    if (assessed) {
      const at = Math.max(0.001, share(Math.min(1, Math.max(0, risk))));
      bar.setAttribute("d", arc(0, at));
      const tip = polar(at, RADIUS - 13);
      needle.setAttribute("transform", `translate(${tip.x} ${tip.y}) rotate(${angle(at) - 90})`);
    }
    speak(face, digits, alertAbove, why);
  }

  /** What is shown: the word, its level, what stands beside it, and whether there is a number. */
  function faceOf(said) {
    const { state, p_value: risk } = reading;
    const cause = reading.said ?? reading.cause;
    const stale = isStale(said);
    if (state === "over" || (state == null && !stale)) {
      const key = state ?? "none";
      const { words = "", level = "" } = reading.result ?? {};
      return { key, ...WITHOUT[key], level: OVER_LEVELS[level] ?? "", beside: words, assessed: false };
    }
    const isInvalid = said.status === "invalid" || said.beside.includes("invalid");
    return {
      key: said.status === "invalid" ? shownState({ state: "invalid", cause }) : said.status,
      word: wordOf(said.status, cause),
      shape: FACES[said.status].shape,
      level: said.level,
      beside: said.status === "exceeded" ? firstText(said) : besideOf(said, cause),
      exceeds: Number.isFinite(said.exceeded_t),
      stale,
      assessed: !stale && !isInvalid && state === "ok" && Number.isFinite(risk),
    };
  }

  function drawFace({ key, word: text, shape: sign, level, beside: also, assessed }, isBeyond) {
    element.dataset.state = key;
    element.dataset.level = level;
    shape.setAttribute("d", SHAPES[sign]);
    word.textContent = text;
    beside.textContent = also;
    value.replaceChildren(...(isBeyond ? subscripted(exceedance.value) : []));
    limit.textContent = isBeyond ? exceedance.limit : "";
    if (isBeyond) {
      value.setAttribute("font-size", String(fitting(exceedance.value, 28)));
      limit.setAttribute("font-size", String(fitting(exceedance.limit, 18)));
    }
    const hasMore = assessed || isBeyond; // below the word
    word.setAttribute("font-size", String(fitting(text, LARGEST, BOLD)));
    word.setAttribute("x", String(CENTRE.x));
    word.setAttribute("y", hasMore ? "136" : "160");
    shape.setAttribute("transform", hasMore ? "translate(170 82) scale(1.2)" : "translate(170 98) scale(1.7)");
    show(bar, assessed);
    show(needle, assessed);
    show(unassessed, !assessed);
    spoken.textContent = `${text} ${also}`.trim().toLowerCase(); // spoken when it changes, not at 50 Hz
  }

  function drawThreshold(alertAbove, assessed) {
    const known = Number.isFinite(alertAbove);
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

  function speak({ word: said, assessed }, digits, alertAbove, why) {
    const threshold = Number.isFinite(alertAbove) ? `, alerts above ${figure(alertAbove)}` : "";
    dial.setAttribute("role", assessed ? "meter" : "img"); // a meter must have a value
    dial.setAttribute("aria-label", assessed ? "risk, higher is worse" : `risk not assessed: ${why || said}`);
    const meter = {
      "aria-valuemin": "0",
      "aria-valuemax": "1",
      "aria-valuenow": digits,
      "aria-valuetext": `${digits}, ${said.toLowerCase()}${threshold}`,
    };
    for (const [name, value] of Object.entries(meter)) {
      if (assessed) dial.setAttribute(name, value);
      else dial.removeAttribute(name);
    }
  }

  draw(performance.now());
  return {
    draw,
    update: (given) => {
      reading = given;
    },
    setExceedance: (given) => {
      exceedance = given;
    },
  };
}

function whyOf({ key, stale }, { reason, state, p_value: risk, last = risk, alertAbove }, timeline, wall) {
  if (key === "none") return "no sample has been assessed yet";
  if (stale && timeline !== null && Number.isFinite(timeline.age(wall))) {
    const then = Number.isFinite(last) ? `, its risk ${riskText(last, alertAbove)}` : "";
    return staleText(state === "stale" ? reason : "", timeline.age(wall)) + then;
  }
  return reason || (state === "ok" ? "the assessment has no p-value" : "");
}

const fitting = (text, largest, letter = USUAL) => Math.min(largest, WIDEST / (letter * text.length));

/** "N_y" with y as a subscript. */
function subscripted(words) {
  return piecesOf(words).flatMap(([text, index]) => [svg("tspan", text), index && svg("tspan", { class: "gauge-index", dy: 6 }, index), index && svg("tspan", { dy: -6 }, "\u200b")].filter(Boolean));
}

/** Below the word EXCEEDED, which is wide enough for the dial. */
function firstText({ exceeded_t: t, verdict }) {
  return [Number.isFinite(t) && `first at ${t.toFixed(2)} s`, verdict?.warning].filter(Boolean).join(" · ");
}

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
