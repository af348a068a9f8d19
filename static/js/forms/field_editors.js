/**
 * Editors of single parameters from JSON schema: number, choice, text, JSON, map of numbers.
 *
 * editorOf(key, schema, value, place) -> Field with read() -> the value as the server wants it, and check() -> bool
 *     place: {path, catalog, editors}; every editor enters itself in `editors` by its path
 */

import { channelOf, choiceName, labelOf, plainWords } from "../lib/catalog.js";
import { formatted, h, put } from "../lib/dom.js";
import { capital, followUnits, rounded, shownIn } from "../lib/numbers.js";
import { checkbox, fieldOf, select, textInput } from "./controls.js";

export function editorOf(key, schema, value, place) {
  const types = (schema.anyOf ?? [schema]).map(({ type }) => type);
  const field = (control, read, wrong) => editor(key, schema, place, control, read, wrong);
  if (schema.enum) return choice(schema, value, field);
  if (types.includes("object")) return spread(value, field);
  if (types.includes("number") || types.includes("integer")) return number(key, schema, value, place, field);
  if (types[0] === "boolean") return simple(checkbox({ checked: Boolean(value) }), "checked", field);
  if (types[0] === "string") return simple(textInput({ value: value ?? "" }), "value", field);
  return json(value, field);
}

const simple = (control, property, field) => field(control, () => control[property]);

/** wrong() is what is wrong, or "". */
function editor(key, schema, place, control, read, wrong = () => "") {
  const { text, symbol } = labelOf(key, schema, place.catalog);
  control.name = place.path;
  const field = fieldOf(control, {
    label: [formatted(text), symbol ? [" ", formatted(symbol)] : null, unitOf(key, schema, place.catalog)],
    words: text,
    hint: symbol ? "" : firstSentence(beyondTitle(schema)), // a channel's label says it
    title: schema.description,
    path: place.path,
  });
  const made = { ...field, read, check };
  control.addEventListener("change", check);
  place.editors.set(place.path, made);
  return made;

  function check() {
    const reason = wrong();
    field.say(reason);
    return !reason;
  }
}

function unitOf(key, schema, catalog) {
  const words = h("span.unit");
  return followUnits(words, () => {
    const { unit } = labelOf(key, schema, catalog);
    put(words, unit && ` [${unit}]`);
  });
}

export function beyondTitle({ title, description = "" }) {
  const words = plainWords(description);
  const begins = words.toLowerCase().startsWith(title.toLowerCase());
  const rest = begins ? words.slice(title.length).replace(/^(\s*\[[^\]]+\])?[:;.\s]*/, "") : words;
  return capital(rest);
}

function firstSentence(words) {
  const [first] = words.split(/(?<=[^.]\.)\s|;\s/);
  return first.replace(/\.$/, "").replace(/\s*\[[^\]]+\]$/, "");
}

function number(key, schema, value, place, field) {
  const parts = schema.anyOf ?? [schema];
  const kind = parts.find(({ type }) => type === "number" || type === "integer");
  const isOptional = parts.some(({ type }) => type === "null");
  const isInteger = kind.type === "integer";
  const low = kind.minimum ?? schema.minimum;
  const high = kind.maximum ?? schema.maximum;
  const look = { inputmode: "decimal", placeholder: isOptional && "none" };
  const control = h("input", { type: "number", step: isInteger ? 1 : "any", min: low, max: high, ...look });
  const channel = channelOf(key, schema, place.catalog);
  let factor = 1;
  let shown = "";
  const read = () => {
    if (control.value.trim() === "") return null;
    return control.value === shown ? value : Number(control.value) / factor; // no digit is lost
  };
  const show = () => {
    factor = channel ? shownIn(channel).factor : 1;
    shown = String(value == null ? "" : isInteger ? value : rounded(value * factor));
    control.value = shown;
  };
  show();
  if (channel) control.dataset.units = "";
  control.addEventListener("units", () => {
    if (control.validity.badInput) return;
    value = read();
    show();
  });
  return field(control, read, () => {
    if (control.validity.badInput) return "Not a number: write digits, with a point for decimals.";
    if (read() === null) return isOptional ? "" : "Enter a number.";
    if (isInteger && !Number.isInteger(read())) return "Enter a whole number.";
    if (low !== undefined && read() < low) return `Must be at least ${low}.`;
    if (high !== undefined && read() > high) return `Must be at most ${high}.`;
    return "";
  });
}

function choice(schema, value, field) {
  const control = select(schema.enum.map((name) => [name, choiceName(schema, name)]), { value });
  return field(control, () => schema.enum.find((name) => String(name) === control.value));
}

function json(value, field) {
  const rows = Array.isArray(value) && Array.isArray(value[0]) ? value.length : 1;
  const control = h("textarea", { rows: Math.min(rows + 1, 8), spellcheck: "false", class: "json" });
  control.value = written(value);
  const parsed = () => {
    try {
      return JSON.parse(control.value);
    } catch {
      return undefined;
    }
  };
  return field(control, parsed, () => (parsed() === undefined ? "Not JSON: write it like [[1, 0], [0, 1]]." : "")); // the server judges its shape
}

function written(value) {
  if (!Array.isArray(value) || !Array.isArray(value[0])) return JSON.stringify(value);
  return `[${value.map((row) => JSON.stringify(row)).join(",\n ")}]`;
}

/** One number for all, or one for each name. */
function spread(value, field) {
  const byName = typeof value === "object" && value !== null ? value : {};
  const names = Object.keys(byName);
  const numeric = (attributes) => h("input", { type: "number", step: "any", ...attributes });
  const all = numeric({ min: 0, "aria-label": "one number for all", value: typeof value === "number" ? value : 0.1 });
  const inputs = names.map((name) => numeric({ "aria-label": name, value: byName[name] }));
  const symbolOf = (name) => formatted(name.replace("_beta", "_β").replace(/_d([ar])$/, "_δ$1"));
  const cells = names.map((name, k) => h("label.spread-cell", h("span", symbolOf(name)), inputs[k]));
  const table = h("div.spread-table", cells);
  const ways = [names.length && ["named", "one for each name"], ["all", "one number for all"]];
  const mode = select(ways, { value: names.length ? "named" : "all", onchange: turn });
  const isBad = (input) => input.value.trim() === "" || input.validity.badInput;
  const read = () =>
    mode.value === "all"
      ? Number(all.value)
      : Object.fromEntries(names.map((name, k) => [name, Number(inputs[k].value)]));
  const made = field(mode, read, () => {
    if (mode.value === "all") return isBad(all) ? "Enter a number." : "";
    const k = inputs.findIndex(isBad);
    return k >= 0 ? `${names[k]} needs a number; 0 if it is certain.` : "";
  });
  mode.after(all, table);
  turn();
  return made;

  function turn() {
    table.hidden = mode.value === "all";
    all.hidden = mode.value !== "all";
  }
}
