/**
 * A recipe to read: every parameter with its unit, as the catalog calls it.
 *
 * Exports
 *   recipeTable(schema, plain, catalog) -> <dl>       nested objects and families indented
 *   rawRecipe(title, plain) -> <details>              the JSON, as the server takes it
 */

import { aircraftCondition, choiceName, labelOf } from "../lib/catalog.js";
import { formatted, h } from "../lib/dom.js";
import { figure } from "../lib/numbers.js";
import { magnitudeIn } from "../lib/units.js";

export function recipeTable(schema, plain, catalog) {
  return h(
    "dl",
    { class: "recipe" },
    Object.entries(schema.properties)
      .filter(([key]) => key in plain)
      .flatMap(([key, property]) => row(key, property, plain[key], catalog)),
  );
}

function row(key, property, value, catalog) {
  const { text, symbol, unit } = labelOf(key, property, catalog);
  const term = h("dt", {}, formatted(text), symbol ? [" ", formatted(symbol)] : null);
  const family = catalog.families[property["x-family"]];
  if (family) {
    const entry = family.entries[value.kind];
    const { kind, ...parameters } = value;
    const name = Object.fromEntries(
      Object.entries(parameters).filter(([, parameter]) => parameter !== kind),
    );
    const inner =
      entry && Object.keys(name).length ? recipeTable(entry.schema, name, catalog) : null;
    return [h("dt", {}, family.label), h("dd", {}, nameOf(entry, property) ?? kind.replaceAll("_", " "), inner)];
  }
  if (property.properties) {
    const told = Object.entries(value ?? {}).filter(
      ([, parameter]) => parameter !== null && parameter !== 0,
    );
    return [
      term,
      h("dd", {}, told.length ? recipeTable(property, Object.fromEntries(told), catalog) : "none"),
    ];
  }
  const channel = catalog.channels.find((known) => known.key === key);
  if (channel && typeof value === "number")
    return [term, h("dd", {}, magnitudeIn(channel, value))];
  if (property.enum) return [term, h("dd", {}, choiceName(property, value))];
  return [term, h("dd", {}, words(value), unit && value !== null ? ` ${unit}` : "")];
}

function nameOf(entry, property) {
  return entry && (property["x-family"] === "aircraft" ? aircraftCondition(entry) : entry.label);
}

function words(value) {
  if (value === null) return "none";
  if (typeof value === "number")
    return Number.isInteger(value) ? value.toLocaleString("en") : figure(value, 6);
  if (Array.isArray(value) && !value.length) return "none";
  if (Array.isArray(value)) return JSON.stringify(value).replaceAll(",", ", ");
  if (typeof value === "object")
    return Object.entries(value)
      .map(([name, part]) => `${name} ${figure(part)}`)
      .join(", ");
  return String(value).replaceAll("_", " ");
}

export function rawRecipe(title, plain) {
  return h(
    "details",
    { class: "fold" },
    h("summary", {}, title),
    h("pre", { class: "json", tabindex: 0 }, JSON.stringify(plain, null, 1)),
  );
}
