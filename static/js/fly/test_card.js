/**
 * The test card beside the strips: the point, its phase, what comes next, and the flown input over the planned one.
 *
 * createTestCard(element) -> TestCard     hidden until a card is shown
 *   show(hello)              the card and channels of the alarm authority; of a monitor set it changes in flight
 *   draw({frame, begun, condition, ring, stale})     frame: the newest; null before the first
 *     begun: [{number, t}] manoeuvres.   condition: of a live source as sent, {key: value | "missing" | "implausible" | "stale"}; else null
 *     ring: of the flight's chart
 * phaseOf(card, begun, frame) -> {phase, since, what, step, wait}     phase: one of PHASES
 *     since: t of the first input of the manoeuvre that is flown or was the last [s]; null before the first
 *     what: comes next: "step" (number `step`, from 0), "input end", "end", "rest", "stillness", "test end" or ""
 *     wait: until then [s]; null where it is up to a person
 * flownOf(ring, series, from, to) -> {t, y, peak, lasts, known}     t: [s] from `from`; y: NaN in a gap; known: false where its beginning is lost
 */

import { BROKEN } from "../charts/live/ring_buffer.js";
import { formatted, h, put, svg } from "../lib/dom.js";
import { figure, magnitude, magnitudeIn, percent, shownIn } from "../lib/numbers.js";

const PHASES = ["before", "input", "response", "after"];
const NEAR = 1e-6; // s
const WAITS = { rest: "rest", moving: "stillness", ready: "step" }; // what comes next, by the cause of a sample between manoeuvres
const [WIDTH, HEIGHT, PAD] = [260, 58, 4];
const AIRSPEED = { key: "V", symbol: "V", unit: "m/s", label: "true airspeed" };
const MACH = { key: "mach", symbol: "M", unit: "1", label: "Mach number" };
const ALTITUDE = { key: "altitude", symbol: "h", unit: "m", label: "altitude" };
const CONDITION = [AIRSPEED, MACH, ALTITUDE];

export function createTestCard(element) {
  element.classList.add("test-card");
  element.setAttribute("aria-label", "Test card");
  element.hidden = true;
  const point = h("p.card-point");
  const chips = PHASES.map((name) => h("li", { "data-phase": name }, name));
  const next = h("p.card-next", { role: "status", "aria-live": "off" });
  const plots = h("div.card-plots");
  const condition = h("dl.card-condition");
  element.append(h("div.card-head", h("h2.risk-ahead-heading", "test card"), next), point, h("ol.card-phases", { "aria-label": "Phase" }, chips), plots, condition);
  let card = null;
  let channels = [];
  let inputs = [];
  let rest = null; // {from, t}: when the wait at rest began
  let drawn = ""; // what the plots show

  function show(hello) {
    card = hello.card ?? null; // a recorded demonstration has none
    element.hidden = card === null;
    if (card === null) return;
    channels = hello.channels;
    drawn = "";
    const { point: planned, why } = card;
    const words = planned === null ? "" : `${planned.number} of ${planned.points}: ${planned.name} · ${planned.campaign_name}`;
    put(point, words);
    point.hidden = planned === null;
    point.title = words;
    inputs = card.inputs.map(createInput);
    plots.replaceChildren(...(why ? [h("p.card-none", `No planned input: ${why}.`)] : inputs.map(({ element: each }) => each)));
  }

  function createInput(input) {
    const channel = channels.find(({ key }) => key === input.channel);
    return { ...createPlot(channel, input, card.length), series: channels.indexOf(channel) };
  }

  function draw({ frame, begun, condition: sent, ring, stale }) {
    if (card === null) return;
    const { phase, since, ...then } = phaseOf(card, begun, frame);
    element.toggleAttribute("data-stale", stale);
    for (const chip of chips) chip.toggleAttribute("aria-current", !stale && chip.dataset.phase === phase);
    put(next, stale ? "not known: the display is stale" : frame === null ? "no sample yet" : nextWords(then, frame));
    showFlown(ring, frame, since, phase !== "input");
    showCondition(frame, sent);
  }

  function nextWords({ what, step = 0, wait }, { t }) {
    if (what !== "rest") rest = null;
    else if (rest === null || t < rest) rest = t;
    const words = {
      step: () => (card.inputs.length > 0 ? stepWords(card, channels, step) : "the input"),
      "input end": () => "end of the input",
      end: () => "end of the manoeuvre",
      rest: () => `wait ${Math.max(0, card.rest - (t - rest)).toFixed(1)} s at rest`,
      stillness: () => `bring surfaces and aircraft to rest, then wait ${card.rest.toFixed(1)} s`,
      "test end": () => "end of the test",
    }[what]();
    if (wait !== null) return `${words} in ${Math.max(0, wait).toFixed(1)} s`;
    return what === "step" ? `ready: ${words}` : words;
  }

  function showFlown(ring, frame, since, isFlown) {
    const to = since === null ? NaN : since + (card.length ?? Infinity);
    const stamp = `${isFlown} ${since} ${since === null ? "" : Math.min(to, frame.t)} ${ring.count()}`;
    if (stamp === drawn || inputs.length === 0) return;
    drawn = stamp;
    for (const input of inputs) input.draw(since === null ? null : flownOf(ring, input.series, since, to), isFlown);
  }

  function showCondition(frame, sent) {
    const rows = CONDITION.map((quantity) => {
      const { key, symbol, label } = quantity;
      const model = { V: card.airspeed, altitude: card.altitude }[key] ?? null;
      const value = valueOf(quantity, frame, sent);
      const isKnown = typeof value === "number";
      const beside = model !== null && h("span.dim", `model ${magnitudeIn(quantity, model)}`);
      return h("div", h("dt", { title: label }, symbol), h("dd", { "data-known": isKnown }, isKnown ? magnitudeIn(quantity, value) : value), h("dd", beside));
    });
    const text = rows.map(({ textContent }) => textContent).join();
    if (text !== condition.dataset.shown) condition.replaceChildren(...rows);
    condition.dataset.shown = text;
  }

  /** A number as sent, or why there is none. */
  function valueOf({ key }, frame, sent) {
    const c = channels.findIndex((channel) => channel.key === key);
    const value = c >= 0 ? frame?.y[c] : sent?.[key];
    if (typeof value === "number") return value;
    if (value === "implausible") return value;
    return value === "stale" ? "not sent for 1 s" : "not sent";
  }

  return { show, draw };
}

export function phaseOf(card, begun, frame) {
  const t = frame?.t ?? NaN;
  const now = begun.findLast((each) => each.t <= t + NEAR) ?? null;
  const since = now?.t ?? null;
  const elapsed = since === null ? NaN : t - since;
  if (since === null || isBetween(frame) || elapsed > card.length + NEAR) {
    return { phase: since === null ? "before" : "after", since, ...nextInput(begun, frame) };
  }
  const end = inputEnd(card);
  if (elapsed >= end - NEAR && card.inputs.length > 0) {
    return { phase: "response", since, what: "end", wait: card.length === null ? null : card.length - elapsed };
  }
  const step = card.steps.findIndex((at) => at > elapsed + NEAR);
  if (step >= 0) return { phase: "input", since, what: "step", step, wait: card.steps[step] - elapsed };
  const isPlanned = card.inputs.length > 0;
  return { phase: "input", since, what: isPlanned ? "input end" : "end", wait: isPlanned ? end - elapsed : null };
}

/** Between manoeuvres: the next one of a source that is known, or what a live source waits for. */
function nextInput(begun, frame) {
  if (frame === null) return { what: "step", step: 0, wait: null };
  const later = begun.find(({ t }) => t > frame.t + NEAR);
  if (later !== undefined) return { what: "step", step: 0, wait: later.t - frame.t };
  return { what: WAITS[frame.cause] ?? (begun.length > 0 ? "test end" : "step"), step: 0, wait: null };
}

const isBetween = ({ cause }) => cause in WAITS || cause === "between_manoeuvres";

/** Time from which the planned input stays at trim [s]. */
function inputEnd({ inputs }) {
  return Math.max(0, ...inputs.map(({ t, y }) => t[Math.min(t.length - 1, y.findLastIndex((value) => value !== 0) + 1)]));
}

/** "rudder to −5 deg" */
function stepWords(card, channels, step) {
  const at = card.steps[step] + NEAR;
  const [input] = card.inputs;
  const channel = channels.find(({ key }) => key === input.channel);
  const level = input.y[input.t.findLastIndex((t) => t <= at)];
  return `${channel.label} to ${level === 0 ? "neutral" : magnitudeIn(channel, level)}`;
}

export function flownOf(ring, series, from, to) {
  const [t, y] = [[], []];
  const first = ring.after(from - NEAR);
  const known = ring.count() > first && ring.time(first) <= from + 0.5;
  let [peak, beyond, step] = [0, 0, 0];
  for (let i = first; i < ring.count() && ring.time(i) <= to + NEAR; i++) {
    const value = ring.value(series, i);
    const isBroken = i > first && (ring.flags(i, i + 1) & BROKEN) !== 0;
    for (const each of isBroken ? [NaN, value] : [value]) {
      t.push(ring.time(i) - from);
      y.push(each);
    }
    if (Math.abs(value) > Math.abs(peak)) peak = value;
  }
  for (let k = 1; k < t.length; k++) {
    step = t[k] - t[k - 1];
    if (Math.abs(y[k]) >= 0.5 * Math.abs(peak)) beyond += step;
  }
  return { t, y, peak: y.some(Number.isFinite) ? peak : NaN, lasts: beyond, known };
}

/** Planned and flown input of a control: the drawing, and peak and duration in words. */
function createPlot(channel, planned, length) {
  const zero = svg("path.mini-zero");
  const plan = svg("path.card-plan");
  const line = svg("path.card-flown");
  const box = { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img" };
  const drawing = svg("svg.card-svg", box, zero, plan, line);
  const words = h("figcaption.card-words");
  const element = h("figure.card-plot", drawing, words);
  const end = length ?? planned.t.at(-1);

  function draw(flown, isFlown) {
    const [t, y] = [planned.t, planned.y];
    const reach = Math.max(Math.abs(planned.peak), ...(flown?.y.filter(Number.isFinite).map(Math.abs) ?? []));
    const [width, height] = [WIDTH - 2 * PAD, HEIGHT / 2 - PAD];
    const place = (time, value) => `${(PAD + (Math.min(time, end) / end) * width).toFixed(1)} ${(HEIGHT / 2 - (value / reach) * height).toFixed(1)}`;
    zero.setAttribute("d", `M0 ${HEIGHT / 2}H${WIDTH}`);
    plan.setAttribute("d", `M${PAD} ${HEIGHT / 2}${t.map((time, k) => `L${place(time, y[k])}`).join("")}`);
    line.setAttribute("d", flown === null ? "" : path(flown, place));
    const said = wordsOf(channel, planned, flown, isFlown);
    words.replaceChildren(formatted(said));
    drawing.setAttribute("aria-label", said);
  }

  return { element, draw };
}

/** A line, broken where a value is missing. */
function path({ t, y }, place) {
  const every = Math.ceil(t.length / (2 * WIDTH));
  let isDown = false;
  return t.map((time, k) => {
    if (k % every > 0 && Number.isFinite(y[k])) return "";
    const wasDown = isDown;
    isDown = Number.isFinite(y[k]);
    return isDown ? `${wasDown ? "L" : "M"}${place(time, y[k])}` : "";
  }).join("");
}

/** "rudder: planned −5 deg, 2.0 s; flown −4.8 deg (96 %), 1.9 s" */
function wordsOf(channel, planned, flown, isFlown) {
  const plan = `${channel.label}: planned ${magnitudeIn(channel, planned.peak)}, ${figure(planned.lasts)} s`;
  if (flown === null) return `${plan}; not flown yet`;
  if (!flown.known) return `${plan}; flown before this display began`;
  if (!Number.isFinite(flown.peak)) return `${plan}; flown input not sent`;
  const share = percent(Math.abs(flown.peak / planned.peak), 0);
  return `${plan}; flown ${magnitude(channel, flown.peak, 3)} ${shownIn(channel).unit} (${share})${isFlown ? `, ${flown.lasts.toFixed(1)} s` : " so far"}`;
}
