/**
 * Which signal of a file is which channel, with a preview of the mapped data.
 *
 * recording.channels come first; the other targets are behind "more channels".
 * changed(mapping)   after each correction.   show({key: tiles of a preview}, {key: [warning]})
 */

import { select } from "../../forms/controls.js";
import { h } from "../../lib/dom.js";
import { createMappingRow } from "./row.js";
import { createTimeRows } from "./time_rows.js";

const HEADS = [
  ["channel", "Channel"],
  ["signal", "Signal in the file"],
  ["unit", "Unit"],
  ["sign", "Sign"],
  ["bias", "Bias removed"],
  ["confidence", "Confidence"],
  ["plot", "Mapped data"],
];

export function createMappingTable({ catalog, recording, changed }) {
  const { mapping, contents, targets, rationales, alternatives, derivable, mapping_state: state } = recording;
  const units = catalog.telemetry.time_units;
  const time = createTimeRows({ times: mapping.times, rates: recording.rates, contents, rationales, units, changed: report });
  const isMeasured = ({ key }) => recording.channels.includes(key);
  const isMapped = ({ key }) => key in mapping.channels;
  const listOf = (some) => h("ul.map-rows", some.map((row) => row.element));
  const measured = targets.filter(isMeasured).map(rowOf);
  const mapped = targets.filter((target) => !isMeasured(target) && isMapped(target)).map(rowOf);
  const rows = [...measured, ...mapped];
  const more = listOf(mapped);
  const unmapped = targets.filter((target) => !isMeasured(target) && !isMapped(target));
  const another = select([["", "Map another quantity"], ...unmapped.map(({ key, label }) => [key, label])], {
    class: "map-another",
    "aria-label": "map another quantity",
    onchange: addAnother,
  });
  const head = HEADS.map(([part, words]) => h("span", { class: `map-${part}` }, words));
  const element = h(
    "div.map-table",
    recording.mapping_notes.map((note) => h("p.hint", `${note}.`)),
    h("div.map-head", { "aria-hidden": true }, head),
    time.element,
    listOf(measured),
    h(
      "details.fold.map-more",
      { open: state !== "confirmed" },
      h("summary", `more channels, such as attitude, airspeed and altitude: ${mapped.length} mapped`),
      h(
        "p.hint",
        "Attitude turns the aircraft in the scene. Airspeed is checked against the monitor's flight condition. Missing lateral channels can be derived from some of these quantities.",
      ),
      more,
      h("div.row.map-add", another),
    ),
  );
  show({});

  function rowOf(target) {
    const { key } = target;
    return createMappingRow({
      target,
      source: mapping.channels[key] ?? null,
      contents,
      rationale: rationales[key],
      likely: alternatives[key] ?? [],
      derivable: derivable[key] ?? [],
      state,
      over: recording.confirmed_over?.[key] ?? [],
      needed: recording.missing.includes(key),
      changed: report,
    });
  }

  function addAnother() {
    const target = unmapped.find(({ key }) => key === another.value);
    if (!target) return;
    const row = rowOf(target);
    row.show();
    rows.push(row);
    another.selectedOptions[0].remove();
    another.value = "";
    more.append(row.element);
    row.element.querySelector("select").focus();
  }

  function read() {
    const channels = rows.map((row) => [row.key, row.read()]).filter(([, source]) => source !== null);
    return { channels: Object.fromEntries(channels), times: time.read() };
  }

  function report() {
    changed(read());
  }

  function show(channels, warnings = {}) {
    for (const row of rows) row.show(channels[row.key], warnings[row.key]);
    const used = rows.map((row) => row.read()?.signal).filter(Boolean);
    time.show(new Set(used.map(groupOf)));
  }

  function groupOf(name) {
    const signal = contents.signals.find((candidate) => candidate.name === name);
    return contents.groups[signal?.group ?? 0]?.name;
  }

  return { element, read, show };
}
