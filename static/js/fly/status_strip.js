/**
 * The line that says how far the display can be trusted: what is shown, how old, how complete.
 *
 * Exports
 *   createStatusStrip(element) -> {update(status)}
 *     status: {source, monitor, validity, link, staleAfter, playing, live, state, alert,
 *              figures: {age [s], latency [ms], conflated, lost, unwritten, problem, utc: Date | null}}
 *     validity: "checked", or why not, shown beside the monitor
 *     link: "connecting" | "open" | "lost" | "over"; staleAfter: age that is cautioned of [s]; live: false for a flight that is over
 */

import { STATE_WORDS } from "../charts/readout.js";
import { h, put } from "../lib/dom.js";

const ITEMS = [
  ["state", "monitor state", "State of the monitor at the newest sample"],
  ["link", "link", "Connection to the server"],
  ["source", "source", "What is flown"],
  ["monitor", "monitor", "Which monitor assesses it; where its validity is calibrated, it says INVALID of a flight unlike those of training"],
  ["utc", "UTC", "The server's date and time"],
  ["age", "data age", "Time since the newest sample was due"],
  ["latency", "latency", "Newest sample: from the server's clock to this page"],
  ["conflated", "left out", "Samples left out of this display because it was slow; all were assessed and recorded"],
  ["record", "record", "Whether the server stores what is flown; samples that wait for its disk, and those it lost"],
];
const LATE = 300; // ms
const MARKS = { ok: "✓ ", alert: "▲ ", caution: "◆ ", off: "" };

export function createStatusStrip(element) {
  element.classList.add("status-strip");
  const items = {};
  for (const [key, name, title] of ITEMS) {
    const label = h("span", { class: "status-name" }, name);
    const value = h("span", { class: "status-value" }, "–");
    const box = h("div", { class: "status-item", "data-item": key, title }, label, value);
    items[key] = { box, label, value };
    element.append(box);
  }

  function show(key, text, level = "") {
    put(items[key].value, text);
    if (items[key].box.dataset.level !== level) items[key].box.dataset.level = level;
  }

  function update({ source, monitor, validity = "checked", link, staleAfter, playing, live, state, alert, figures }) {
    const linked = live && link === "open";
    show("source", source);
    show("monitor", monitor);
    put(items.monitor.label, validity === "checked" ? "monitor" : `monitor, validity ${validity}`);
    show("state", ...stateOf(linked, state, alert));
    show("link", ...linkOf(live, link));
    show("utc", figures.utc === null ? "–" : figures.utc.toISOString().slice(11, 19));
    if (!live) show("age", "over", "off");
    else if (!Number.isFinite(figures.age)) show("age", "–", "off");
    else if (linked && !playing) show("age", "paused", "off");
    else show("age", `${figures.age.toFixed(1)} s`, figures.age > staleAfter ? "caution" : "");
    const known = linked && Number.isFinite(figures.latency);
    show("latency", known ? `${Math.round(figures.latency)} ms` : "–", !known ? "off" : figures.latency > LATE ? "caution" : "");
    show("conflated", String(figures.conflated), figures.conflated > 0 ? "caution" : "");
    show("record", ...recordOf(figures));
  }

  return { update };
}

function stateOf(linked, state, alert) {
  if (!linked) return ["NOT LIVE", "off"];
  if (state === "ok") return alert ? [`${MARKS.alert}ALERT`, "alert"] : [`${MARKS.ok}OK`, "ok"];
  return [`${MARKS.caution}${STATE_WORDS[state] ?? STATE_WORDS.none}`, "caution"];
}

function recordOf({ lost, unwritten, problem }) {
  const gone = lost > 0 ? `, ${lost} samples lost` : "";
  if (problem !== "") return [`${MARKS.alert}NOT RECORDED, ${unwritten} samples wait${gone}`, "alert"];
  return lost > 0 ? [`${MARKS.alert}${lost} samples lost`, "alert"] : ["all", ""];
}

function linkOf(live, link) {
  if (!live || link === "over") return ["over", "off"];
  if (link === "open") return [`${MARKS.ok}open`, "ok"];
  if (link === "lost") return [`${MARKS.alert}LOST`, "alert"];
  return ["connecting", "caution"];
}
