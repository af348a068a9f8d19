/**
 * Which signal of a file is which channel, with a preview of the mapped data.
 *
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
  const { mapping, contents, rationales, alternatives, derivable, mapping_state: state } = recording;
  const { targets, time_units: units } = catalog.telemetry;
  const time = createTimeRows({ times: mapping.times, rates: recording.rates, contents, rationales, units, changed: report });
  const rows = targets.map((target) =>
    createMappingRow({
      target,
      source: mapping.channels[target.key] ?? null,
      contents,
      rationale: rationales[target.key],
      likely: alternatives[target.key] ?? [],
      derivable: derivable[target.key] ?? [],
      state,
      over: recording.confirmed_over?.[target.key] ?? [],
      needed: recording.missing.includes(target.key),
      changed: report,
    }),
  );
  const measured = new Set(catalog.channels.map(({ key }) => key));
  const others = rows.filter(({ key }) => !measured.has(key));
  const mapped = others.filter((row) => row.read() !== null);
  const listOf = (some) => h("ul.map-rows", some.map((row) => row.element));
  const more = listOf(mapped);
  const unmapped = others.filter((row) => !mapped.includes(row));
  const labels = new Map(targets.map(({ key, label }) => [key, label]));
  const another = select([["", "Map another quantity"], ...unmapped.map(({ key }) => [key, labels.get(key)])], {
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
    listOf(rows.filter((row) => !others.includes(row))),
    h(
      "details.fold.map-more",
      { open: state !== "confirmed" },
      h("summary", `attitude, airspeed, altitude and others: ${mapped.length} mapped`),
      h(
        "p.hint",
        "Attitude turns the aircraft in the scene. Airspeed is checked against the monitor's flight condition. Missing channels can be derived from these quantities.",
      ),
      more,
      h("div.row.map-add", another),
    ),
  );
  show({});

  function addAnother() {
    const row = others.find(({ key }) => key === another.value);
    if (!row) return;
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
