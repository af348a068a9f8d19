/**
 * A recipe's form, built from the catalog's JSON schema.
 *
 * createFields(schema, initial, {catalog, path, hidden, unfolded}) -> Fields
 *     initial: the recipe as plain data; missing values are the schema's defaults.
 *     path: the server's name for it ("dataset", "monitor").   hidden: keys left out of the form.
 *     unfolded: objects shown open as a fieldset.
 * Fields: element(key), keys, read() -> plain data, check() -> bool, editors (Map path -> Field, of those shown),
 *     put(key, value) shows another value of a family's member or of an object
 */

import { ApiError } from "../lib/api.js";
import { aircraftCondition, labelOf, plainWords } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { fold, parsedJson, pasteBox, select } from "./controls.js";
import { beyondTitle, editorOf } from "./field_editors.js";

const NEEDED = ["a", "b", "c", "d", "uncertainty"];
const KNOWN = [...NEEDED, "states", "altitude_m", "airspeed_mps"];
const EXAMPLE = '{"A": [[...]], "B": [[...]], "C": [[...]], "D": [[...]], "uncertainty": {"spread": 0.1}}';

export function createFields(schema, initial, { catalog, path, hidden = [], unfolded = [] }) {
  const editors = new Map();
  const root = objectParts(schema, initial ?? {}, { catalog, path, editors, unfolded }, hidden);
  return {
    element: (key) => root.parts.get(key).element,
    keys: [...root.parts.keys()],
    read: root.read,
    check,
    editors,
    put: (key, value) => root.parts.get(key).put(value),
  };

  function check() {
    const shown = [...editors.values()].filter(({ element }) => element.isConnected);
    const wrong = shown.filter((editor) => !editor.check());
    wrong[0]?.focus();
    return wrong.length === 0;
  }
}

/** Editors of an object's properties: {parts: Map key -> part, read()}. */
function objectParts(schema, value, place, hidden = []) {
  const parts = new Map();
  const hiddenValues = {};
  for (const [key, property] of Object.entries(schema.properties)) {
    const given = key in value ? value[key] : property.default;
    if (hidden.includes(key)) hiddenValues[key] = given;
    else parts.set(key, part(key, property, given, { ...place, path: `${place.path}.${key}` }));
  }
  const read = () => ({
    ...hiddenValues,
    ...Object.fromEntries([...parts].map(([key, editor]) => [key, editor.read()])),
  });
  return { parts, read };
}

function part(key, schema, value, place) {
  if (schema["x-family"]) return family(key, schema, value, place);
  if (schema.properties) return group(key, schema, value, place);
  return editorOf(key, schema, value, place);
}

const isFold = (element) => element.matches("details");

/** A nested object: folded, since its numbers seldom change; an open one is a fieldset. */
function group(key, schema, value, place) {
  const { text } = labelOf(key, schema, place.catalog);
  const grid = h("div.field-grid");
  const folds = h("div");
  const content = [h("p.hint", beyondTitle(schema)), grid, folds];
  const isOpen = place.unfolded?.includes(key);
  const element = isOpen ? h("fieldset", h("legend", text), content) : fold(text, content);
  element.dataset.path = place.path;
  let inner;
  put(value ?? {});
  return { element, read: () => inner.read(), put };

  function put(values) {
    inner = objectParts(schema, values, place);
    const elements = [...inner.parts.values()].map((editor) => editor.element);
    grid.replaceChildren(...elements.filter((editor) => !isFold(editor)));
    folds.replaceChildren(...elements.filter(isFold));
  }
}

function family(key, schema, value, place) {
  const { label, entries } = place.catalog.families[schema["x-family"]];
  const isAircraft = schema["x-family"] === "aircraft";
  const kinds = schema.properties?.kind?.enum ?? Object.keys(entries); // a test may have fewer members than its family
  const choice = select(
    kinds.map((kind) => entries[kind]).map((entry) => [entry.kind, isAircraft ? aircraftCondition(entry) : entry.label]),
    { "aria-label": label, name: `${place.path}.kind`, onchange: () => turn(choice.value) },
  );
  choice.hidden = kinds.length === 1;
  const words = h("p.hint");
  const holder = h("div.stack-tight");
  const element = h("fieldset", { "data-path": place.path }, h("legend", label), h("div.field", choice, words), holder);
  let inner;
  turn(value?.kind ?? schema.default.kind, value);
  return { element, read: () => ({ kind: choice.value, ...inner.read() }), put };

  function put({ kind, ...given }) {
    turn(kind, { ...entries[kind].default, ...given });
  }

  function turn(kind, given = schema.default.kind === kind ? schema.default : entries[kind].default) {
    choice.value = kind;
    words.textContent = plainWords(entries[kind].description);
    for (const path of [...place.editors.keys()])
      if (path.startsWith(`${place.path}.`)) place.editors.delete(path);
    const { properties } = entries[kind].schema;
    // a published aircraft's `name` is its kind again
    const hidden = Object.keys(properties).filter((name) => entries[kind].default[name] === kind);
    inner = objectParts(narrowed(entries[kind].schema, schema.properties), given, place, hidden);
    const { own, shared, folds } = sorted([...inner.parts], Object.values(entries));
    const parts = [
      isAircraft && "a" in properties && modelInput((model) => turn(kind, { ...inner.read(), ...model })),
      own.length && h("div.field-grid", own),
      shared,
      ...folds,
    ];
    holder.replaceChildren(...parts.filter(Boolean));
  }
}

/** A member's schema with the choices that a test has of its parameters. */
function narrowed({ properties, ...schema }, choices = {}) {
  const withFewer = ([name, property]) => {
    if (!choices[name]?.enum || !property.enum) return [name, property];
    const kept = property.enum.map((value, k) => [value, property["x-labels"][k]]).filter(([value]) => choices[name].enum.includes(value));
    return [name, { ...property, enum: kept.map(([value]) => value), "x-labels": kept.map(([, words]) => words) }];
  };
  return { ...schema, properties: Object.fromEntries(Object.entries(properties).map(withFewer)) };
}

/** A member's own parameters first; those that every member has are folded where they are many. */
function sorted(parts, members) {
  const elementsOf = (some) => some.map(([, { element }]) => element);
  const fields = parts.filter(([, { element }]) => !isFold(element));
  const common = fields.filter(([key]) => members.length > 1 && members.every(({ schema }) => key in schema.properties));
  const many = common.length > 2 ? common : [];
  const titles = many.map(([key]) => members[0].schema.properties[key].title);
  return {
    own: elementsOf(fields.filter((field) => !many.includes(field))),
    shared: many.length ? fold(titles.join(", "), h("div.field-grid", elementsOf(many))) : null,
    folds: elementsOf(parts).filter(isFold),
  };
}

function modelInput(use) {
  const box = pasteBox({
    label: "your own model as JSON",
    fileLabel: "your own model as a file",
    hint: "Paste the model as JSON, or choose a file; its numbers then appear below.",
    example: EXAMPLE,
    word: "Use this model",
    use: (text) => use(modelOf(text)),
  });
  return h("div.field.model-input", box);
}

/** The user's own linear model, with its keys in small letters. ApiError. */
function modelOf(text) {
  const refused = (words) => new ApiError(words, 422);
  const plain = parsedJson(text, (error) => `Not JSON (${error.message}): write it like ${EXAMPLE}.`);
  const entries = Object.entries(plain ?? {}).filter(([key]) => key !== "kind");
  const model = { states: [], ...Object.fromEntries(entries.map(([key, value]) => [key.toLowerCase(), value])) };
  const missing = NEEDED.filter((key) => !(key in model)).map((key) => (key.length > 1 ? key : key.toUpperCase()));
  const strange = Object.keys(model).filter((key) => !KNOWN.includes(key));
  if (missing.length) throw refused(`The model lacks ${missing.join(", ")}: it needs A, B, C, D and uncertainty.`);
  if (strange.length) throw refused(`The model has unknown keys: ${strange.join(", ")}. Leave them out.`);
  return model;
}
