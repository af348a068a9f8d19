/**
 * Use a mapping file of the command line instead of mapping row by row.
 *
 * Exports
 *   createMappingFile({use}) -> element     use(mapping) -> Promise; rejects if the mapping cannot be used
 *   readMapping(text) -> mapping            without empty entries; throws an ApiError
 */

import { ApiError, reason } from "../../lib/api.js";
import { h } from "../../lib/dom.js";
import { button, errorLine } from "../../lib/view_states.js";

const NO_MAPPING = "This is not a mapping: give the mapping.json that the command line writes.";

export function createMappingFile({ use }) {
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
      await read();
    },
  });
  return h(
    "details",
    { class: "fold map-file", "data-keeps-input": true },
    h("summary", {}, "use a mapping file"),
    h("p", { class: "hint" }, "Choose a mapping.json, or paste its content."),
    h("div", { class: "field" }, file, text),
    h("div", { class: "row map-add" }, button("Use this mapping", read), problem.element),
  );

  async function read() {
    problem.show("");
    try {
      await use(readMapping(text.value));
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
    throw new ApiError(NO_MAPPING, 422);
  }
  const mapping = plain?.mapping ?? plain;
  if (!mapping?.channels && !mapping?.times) throw new ApiError(NO_MAPPING, 422);
  return mapping;
}

function filled(entries, by) {
  return Object.fromEntries(Object.entries(entries).filter(([, source]) => source && by(source)));
}
