/**
 * The line that shows how far the display can be trusted: source, age and completeness.
 *
 * Exports
 *   createStatusStrip(element) -> {update(status)}
 *     status: {mode, source, monitor, warnings, validity, link, staleAfter, playing, live, headline, cause, result,
 *              figures: {age [s], latency [ms], skipped, lost, unwritten, problem, utc: Date | null}}
 *     noRest: why the monitor forecasts no rest of the card; empty where it does
 *     recorded: of a flight that is played from a file, which has no link and no record
 *     lost: null where the number is unknown, as after a killed server
 *     mode: "live", "replay" or "simulated"; only live data have an age and a latency, only a flight
 *     in progress a link and the time of day
 *     headline: of the flight, null before it is known or after the flight
 *     result: of an ended flight, {words, level}
 *     warnings: about the monitor, shown beside its name
 *     validity: "checked", or why not, shown beside the monitor
 *     link: "connecting" | "open" | "silent" | "lost" | "over"; staleAfter: age that counts as stale [s]; live: false for an ended flight
 */

import { h, put } from "../lib/dom.js";
import { sentence, warningWords } from "../lib/monitors.js";
import { LEVEL_OF, textOf } from "./headline.js";

const RECORD = "Whether the server stores the flight; samples waiting for its disk, and samples lost";
const ITEMS = [
  ["state", "status", "Worst condition of this flight now; stale and invalid are always shown beside it"],
  ["link", "link", "Connection to the server"],
  ["source", "source", "Where the samples come from"],
  ["monitor", "monitor", "The monitor in use. With calibrated validity it shows INVALID for a flight unlike its training flights"],
  ["test", "monitor's test", "Warnings from the monitor's test flights"],
  ["utc", "UTC", "The server's date and time"],
  ["age", "data age", "Time since the newest sample was taken"],
  ["latency", "latency", "Newest sample: from the server's clock to this page"],
  ["skipped", "display", "Samples that are not drawn because this page was busy and could not read them again"],
  ["record", "recording", RECORD],
];
const LATE = 300; // ms
const CAUTION = "◆ ";
const LONG = 32; // letters of a status beyond which it takes two lines

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

  const mode = h("strong", { class: "mode", title: "Where the samples come from" });
  element.prepend(mode);

  function update({ mode: from, source, monitor, warnings = [], validity = "checked", link, staleAfter, playing, live, recorded = false, noRest = "", headline, cause, result, figures }) {
    const linked = live && link === "open";
    put(mode, from === undefined ? "" : live ? from.toUpperCase() : "RECORD");
    mode.dataset.mode = live ? (from ?? "") : "record";
    for (const key of ["age", "latency"]) items[key].box.hidden = from !== "live";
    for (const key of ["utc", "link"]) items[key].box.hidden = !live || recorded;
    items.record.box.hidden = recorded;
    items.skipped.box.hidden = figures.skipped === 0;
    show("source", source);
    show("monitor", monitor);
    for (const key of ["source", "monitor"]) items[key].value.title = items[key].value.textContent; // may be cut
    if (noRest) items.monitor.value.title += ". Rest of the test card: no forecast with this method";
    put(items.monitor.label, validity === "checked" ? "monitor" : `monitor, validity ${validity}`);
    items.test.box.hidden = warnings.length === 0;
    items.test.box.title = warnings.map(sentence).join(" ");
    show("test", warningWords({ warnings }), "caution");
    if (result) show("state", result.words, result.level);
    else if (headline === null) show("state", "–", "off");
    else show("state", textOf(briefly(headline), cause), LEVEL_OF[headline.level]);
    items.state.box.toggleAttribute("data-long", items.state.value.textContent.length > LONG);
    show("link", ...linkOf(live, link));
    show("utc", figures.utc === null ? "–" : figures.utc.toISOString().slice(11, 19));
    if (!live) show("age", "ended", "off");
    else if (!Number.isFinite(figures.age)) show("age", "–", "off");
    else if (linked && !playing) show("age", "paused", "off");
    else show("age", `${figures.age.toFixed(1)} s`, figures.age > staleAfter ? "caution" : "");
    const known = linked && Number.isFinite(figures.latency);
    show("latency", known ? `${Math.round(figures.latency)} ms` : "–", !known ? "off" : figures.latency > LATE ? "caution" : "");
    show("skipped", `skipped ${figures.skipped.toLocaleString("en")} samples${figures.lost === 0 ? " (all recorded)" : ""}`, "caution");
    show("record", ...(live && link === "lost" ? ["–", "off"] : recordOf(figures)));
    items.record.box.title = figures.problem === "" ? RECORD : sentence(figures.problem);
  }

  return { update };
}

function recordOf({ lost, unwritten, problem }) {
  const gone = lost > 0 ? `, ${lost} samples lost` : "";
  if (problem !== "" && unwritten === 0) return [`${CAUTION}STORE NOT WRITABLE${gone}`, "caution"];
  if (problem !== "") return [`${CAUTION}NOT RECORDED, ${unwritten} samples waiting${gone}`, "caution"];
  if (lost === null) return [`${CAUTION}end may be missing`, "caution"];
  return lost > 0 ? [`${CAUTION}${lost} samples lost`, "caution"] : ["complete", ""];
}

function linkOf(live, link) {
  if (!live || link === "over") return ["ended", "off"];
  if (link === "open") return ["✓ open", ""];
  if (link === "silent") return [`${CAUTION}NO HEARTBEAT`, "caution"];
  if (link === "lost") return [`${CAUTION}LOST`, "caution"];
  return ["connecting", "caution"];
}

/** The strip keeps two lines: how early the warning came replaces when the limit was exceeded. */
function briefly(headline) {
  return headline.verdict?.warning ? { ...headline, exceeded_t: null } : headline;
}
