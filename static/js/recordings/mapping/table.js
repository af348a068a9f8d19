/**
 * Which signal of a file is which channel, with a preview of the mapped data.
 *
 * Exports
 *   createMappingTable({catalog, recording, changed}) -> {element, read() -> mapping, show(channels, warnings)}
 *     changed(mapping)   after each correction.   channels: {key: tiles} of a preview.
 *     warnings: {key: [sentence]}
 */

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
  const { mapping, contents, rationales, alternatives, derivable } = recording;
  const measured = new Set(catalog.channels.map(({ key }) => key));
  const time = createTimeRows({
    times: mapping.times,
    contents,
    rationales,
    units: catalog.telemetry.time_units,
    changed: report,
  });
  const rows = catalog.telemetry.targets.map((target) =>
    createMappingRow({
      target,
      source: mapping.channels[target.key] ?? null,
      contents,
      rationale: rationales[target.key],
      likely: alternatives[target.key] ?? [],
      derivable: derivable[target.key] ?? [],
      state: recording.mapping_state,
      over: recording.confirmed_over?.[target.key] ?? [],
      needed: recording.missing.includes(target.key),
      changed: report,
    }),
  );
  const main = rows.filter(({ key }) => measured.has(key));
  const others = rows.filter(({ key }) => !measured.has(key));
  const mapped = others.filter((row) => row.read() !== null);
  const more = h(
    "ul",
    { class: "map-rows" },
    mapped.map((row) => row.element),
  );
  const another = h(
    "select",
    { class: "map-another", "aria-label": "map another quantity", onchange: addAnother },
    h("option", { value: "" }, "Map another quantity"),
    catalog.telemetry.targets
      .filter(({ key }) => others.some((row) => row.key === key && !mapped.includes(row)))
      .map(({ key, label }) => h("option", { value: key }, label)),
  );
  const head = h(
    "div",
    { class: "map-head", "aria-hidden": true },
    HEADS.map(([part, words]) => h("span", { class: `map-${part}` }, words)),
  );
  const element = h(
    "div",
    { class: "map-table" },
    head,
    time.element,
    h(
      "ul",
      { class: "map-rows" },
      main.map((row) => row.element),
    ),
    h(
      "details",
      { class: "fold map-more", open: recording.mapping_state !== "confirmed" },
      h("summary", {}, `attitude, airspeed, altitude and others: ${mapped.length} mapped`),
      h(
        "p",
        { class: "hint" },
        "Attitude turns the aircraft in the scene. Airspeed is checked against the monitor's flight condition. Missing channels can be derived from these quantities.",
      ),
      more,
      h("div", { class: "row map-add" }, another),
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
    const channels = rows
      .map((row) => [row.key, row.read()])
      .filter(([, source]) => source !== null);
    return { channels: Object.fromEntries(channels), times: time.read() };
  }

  function report() {
    changed(read());
  }

  function show(channels, warnings = {}) {
    for (const row of rows) row.show(channels[row.key], warnings[row.key]);
    const groups = rows
      .map((row) => row.read()?.signal)
      .filter(Boolean)
      .map(groupOf);
    time.show(new Set(groups));
  }

  function groupOf(name) {
    const signal = contents.signals.find((candidate) => candidate.name === name);
    return contents.groups[signal?.group ?? 0]?.name;
  }

  return { element, read, show };
}
