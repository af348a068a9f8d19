/**
 * The column at the right of a strip: symbol, current value, state, forecast, cursor values.
 *
 * A measured value is shown while data arrive, dim where the monitor does not assess it; the risk has a
 * number only where it was assessed, else a word. When samples stop, the last value stays, with its age.
 *
 * Exports
 *   createReadout(element, strip) -> {show(reading)}   strip: {symbol, label, unit, limit, risk}
 *     reading: {value, state, age, alert, forecast, lead, a, b, cursor, exceeded: {value, t} | null}
 *     age: of the value [s]
 *   cursorsText({a, b}, cursor) -> string     their times [s], and the difference of A and B
 *   symbolNodes(symbol) -> Node[]     "N_y" as N with subscript y
 *   shownState({state, cause}) -> string    "not_assessed" between the manoeuvres of a recording
 *   stripState({state, cause}) -> string    the same, and the cause where the limits in force are not the monitor's
 *   withdrawnWord(cause) -> string | null    "NOT APPLICABLE" or "LIMITS UNKNOWN", of an invalid sample
 *   STATE_WORDS                       words of the states
 */

import { put } from "../lib/dom.js";
import { formatTime, formatValue, leadSeconds } from "../lib/numbers.js";
import { reading, shownIn } from "../lib/units.js";

export const STATE_WORDS = {
  ok: "OK",
  warming_up: "WARMING UP",
  stale: "STALE",
  invalid: "INVALID",
  not_assessed: "NOT ASSESSED",
  not_applicable: "NOT APPLICABLE",
  limits_unknown: "LIMITS UNKNOWN",
  paused: "PAUSED",
  none: "NO DATA",
};

const WITHDRAWN = ["not_applicable", "limits_unknown"]; // causes of an invalid sample with a word of their own

/** Between manoeuvres there is no guarantee to withdraw. */
export function shownState({ state, cause }) {
  return state === "invalid" && cause === "between_manoeuvres" ? "not_assessed" : state;
}

export function stripState({ state, cause }) {
  return state === "invalid" && WITHDRAWN.includes(cause) ? cause : shownState({ state, cause });
}

export function withdrawnWord(cause) {
  return WITHDRAWN.includes(cause) ? STATE_WORDS[cause] : null;
}

export function createReadout(element, strip) {
  const { symbol, label, risk } = strip;
  const read = (number) => reading(strip, number);
  element.classList.add("readout");
  const line = child(element, "div", "readout-reading");
  child(line, "span", "readout-symbol").append(...symbolNodes(symbol));
  const value = child(line, "span", "readout-value");
  const units = child(line, "span", "readout-unit");
  units.textContent = shownIn(strip).unit;
  const state = child(line, "span", "readout-state");
  const title = child(element, "div", "readout-title");
  child(title, "span", "readout-label").textContent = label;
  const badge = child(title, "span", "readout-badge");
  const latch = child(element, "div", "readout-latch");
  const detail = child(element, "div", "readout-detail");

  function show(now) {
    const known = risk ? isAssessed(now) : now.state !== "stale" && now.state !== "none";
    const last = now.state === "stale" && Number.isFinite(now.value);
    put(value, known || last ? read(now.value) : "");
    units.hidden = !known && !last;
    element.toggleAttribute("data-last", last);
    put(state, known ? "" : (STATE_WORDS[now.state] ?? now.state));
    state.hidden = known;
    element.dataset.state = WITHDRAWN.includes(now.state) ? "invalid" : now.state;
    element.toggleAttribute("data-alert", known && now.alert);
    element.toggleAttribute("data-exceeded", now.exceeded !== null);
    element.toggleAttribute("data-over", known && strip.limit !== null && Math.abs(now.value) >= strip.limit);
    latch.hidden = now.exceeded === null;
    badge.hidden = latch.hidden && !(known && now.alert);
    put(badge, latch.hidden ? "ALERT" : "LIMIT");
    if (now.exceeded !== null) {
      const { t, value: peak } = now.exceeded;
      put(latch, `${peak < 0 ? "▼" : "▲"} ${formatTime(t, 0.01)} s, peak ${read(peak)}`);
    }
    put(detail, details(now, read));
  }

  return { show };
}

function isAssessed({ state, value }) {
  return (
    state === "ok" || ((state === "warming_up" || state === "paused") && Number.isFinite(value))
  );
}

function details({ a, b, cursor, forecast, lead, state, value, age }, read) {
  const both = a !== undefined && b !== undefined;
  const parts = [];
  if (a !== undefined) parts.push(`A ${read(a)}`);
  if (b !== undefined) parts.push(`B ${read(b)}`);
  if (both) parts.push(`Δ ${read(b - a)}`);
  if (parts.length === 0 && cursor !== undefined) parts.push(`cursor ${read(cursor)}`);
  if (parts.length === 0 && Number.isFinite(forecast) && state === "ok") {
    parts.push(`in ${leadSeconds(lead, 2)} s ${read(forecast)}`);
  }
  if (state === "stale" && Number.isFinite(value)) parts.unshift(`last value, ${age.toFixed(1)} s old`);
  return parts.join("  ");
}

export function symbolNodes(symbol) {
  const [head, tail] = symbol.split("_");
  /** @type {Node[]} */
  const nodes = [document.createTextNode(head)];
  if (tail !== undefined) {
    const sub = document.createElement("sub");
    sub.textContent = tail;
    nodes.push(sub);
  }
  return nodes;
}

function child(parent, tag, className) {
  const element = document.createElement(tag);
  element.className = className;
  parent.append(element);
  return element;
}

export function cursorsText({ a, b }, cursor) {
  const parts = [];
  if (Number.isFinite(a)) parts.push(`A ${formatTime(a, 0.001)} s`);
  if (Number.isFinite(b)) parts.push(`B ${formatTime(b, 0.001)} s`);
  if (parts.length === 2) parts.push(`Δt ${formatValue(b - a)} s`);
  if (parts.length === 0 && Number.isFinite(cursor)) {
    parts.push(`cursor ${formatTime(cursor, 0.001)} s`);
  }
  return parts.join("   ");
}
