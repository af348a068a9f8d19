/**
 * The line that says how far the display can be trusted: what is shown, how old, how complete.
 *
 * Exports
 *   createStatusStrip(element) -> {update(status)}
 *     status: {mode, source, monitor, warnings, validity, link, staleAfter, playing, live, headline, cause, result,
 *              figures: {age [s], latency [ms], skipped, lost, unwritten, problem, utc: Date | null}}
 *     noRest: why the monitor forecasts no rest of the card; empty where it does
 *     recorded: of a flight that is played from a file, which has no link and no record
 *     lost: null where nobody knows how many: the server was killed
 *     mode: "live", "replay" or "simulated"; only live data have an age and a latency, only a flight
 *     that is not over a link and the time of day
 *     headline: of the flight, null before it is known or for a flight that is over
 *     result: what one that is over came to, {words, level}
 *     warnings: what speaks against the monitor, shown beside its name
 *     validity: "checked", or why not, shown beside the monitor
 *     link: "connecting" | "open" | "silent" | "lost" | "over"; staleAfter: age that is cautioned of [s]; live: false for a flight that is over
 */

import { h, put } from "../lib/dom.js";
import { sentence, warningWords } from "../lib/monitor_warnings.js";
import { LEVEL_OF, textOf } from "./headline.js";

const RECORD = "Whether the server stores what is flown; samples that wait for its disk, and those it lost";
const ITEMS = [
  ["state", "status", "The worst that is true of this flight now; stale and invalid always stand beside it"],
  ["link", "link", "Connection to the server"],
  ["source", "source", "What is flown"],
  ["monitor", "monitor", "Which monitor assesses it; where its validity is calibrated, it says INVALID of a flight unlike those of training"],
  ["test", "monitor's test", "What the monitor's test flights say against relying on it"],
  ["utc", "UTC", "The server's date and time"],
  ["age", "data age", "Time since the newest sample was taken; it grows while none comes"],
  ["latency", "latency", "Newest sample: from the server's clock to this page"],
  ["skipped", "display", "Samples that are not drawn because this page was busy and could not read them again"],
  ["record", "record", RECORD],
];
const LATE = 300; // ms
const CAUTION = "◆ ";
const LONG = 32; // letters of a status, from which on it takes two lines

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
    else show("state", textOf(headline, cause), LEVEL_OF[headline.level]);
    items.state.box.toggleAttribute("data-long", items.state.value.textContent.length > LONG);
    show("link", ...linkOf(live, link));
    show("utc", figures.utc === null ? "–" : figures.utc.toISOString().slice(11, 19));
    if (!live) show("age", "over", "off");
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
  if (problem !== "" && unwritten === 0) return [`${CAUTION}STORE TAKES NOTHING${gone}`, "caution"];
  if (problem !== "") return [`${CAUTION}NOT RECORDED, ${unwritten} samples wait${gone}`, "caution"];
  if (lost === null) return [`${CAUTION}end may be missing`, "caution"];
  return lost > 0 ? [`${CAUTION}${lost} samples lost`, "caution"] : ["all", ""];
}

function linkOf(live, link) {
  if (!live || link === "over") return ["over", "off"];
  if (link === "open") return ["✓ open", ""];
  if (link === "silent") return [`${CAUTION}NO HEARTBEAT`, "caution"];
  if (link === "lost") return [`${CAUTION}LOST`, "caution"];
  return ["connecting", "caution"];
}
