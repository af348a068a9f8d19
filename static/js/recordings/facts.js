/** An uploaded file: its facts, what reading it left out, its signals. */

import { chip, factList, h, sentences, table } from "../lib/dom.js";
import { bytesText, count, counted, durationText, figure, moment, percent, timeZero } from "../lib/numbers.js";
import { nameParts } from "./mapping/signal_select.js";

const SHOWN = 100; // signals listed without a filter

export function formatTitle(catalog, key) {
  return catalog.telemetry.formats.find((format) => format.key === key)?.title ?? key;
}

export function recordingFacts(recording, catalog) {
  const { contents, same_as: twin, flight_id: flight } = recording;
  const entries = [
    ["Aircraft", recording.aircraft ?? "not recorded"],
    ["Format", formatTitle(catalog, recording.format)],
    ["Size", bytesText(recording.size)],
    ["Length", durationText(recording.duration ?? NaN)],
    ["Samples", count(contents.groups.reduce((sum, group) => sum + group.n_rows, 0))],
    ["Rate", ratesOf(contents.groups)],
    ["Signals", count(contents.signals.length)],
    ["Begins", timeZero(contents.start)],
    ["Uploaded", moment(recording.created)],
  ];
  const linked = (words, href, text) => h("p", words, h("a", { href }, text), ".");
  return h(
    "section.panel.stack-tight",
    { "aria-label": "File" },
    factList(entries),
    h("p.dim", "SHA-256 ", h("span.hash", recording.digest)),
    flight && linked("Recorded from a live flight: ", `#/fly/${flight}`, "open its record"),
    twin && linked("Same file as ", `#/recordings/${twin}`, "an earlier recording"),
    sentences([...contents.notes, ...contents.ignored.map((words) => `Skipped: ${words}`)]),
    badRows(recording.bad_rows),
  );
}

function ratesOf(groups) {
  const rates = groups.map(({ rate }) => rate).filter(Number.isFinite);
  if (!rates.length) return "–";
  const [least, most] = [Math.min(...rates), Math.max(...rates)].map((rate) => figure(rate));
  return least === most ? `${least} Hz` : `${least} to ${most} Hz`;
}

function badRows({ n, share, rows }) {
  if (!n) return null;
  const skipped = ` skipped, ${percent(share, share < 0.001 ? 3 : 1)} of the file: lines and reasons`;
  return h(
    "details.fold.bad-rows",
    h("summary", chip(`◆ ${counted(n, "bad row")}`, "caution"), skipped),
    badRowsTable(rows),
    n > rows.length && h("p.hint", `First ${rows.length} of ${n}.`),
  );
}

export function badRowsTable(rows) {
  const columns = [
    ["Line", ({ line }) => count(line), "name number"],
    ["Reason", ({ reason: why }) => why],
    ["Text", ({ text }) => h("code", text)],
  ];
  return h("div.bad-rows-table", table({ columns, items: rows, panel: false }));
}

export function createSignalList(recording) {
  const { signals, groups } = recording.contents;
  const filter = h("input", { type: "search", "aria-label": "find a signal", placeholder: "find a signal", oninput: list });
  const shown = h("div");
  const more = h("p.hint");
  const valueOf = (key) => (signal) => figure(signal[key], 4);
  const columns = [
    ["Signal", nameOf, "name"],
    ["Unit", ({ unit }) => unit],
    ["Values", ({ n }) => count(n), "number"],
    ["Missing", ({ missing }) => (missing ? count(missing) : "none"), "number"],
    ["Minimum", valueOf("min"), "number"],
    ["Maximum", valueOf("max"), "number"],
    ["Mean", valueOf("mean"), "number"],
  ];
  list();
  const title = `all ${signals.length} signals in the file`;
  return h("details.panel.fold.signal-list", h("summary", title), signals.length > 12 && h("div.field", filter), shown, more);

  function list() {
    const wanted = filter.value.trim().toLowerCase();
    const fits = signals.filter(({ name, description }) => `${name} ${description}`.toLowerCase().includes(wanted));
    shown.replaceChildren(table({ columns, items: fits.slice(0, SHOWN), panel: false }));
    const isLong = fits.length > SHOWN;
    more.textContent = isLong ? `First ${SHOWN} of ${fits.length}. Type part of a name to find others.` : "";
  }

  function nameOf({ name, group, description }) {
    const [label, groupName] = nameParts(name, groups.length > 1 ? groups[group].name : "");
    const words = [groupName, description].filter(Boolean).map((text) => ` ${text}`);
    return [label, h("span.hint", words.join(","))];
  }
}
