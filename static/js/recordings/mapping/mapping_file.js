/**
 * A mapping file, as the command line writes it: chosen or pasted instead of mapping row by row.
 *
 * Exports
 *   createMappingFile({take}) -> element     take(mapping): tries it; throws what is wrong with it
 *   readMapping(text) -> mapping             without entries that are not filled in; throws an Error
 */

import { reason } from "../../lib/api.js";
import { h } from "../../lib/dom.js";
import { button, errorLine } from "../../lib/view_states.js";

const NO_MAPPING = "It is no mapping: give the mapping.json that the command line writes.";

export function createMappingFile({ take }) {
  const problem = errorLine();
  const text = h("textarea", {
    rows: 4,
    spellcheck: false,
    "aria-label": "mapping as text",
    placeholder: '{"channels": {"beta": {"signal": …',
  });
  const file = h("input", {
    type: "file",
    accept: ".json,application/json",
    "aria-label": "mapping file",
    onchange: async () => {
      if (!file.files.length) return;
      text.value = await file.files[0].text();
      file.value = "";
      await use();
    },
  });
  return h(
    "details",
    { class: "fold map-file", "data-keeps-input": true },
    h("summary", {}, "use a mapping file"),
    h("p", { class: "hint" }, "Choose a mapping.json, or paste what it holds."),
    h("div", { class: "field" }, file, text),
    h("div", { class: "row map-add" }, button("Use this mapping", use), problem.element),
  );

  async function use() {
    problem.show("");
    try {
      await take(readMapping(text.value));
    } catch (error) {
      problem.show(reason(error));
    }
  }
}

export function readMapping(text) {
  const { channels = {}, times = {} } = parsed(text);
  return {
    channels: filled(channels, ({ signal, derivation }) => signal || derivation),
    times: filled(times, ({ signal, rate }) => signal || rate),
  };
}

function parsed(text) {
  let plain;
  try {
    plain = JSON.parse(text);
  } catch {
    throw new Error(NO_MAPPING);
  }
  const mapping = plain?.mapping ?? plain;
  if (!mapping?.channels && !mapping?.times) throw new Error(NO_MAPPING);
  return mapping;
}

function filled(entries, by) {
  return Object.fromEntries(Object.entries(entries).filter(([, source]) => source && by(source)));
}
