/**
 * The mapping of a recording: the table, its problems, and the button that confirms it.
 *
 * known: names of aircraft.   monitors: to map for one of them.   bins: of the preview
 * confirmed(recording)   the server has stored it
 * previewed({channels, quality, problem}, edited)   at first, and after each correction
 */

import { checkbox, parsedJson, pasteBox, select, textInput } from "../../forms/controls.js";
import { ApiError, needs, reason } from "../../lib/api.js";
import { button, chip, errorLine, guideLink, h } from "../../lib/dom.js";
import { counted } from "../../lib/numbers.js";
import { knownNames } from "../drop_zone.js";
import { mappingState } from "../words.js";
import { changedChannels } from "./changes.js";
import { createMappingTable } from "./table.js";

const REST = 250; // [ms] from the last correction to its preview
const NO_MAPPING = "This is not a mapping: give the mapping.json that the command line writes.";

export function createMappingSection({ api, catalog, recording, known, monitors, bins, previewed, confirmed }) {
  const path = `/recordings/${recording.id}`;
  let timer = 0;
  let turn = 0;
  let closed = false;
  let edited = false;
  let given = recording;
  let table = createMappingTable({ catalog, recording, changed: previewLater });
  const shown = h("div", table.element);
  const problem = errorLine();
  const names = knownNames("map-known-aircraft", known);
  const aircraft = textInput({ id: "map-aircraft", ...names.attributes, value: recording.aircraft ?? "", oninput: adapt });
  const remember = checkbox({ id: "map-remember", checked: true });
  const rememberWords = h("span");
  const isAgain = recording.mapping_state === "confirmed";
  const look = { class: "button button-primary", ...needs("PUT /recordings/{}/mapping") };
  const confirm = button(isAgain ? "Confirm the change" : "Confirm the mapping", put, look);
  const { word, level, text } = mappingState(recording);
  const file = pasteBox({
    label: "mapping as text",
    fileLabel: "mapping file",
    hint: "Choose a mapping.json, or paste its content.",
    example: '{"channels": {"beta": {"signal": …',
    word: "Use this mapping",
    use: (text) => use(readMapping(text)),
  });
  const summary = [h("h2.panel-title", "Mapping"), chip(word, level), h("span.dim", summaryOf(recording, text))];
  const target = select([["", "this file"], ...monitors.map(({ id, name }) => [id, name])], { id: "map-monitor", onchange: mapFor });
  const element = h(
    "details.panel.stack.mapping",
    { open: !isAgain, "data-keeps-input": true },
    h("summary.step-title", summary),
    monitors.length ? h("div.row", h("label", { for: "map-monitor" }, "Channels of"), h("div.field", target)) : null,
    shown,
    h("details.fold.map-file", { "data-keeps-input": true }, h("summary", "use a mapping file"), file),
    problem.element,
    h(
      "div.row.map-end",
      guideLink("first-recording#mapping", "mapping"),
      h("label", { for: "map-aircraft" }, "Aircraft"),
      h("div.field", aircraft, names.element),
      h("label.radio", remember, rememberWords),
      h("span.spread", confirm),
    ),
  );
  adapt();
  preview(table.read());
  return { element, close };

  function close() {
    closed = true;
    clearTimeout(timer);
  }

  function adapt() {
    const name = aircraft.value.trim();
    remember.disabled = !name;
    rememberWords.textContent = name
      ? `Remember for ${name}`
      : "Not remembered: enter the aircraft to have this mapping proposed next time";
  }

  async function use(mapping) {
    await api.post(`${path}/preview`, { mapping, bins });
    if (closed) return;
    showTable({ ...given, mapping, rates: {}, mapping_state: "given", rationales: {}, mapping_notes: [] });
    edited = true;
    await preview(mapping);
  }

  /** Shows the channels of the chosen monitor, with a proposal for those that have no signal yet. */
  async function mapFor() {
    const id = target.value;
    try {
      const proposed = id ? await api.get(`${path}?monitor=${id}`) : recording;
      if (closed || id !== target.value) return;
      const mapping = edited ? merged(proposed.mapping, table.read()) : proposed.mapping;
      showTable({ ...proposed, mapping });
      edited ||= changedChannels(recording.mapping, mapping).length > 0;
      await preview(mapping);
    } catch (error) {
      if (!closed) showProblem(reason(error));
    }
  }

  function showTable(next) {
    clearTimeout(timer);
    given = next;
    table = createMappingTable({ catalog, recording: given, changed: previewLater });
    shown.replaceChildren(table.element);
  }

  function previewLater(mapping) {
    edited = true;
    clearTimeout(timer);
    timer = setTimeout(() => preview(mapping), REST);
  }

  async function preview(mapping) {
    const mine = ++turn;
    try {
      const answer = await api.post(`${path}/preview`, { mapping, bins });
      if (mine !== turn || closed) return;
      const { channels, warnings } = answer;
      table.show(channels, warnings);
      showProblem(answer.problem);
      previewed(answer, edited);
    } catch (error) {
      if (mine === turn && !closed) showProblem(reason(error));
    }
  }

  function showProblem(words) {
    problem.show(words ?? "");
    confirm.disabled = Boolean(words);
  }

  async function put() {
    clearTimeout(timer);
    confirm.disabled = true;
    const name = aircraft.value.trim();
    const isRemembered = remember.checked && !remember.disabled;
    try {
      const body = { mapping: table.read(), remember: isRemembered, ...(name && { aircraft: name }) };
      confirmed(await api.put(`${path}/mapping`, body));
    } catch (error) {
      showProblem(reason(error));
      confirm.disabled = false;
    }
  }
}

function merged(proposed, now) {
  return { channels: { ...proposed.channels, ...now.channels }, times: { ...proposed.times, ...now.times } };
}

function summaryOf({ mapping, missing, targets }, text) {
  const sources = Object.values(mapping.channels);
  const derived = sources.filter(({ derivation }) => derivation).length;
  const parts = [text, counted(sources.length, "channel")];
  if (derived) parts.push(`${derived} derived`);
  const labels = targets.filter(({ key }) => missing.includes(key)).map(({ label }) => label);
  if (labels.length) parts.push(`without ${labels.join(", ")}`);
  return parts.filter(Boolean).join(", ");
}

/** A mapping without empty entries. ApiError. */
function readMapping(text) {
  const plain = parsedJson(text, () => NO_MAPPING);
  const mapping = plain?.mapping ?? plain;
  if (!mapping?.channels && !mapping?.times) throw new ApiError(NO_MAPPING, 422);
  return {
    channels: filled(mapping.channels ?? {}, ({ signal, derivation }) => signal || derivation),
    times: filled(mapping.times ?? {}, ({ signal, rate }) => signal || rate),
  };
}

function filled(entries, by) {
  return Object.fromEntries(Object.entries(entries).filter(([, source]) => source && by(source)));
}
