/** A recipe to read: every parameter with its unit, as the catalog calls it; nested objects and families indented. */

import { aircraftCondition, channelOf, choiceName, labelOf } from "../lib/catalog.js";
import { formatted, h, recipeList } from "../lib/dom.js";
import { figure, magnitudeIn, trueMinus } from "../lib/numbers.js";
import { fold } from "./controls.js";

export function recipeTable(schema, plain, catalog) {
  const known = Object.entries(schema.properties).filter(([key]) => key in plain);
  return recipeList(known.map(([key, property]) => row(key, property, plain[key], catalog)));
}

function row(key, property, value, catalog) {
  const { text, symbol, unit } = labelOf(key, property, catalog);
  const term = [formatted(text), symbol && [" ", formatted(symbol)]];
  const family = catalog.families[property["x-family"]];
  if (family) return [family.label, memberOf(family, property, value, catalog)];
  if (property.properties) {
    const given = Object.entries(value ?? {}).filter(([, parameter]) => parameter !== null && parameter !== 0);
    return [term, given.length ? recipeTable(property, Object.fromEntries(given), catalog) : "none"];
  }
  const channel = channelOf(key, property, catalog);
  if (channel && typeof value === "number") return [term, magnitudeIn(channel, value)];
  if (property.enum) return [term, choiceName(property, value)];
  return [term, [words(value), unit && value !== null ? ` ${unit}` : ""]];
}

function memberOf({ entries }, property, { kind, ...parameters }, catalog) {
  const entry = entries[kind];
  if (!entry) return kind.replaceAll("_", " ");
  const own = Object.entries(parameters).filter(([, parameter]) => parameter !== kind);
  const name = property["x-family"] === "aircraft" ? aircraftCondition(entry) : entry.label;
  return [name, own.length ? recipeTable(entry.schema, Object.fromEntries(own), catalog) : null];
}

function words(value) {
  if (value === null) return "none";
  if (typeof value === "number")
    return trueMinus(Number.isInteger(value) ? value.toLocaleString("en") : figure(value, 6));
  if (Array.isArray(value)) return value.length ? trueMinus(JSON.stringify(value).replaceAll(",", ", ")) : "none";
  if (typeof value === "object")
    return Object.entries(value).map(([name, part]) => `${name} ${figure(part)}`).join(", ");
  return String(value).replaceAll("_", " ");
}

export function rawRecipe(plain) {
  return fold("Recipe as JSON", h("pre.json", { tabindex: 0 }, JSON.stringify(plain, null, 1)));
}
