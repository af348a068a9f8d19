/**
 * A recipe's form, built from the catalog's JSON schema.
 *
 * Exports
 *   createFields(schema, initial, {catalog, path, hidden, unfolded}) -> Fields
 *     initial: the recipe as plain data; missing values are the schema's defaults.
 *     path: the server's name for it ("dataset", "monitor").   hidden: keys left out of the form.
 *     unfolded: objects shown open as a fieldset.
 *
 * Fields
 *   element(key)          the editor of one parameter, to be placed; a family's or an object's is
 *                         a fieldset with its parameters
 *   keys                  of all parameters, in the schema's order
 *   read() -> plain data, check() -> bool (shows reasons beside the fields, moves to the first)
 *   point(message)        shows the server's reason beside the field that it names, if any
 *   put(key, value)       shows another value of a family's member or of an object
 *   fields dispatch `change` and `input` events, which bubble
 */

import { aircraftCondition, labelOf, plainWords } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { beyondTitle, editorOf } from "./field_editors.js";
import { createModelInput } from "./model_input.js";

export function createFields(schema, initial, { catalog, path, hidden = [], unfolded = [] }) {
  const editors = new Map();
  const root = objectParts(schema, initial ?? {}, { catalog, path, editors, unfolded }, hidden);
  return {
    element: (key) => root.parts.get(key).element,
    keys: [...root.parts.keys()],
    read: root.read,
    check,
    point,
    put: (key, value) => root.parts.get(key).put(value),
  };

  function check() {
    const wrong = [...editors.values()].filter(
      (editor) => editor.element.isConnected && !editor.check(),
    );
    wrong[0]?.focus();
    return wrong.length === 0;
  }

  function point(message) {
    const named = message.charAt(0).toLowerCase() + message.slice(1);
    const fits = [...editors.keys()].filter((key) =>
      new RegExp(`^${key.replaceAll(".", "\\.")}\\b`).test(named),
    );
    const longest = fits.sort((a, b) => b.length - a.length)[0];
    if (!longest) return false;
    editors.get(longest).say(message);
    editors.get(longest).focus();
    return true;
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

/** A nested object: folded, since its numbers seldom change; an open one is a fieldset. */
function group(key, schema, value, place) {
  const { text } = labelOf(key, schema, place.catalog);
  const isOpen = place.unfolded?.includes(key);
  const grid = h("div", { class: "field-grid" });
  const folds = h("div", {});
  let inner;
  put(value ?? {});
  const words = h("p", { class: "hint" }, beyondTitle(schema));
  const element = isOpen
    ? h("fieldset", { "data-path": place.path }, h("legend", {}, text), words, grid, folds)
    : h("details", { class: "fold", "data-path": place.path }, h("summary", {}, text), words, grid, folds);
  return { element, read: () => inner.read(), put };

  function put(values) {
    inner = objectParts(schema, values, place);
    const elements = [...inner.parts.values()].map(({ element }) => element);
    const isFold = (element) => element.matches("details");
    grid.replaceChildren(...elements.filter((element) => !isFold(element)));
    folds.replaceChildren(...elements.filter(isFold));
  }
}

/** A family: its members by kind, and the parameters of the one chosen. */
function family(key, schema, value, place) {
  const { label, entries } = place.catalog.families[schema["x-family"]];
  const isAircraft = schema["x-family"] === "aircraft";
  const first = value?.kind ?? schema.default.kind;
  const select = h(
    "select",
    {
      "aria-label": label,
      name: `${place.path}.kind`,
      onchange: (event) => turn(event.target.value),
    },
    Object.values(entries).map((entry) =>
      h("option", { value: entry.kind }, isAircraft ? aircraftCondition(entry) : entry.label),
    ),
  );
  const words = h("p", { class: "hint" });
  const holder = h("div", { class: "stack-tight" });
  const element = h(
    "fieldset",
    { "data-path": place.path },
    h("legend", {}, label),
    h("div", { class: "field" }, select, words),
    holder,
  );
  let inner;
  turn(first, value);
  return { element, read: () => ({ kind: select.value, ...inner.read() }), put };

  function put({ kind, ...given }) {
    turn(kind, { ...entries[kind].default, ...given });
  }

  function turn(
    kind,
    given = schema.default.kind === kind ? schema.default : entries[kind].default,
  ) {
    select.value = kind;
    words.textContent = plainWords(entries[kind].description);
    for (const path of [...place.editors.keys()])
      if (path.startsWith(`${place.path}.`)) place.editors.delete(path);
    // a published aircraft's `name` is its kind again
    const hidden = Object.keys(entries[kind].schema.properties).filter(
      (name) => entries[kind].default[name] === kind,
    );
    inner = objectParts(entries[kind].schema, given, place, hidden);
    const { own, shared, folds } = sorted([...inner.parts], entries);
    const model =
      "a" in inner.read() && isAircraft
        ? createModelInput((model) => turn(kind, { ...inner.read(), ...model }))
        : null;
    holder.replaceChildren(
      ...[
        model,
        own.length ? h("div", { class: "field-grid" }, own) : null,
        shared,
        ...folds,
      ].filter(Boolean),
    );
  }
}

/** A member's own parameters first; those that every member has are folded where they are many. */
function sorted(parts, entries) {
  const members = Object.values(entries);
  const folds = parts
    .filter(([, { element }]) => element.matches("details"))
    .map(([, { element }]) => element);
  const fields = parts.filter(([, { element }]) => !element.matches("details"));
  const common = fields.filter(
    ([key]) => members.length > 1 && members.every(({ schema }) => key in schema.properties),
  );
  const many = common.length > 2 ? common : [];
  const titles = many.map(([key]) => members[0].schema.properties[key].title);
  const words = titles.join(", ");
  const shared = many.length
    ? h(
        "details",
        { class: "fold" },
        h("summary", {}, words),
        h(
          "div",
          { class: "field-grid" },
          many.map(([, { element }]) => element),
        ),
      )
    : null;
  return {
    own: fields.filter((field) => !many.includes(field)).map(([, { element }]) => element),
    shared,
    folds,
  };
}
