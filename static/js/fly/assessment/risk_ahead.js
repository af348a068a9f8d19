/**
 * The risk against time ahead: a row for each monitor of a flight, by how far ahead it warns.
 *
 * A bar and a number only where the sample was assessed, else a word. One monitor raises the alarms, and
 * its row is marked; the others are for display only.
 *
 * createRiskAhead(element, monitors) -> {onFrame(frame), draw(stale)}     hidden for a single monitor
 *     monitors: as hello has them, the alarm authority first.   frame: the newest; null for none
 */

import { shownState, STATE_WORDS, withdrawnWord } from "../../lib/states.js";
import { h, put } from "../../lib/dom.js";
import { leadSeconds, riskText } from "../../lib/numbers.js";

const share = (risk) => `${100 * Math.sqrt(Math.min(1, Math.max(0, risk)))}%`; // as on the gauge

const rolesOf = ({ authority }) => (authority ? "raises the alarms" : "display only");

const byLead = (monitors) =>
  monitors.map((monitor, position) => ({ monitor, position })).sort((a, b) => a.monitor.lead - b.monitor.lead);

export function createRiskAhead(element, monitors) {
  const rows = byLead(monitors).map(rowOf);
  let newest = null;
  element.classList.add("risk-ahead");
  element.setAttribute("aria-label", "Risk against time ahead");
  element.hidden = rows.length < 2;
  element.replaceChildren(h("h2.risk-ahead-heading", "risk against time ahead"), h("ul", rows.map(({ line }) => line)));
  draw(false);

  function draw(stale) {
    if (!element.hidden) for (const row of rows) show(row, readingOf(row, stale));
  }

  /** The monitor's assessment of the newest sample, or the state in its place. */
  function readingOf({ position }, stale) {
    if (stale) return { state: "stale", reason: "the display is stale" };
    const assessment = newest && assessmentOf(newest, position);
    return assessment ? { ...assessment, state: shownState(assessment) } : { state: "none", reason: "" };
  }

  return {
    onFrame: (frame) => {
      newest = frame;
    },
    draw,
  };
}

const assessmentOf = (frame, position) => (position === 0 ? frame : frame.display?.[position - 1]);

function rowOf({ monitor, position }) {
  const value = h("span", { class: "ahead-value" });
  const bar = h("span", { class: "ahead-bar" });
  const threshold = h("span", { class: "ahead-threshold" });
  threshold.style.left = share(monitor.alert_above);
  const line = h(
    "li",
    { class: "ahead-row", "data-authority": monitor.authority },
    h("span", { class: "ahead-lead" }, `${leadSeconds(monitor.lead)} s`),
    h("span", { class: "ahead-track", title: `alerts above ${monitor.alert_above}` }, bar, threshold),
    value,
    h("span", { class: "ahead-name", title: monitor.name }, monitor.name),
    h("span", { class: "ahead-role" }, rolesOf(monitor)),
  );
  return { monitor, position, line, value, bar };
}

function show({ monitor, line, value, bar }, { state, reason, cause, p_value: risk, alert }) {
  const assessed = state === "ok" && Number.isFinite(risk);
  const over = assessed && alert === true;
  const withdrawn = state === "invalid" ? withdrawnWord(cause) : null;
  const words = state === "ok" ? "NOT ASSESSED" : (withdrawn ?? STATE_WORDS[state] ?? state);
  put(value, assessed ? `${over ? "▲ alert " : ""}${riskText(risk, monitor.alert_above)}` : words);
  const title = assessed ? "" : reason;
  if (value.title !== title) value.title = title;
  if (line.dataset.state !== state) line.dataset.state = state;
  line.toggleAttribute("data-alert", over);
  bar.hidden = !assessed;
  if (assessed) bar.style.width = share(risk);
}
