/**
 * Editors of single parameters from JSON schema: number, choice, text, JSON, map of numbers.
 *
 * Exports
 *   beyondTitle(schema) -> string     the description without its title
 *   editorOf(key, schema, value, place) -> Editor
 *     place: {path, catalog, editors}; every editor enters itself in `editors` by its path
 *
 * Editor
 *   element           a .field
 *   read()            the value as the server wants it
 *   check() -> bool   shows what is wrong beside the field
 *   say(text)         shows a reason there; empty takes it away
 *   focus()
 */

import { choiceName, labelOf, plainWords } from "../lib/catalog.js";
import { formatted, h, put } from "../lib/dom.js";
import { rounded } from "../lib/numbers.js";
import { followUnits, shownIn } from "../lib/units.js";

let fields = 0;

export function editorOf(key, schema, value, place) {
  const types = (schema.anyOf ?? [schema]).map(({ type }) => type);
  if (schema.enum) return choice(key, schema, value, place);
  if (types.includes("object")) return spread(key, schema, value, place);
  if (types.includes("number") || types.includes("integer"))
    return number(key, schema, value, place);
  if (types[0] === "boolean") return flag(key, schema, value, place);
  if (types[0] === "string") return words(key, schema, value, place);
  return json(key, schema, value, place);
}

/** Label, control, hint and error of one parameter; `wrong()` is what is wrong, or "". */
function field(key, schema, place, control, read, wrong = () => "") {
  const id = `field-${++fields}`;
  const { text, symbol } = labelOf(key, schema, place.catalog);
  const failure = h("p", { class: "error", id: `${id}-error`, hidden: true });
  const words = symbol ? "" : firstSentence(beyondTitle(schema)); // a channel's label says it
  const hint = h("p", { class: "hint", id: `${id}-hint`, title: schema.description }, words);
  control.id = id;
  control.name = place.path;
  control.setAttribute("aria-describedby", `${id}-hint ${id}-error`);
  const label = h(
    "label",
    { for: id },
    formatted(text),
    symbol ? [" ", formatted(symbol)] : null,
    unitOf(key, schema, place.catalog),
  );
  const element = h(
    "div",
    { class: "field", "data-path": place.path },
    label,
    control,
    hint,
    failure,
  );
  const say = (reason) => {
    failure.textContent = reason;
    failure.hidden = !reason;
    if (reason) control.setAttribute("aria-invalid", "true");
    else control.removeAttribute("aria-invalid");
  };
  const editor = {
    element,
    hint,
    read,
    say,
    check: () => {
      const reason = wrong();
      say(reason);
      return !reason;
    },
    focus: () => {
      for (
        let outer = element.closest("details");
        outer;
        outer = outer.parentElement.closest("details")
      )
        outer.open = true;
      control.focus();
    },
  };
  control.addEventListener("change", () => editor.check());
  place.editors.set(place.path, editor);
  return editor;
}

function unitOf(key, schema, catalog) {
  const words = h("span", { class: "unit" });
  return followUnits(words, () => {
    const { unit } = labelOf(key, schema, catalog);
    put(words, unit && ` [${unit}]`);
  });
}

export function beyondTitle({ title, description = "" }) {
  const words = plainWords(description);
  const begins = words.toLowerCase().startsWith(title.toLowerCase());
  const rest = begins ? words.slice(title.length).replace(/^(\s*\[[^\]]+\])?[:;.\s]*/, "") : words;
  return rest.charAt(0).toUpperCase() + rest.slice(1);
}

function firstSentence(words) {
  return words
    .split(/(?<=[^.]\.)\s|;\s/)[0]
    .replace(/\.$/, "")
    .replace(/\s*\[[^\]]+\]$/, "");
}

function number(key, schema, value, place) {
  const parts = schema.anyOf ?? [schema];
  const kind = parts.find(({ type }) => type === "number" || type === "integer");
  const optional = parts.some(({ type }) => type === "null");
  const isInteger = kind.type === "integer";
  const low = kind.minimum ?? schema.minimum;
  const high = kind.maximum ?? schema.maximum;
  const control = h("input", {
    type: "number",
    step: isInteger ? 1 : "any",
    min: low,
    max: high,
    inputmode: "decimal",
    placeholder: optional ? "none" : null,
  });
  const channel = place.catalog.channels.find((known) => known.key === key);
  const converts = channel && schema["x-unit"] === channel.unit;
  let factor = 1;
  let shown = "";
  const read = () => {
    if (control.value.trim() === "") return null;
    return control.value === shown ? value : Number(control.value) / factor; // no digit is lost
  };
  const show = () => {
    factor = converts ? shownIn(channel).factor : 1;
    shown = String(value === null || value === undefined ? "" : converts ? rounded(value * factor) : value);
    control.value = shown;
  };
  show();
  if (converts) control.dataset.units = "";
  control.addEventListener("units", () => {
    if (control.validity.badInput) return;
    value = read();
    show();
  });
  return field(key, schema, place, control, read, () => {
    if (control.validity.badInput)
      return "Not a number: write digits, with a point for decimals.";
    if (read() === null) return optional ? "" : "Enter a number.";
    if (isInteger && !Number.isInteger(read())) return "Enter a whole number.";
    if (low !== undefined && read() < low) return `Must be at least ${low}.`;
    if (high !== undefined && read() > high) return `Must be at most ${high}.`;
    return "";
  });
}

function choice(key, schema, value, place) {
  const control = h(
    "select",
    {},
    schema.enum.map((name) => h("option", { value: name }, choiceName(schema, name))),
  );
  control.value = value;
  return field(key, schema, place, control, () =>
    schema.enum.find((name) => String(name) === control.value),
  );
}

function flag(key, schema, value, place) {
  const control = h("input", { type: "checkbox", checked: Boolean(value) });
  return field(key, schema, place, control, () => control.checked);
}

function words(key, schema, value, place) {
  const control = h("input", { type: "text", value: value ?? "" });
  return field(key, schema, place, control, () => control.value);
}

function json(key, schema, value, place) {
  const rows = Array.isArray(value) && Array.isArray(value[0]) ? value.length : 1;
  const control = h("textarea", {
    rows: Math.min(rows + 1, 8),
    spellcheck: "false",
    class: "json",
  });
  control.value = written(value);
  const parsed = () => {
    try {
      return JSON.parse(control.value);
    } catch {
      return undefined;
    }
  };
  const wrong = () => {
    if (parsed() === undefined) return "Not JSON: write it like [[1, 0], [0, 1]].";
    return fits(parsed(), schema) ? "" : `Enter ${needed(schema)}.`;
  };
  return field(key, schema, place, control, parsed, wrong);
}

function written(value) {
  if (!Array.isArray(value) || !Array.isArray(value[0])) return JSON.stringify(value);
  return `[${value.map((row) => JSON.stringify(row)).join(",\n ")}]`;
}

function fits(value, schema) {
  if (schema.type === "array")
    return Array.isArray(value) && value.every((item) => fits(item, schema.items ?? {}));
  if (schema.type === "number") return typeof value === "number";
  if (schema.type === "string") return typeof value === "string";
  return true;
}

function needed(schema) {
  if (schema.type === "array")
    return schema.items?.type === "array"
      ? "rows of numbers, [[...], [...]]"
      : `a list of ${schema.items?.type ?? "value"}s`;
  return `a ${schema.type}`;
}

/** One number for all, or one for each name. */
function spread(key, schema, value, place) {
  const byName = typeof value === "object" && value !== null ? { ...value } : {};
  const names = Object.keys(byName);
  const all = h("input", {
    type: "number",
    step: "any",
    min: 0,
    "aria-label": "one number for all",
  });
  const inputs = names.map((name) =>
    h("input", { type: "number", step: "any", "aria-label": name, value: byName[name] }),
  );
  const cells = names.map((name, k) =>
    h(
      "label",
      { class: "spread-cell" },
      h("span", {}, formatted(name.replace("_beta", "_β").replace(/_d([ar])$/, "_δ$1"))),
      inputs[k],
    ),
  );
  const table = h("div", { class: "spread-table" }, cells);
  const mode = h(
    "select",
    {},
    names.length ? h("option", { value: "named" }, "one for each name") : null,
    h("option", { value: "all" }, "one number for all"),
  );
  mode.value = names.length ? "named" : "all";
  all.value = typeof value === "number" ? value : 0.1;
  const turned = () => {
    table.hidden = mode.value === "all";
    all.hidden = mode.value !== "all";
  };
  const bad = (input) => input.value.trim() === "" || input.validity.badInput;
  const read = () =>
    mode.value === "all"
      ? Number(all.value)
      : Object.fromEntries(names.map((name, k) => [name, Number(inputs[k].value)]));
  const editor = field(key, schema, place, mode, read, () => {
    const k = inputs.findIndex(bad);
    if (mode.value === "all") return bad(all) ? "Enter a number." : "";
    return k >= 0 ? `${names[k]} needs a number; 0 if it is certain.` : "";
  });
  mode.after(all, table);
  mode.addEventListener("change", turned);
  turned();
  return editor;
}
