/**
 * The line that shows how far the display can be trusted: source, age and completeness.
 *
 * createStatusStrip(element) -> {update(status)}
 *     monitor: [text, level]
 *     mode: "live", "replay" or "simulated"; only live data have an age and a latency.   live: false for an ended flight
 *     figures: {age [s], latency [ms], skipped, lost, unwritten, problem, utc: Date | null}     lost: null where unknown
 *     noRest: why the monitor forecasts no rest of the card.   recorded: played from a file, without link and record
 *     headline: null before it is known or after the flight.   result: of an ended flight, {words, level}
 *     warnings: about the monitor.   validity: "checked", or why not.   staleAfter: age that counts as stale [s]
 * showMode(element, mode)
 * createItems(element, list, look) -> {items: {key: {box, label, value}}, show(key, text, level) -> bool}     whether the text is new
 */

import { h, put } from "../lib/dom.js";
import { sentence, warningWords } from "../lib/monitors.js";
import { counted } from "../lib/numbers.js";
import { levelOf, partsOf } from "./headline.js";

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
const LONG = 16; // letters of a status beyond which it takes two lines

export function createStatusStrip(element) {
  element.classList.add("status-strip");
  const { items, show } = createItems(element, ITEMS, "status");
  const mode = h("strong", { class: "mode", title: "Where the samples come from" });
  element.prepend(mode);
  items.state.box.setAttribute("role", "status"); // spoken when it changes

  function update({ mode: from, source, monitor, warnings = [], validity = "checked", link, staleAfter, playing, live, recorded = false, noRest = "", headline, cause = null, result = null, figures }) {
    const linked = live && link === "open";
    showMode(mode, live ? from : "record");
    show("source", withoutMode(source, from));
    show("monitor", ...monitor);
    for (const key of ["source", "monitor"]) items[key].value.title = items[key].value.textContent; // may be cut
    if (noRest) items.monitor.value.title += ". Rest of the test card: no forecast with this method";
    nameMonitor();
    const ofTest = warnings.filter((text) => !text.startsWith("validity ")); // the monitor's name says that
    items.test.box.title = ofTest.map(sentence).join(" ");
    show("test", warningWords({ warnings: ofTest }), "caution");
    if (result) showState([result.words], result.level);
    else if (headline === null) showState(["–"], "off");
    else showState(partsOf(briefly(headline), cause), levelOf(headline));
    const isTimed = live && !recorded;
    show("link", ...(isTimed ? linkOf(link) : [""]));
    show("utc", isTimed ? (figures.utc?.toISOString().slice(11, 19) ?? "–") : "");
    show("age", ...(live && from === "live" ? ageOf() : [""]));
    show("latency", ...(live && from === "live" ? latencyOf() : [""]));
    const rest = figures.lost === 0 ? " (all recorded)" : "";
    show("skipped", figures.skipped > 0 ? `skipped ${counted(figures.skipped, "sample")}${rest}` : "", "caution");
    show("record", ...(recorded ? [""] : live && link === "lost" ? ["–", "off"] : recordOf(figures)));
    items.record.box.title = figures.problem === "" ? RECORD : sentence(figures.problem);

    /** The line has room for what is wrong. */
    function nameMonitor() {
      const [name, wrong] = validity === "checked" ? ["monitor", ""] : ["monitor, validity ", validity];
      if (items.monitor.label.textContent !== name + wrong) items.monitor.label.replaceChildren(h(wrong ? "span.visually-hidden" : "span", name), wrong);
    }

    /** The word is the largest text of the page. */
    /** @param {string[]} words */
    function showState([word, beside = ""], level) {
      if (show("state", [word, beside].filter(Boolean).join(" · "), level))
        items.state.value.replaceChildren(h("span.state-word", word), beside && h("span.state-beside", h("span.visually-hidden", " · "), beside));
      items.state.box.toggleAttribute("data-long", word.length > LONG);
    }

    function ageOf() {
      if (!Number.isFinite(figures.age)) return ["–", "off"];
      if (linked && !playing) return ["paused", "off"];
      return [`${figures.age.toFixed(1)} s`, figures.age > staleAfter ? "caution" : ""];
    }

    function latencyOf() {
      if (!linked || !Number.isFinite(figures.latency)) return ["–", "off"];
      return [`${Math.round(figures.latency)} ms`, figures.latency > LATE ? "caution" : ""];
    }
  }

  return { update };
}

export function showMode(element, mode = "") {
  put(element, mode.toUpperCase());
  element.dataset.mode = mode;
}

/** Named figures after what the element holds; one without text is hidden. list: [[key, name, title]] */
export function createItems(element, list, look) {
  const items = {};
  for (const [key, name, title] of list) {
    const label = h("span.status-name", name);
    const value = h(`span.${look}-value`, "–");
    items[key] = { box: h(`div.${look}-item`, { "data-item": key, title }, label, value), label, value };
    element.append(items[key].box);
  }

  function show(key, text, level = "") {
    const { box, value } = items[key];
    box.hidden = text === "";
    const isNew = value.textContent !== text;
    put(value, text);
    if (box.dataset.level !== level) box.dataset.level = level;
    return isNew;
  }

  return { items, show };
}

/** The mode is first on the line. */
function withoutMode(source, mode) {
  return source === mode ? "" : source.startsWith(`${mode}, `) ? source.slice(mode.length + 2) : source;
}

function recordOf({ lost, unwritten, problem }) {
  const gone = lost > 0 ? `, ${counted(lost, "sample")} lost` : "";
  if (problem !== "" && unwritten === 0) return [`${CAUTION}STORE NOT WRITABLE${gone}`, "caution"];
  if (problem !== "") return [`${CAUTION}NOT RECORDED, ${counted(unwritten, "sample")} waiting${gone}`, "caution"];
  if (lost === null) return [`${CAUTION}end may be missing`, "caution"];
  return lost > 0 ? [`${CAUTION}${counted(lost, "sample")} lost`, "caution"] : ["complete", ""];
}

function linkOf(link) {
  if (link === "over") return ["ended", "off"];
  if (link === "open") return ["✓ open", ""];
  if (link === "silent") return [`${CAUTION}NO HEARTBEAT`, "caution"];
  if (link === "lost") return [`${CAUTION}LOST`, "caution"];
  return ["connecting", "caution"];
}

/** The strip keeps two lines: how early the warning came replaces when the limit was exceeded. */
function briefly(headline) {
  return headline.verdict?.warning ? { ...headline, exceeded_t: null } : headline;
}
