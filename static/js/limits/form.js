/**
 * Form of a limit set's next version: flight conditions, each with its limits.
 *
 * newest: the version to begin with; null for a new set, which also needs a name
 * route: its request; without permission for it the form is hidden.   send(version) -> Promise
 */

import { createForm, group, labelled, sharedField, textInput } from "../forms/controls.js";
import { createFields } from "../forms/form.js";
import { button, h } from "../lib/dom.js";

const NEW = { name: "", ranges: {}, limits: undefined };

export function createLimitForm({ catalog, newest, word, route, send }) {
  const name = textInput({ maxlength: 200, required: true });
  const why = textInput({ maxlength: 2000 });
  const named = labelled("Name", name);
  const holder = h("div.stack");
  let cases = [];
  (newest?.cases ?? [{ ...NEW, name: "any condition" }]).forEach(add);
  const reasonGiven = () => (why.value.trim() ? { text: why.value.trim() } : {});
  const own = newest === null ? { name: named } : {};
  return createForm({
    title: word,
    word,
    route,
    classes: "panel form",
    fields: [
      group(own, () => (name.value.trim() || newest ? [] : [[named, "No name was given: name the limit set."]])),
      { check: () => cases.every((each) => each.check()), editors: new Map() },
    ],
    content: [
      h("h2", newest === null ? "New limit set" : "Next version"),
      h("p.hint", "A version never changes, and each flight records its version. Conditions must not overlap; an empty field is unbounded."),
      newest === null ? named.element : null,
      holder,
      h("div.row", button("Add a condition", () => add(NEW))),
      labelled("Reason", why).element,
    ],
    send: () => send({ ...(newest === null && { name: name.value.trim() }), ...reasonGiven(), cases: cases.map(({ read }) => read()) }),
  }).element;

  function add(given) {
    const added = createCase(catalog, given, () => place(cases.filter((other) => other !== added)));
    place([...cases, added]);
  }

  function place(left) {
    cases = left;
    holder.replaceChildren(...cases.map((each) => each.element));
    for (const { away } of cases) away.hidden = cases.length === 1;
  }
}

function createCase(catalog, { name, ranges, limits }, remove) {
  const title = textInput({ maxlength: 200, required: true, value: name });
  const named = labelled("Name of the condition", title);
  const ends = catalog.conditions.map((condition) => rangeOf(condition, ranges[condition.key]));
  const { schema } = catalog.families.limits.entries.limits;
  const fields = createFields(schema, limits, { catalog, path: "limits" });
  const away = button("Remove this condition", remove, { class: "button button-small" });
  const element = h(
    "fieldset",
    h("legend", "Condition"),
    named.element,
    h("div.limit-ranges", ends.map((end) => end.element)),
    h("div.field-grid", fields.keys.map(fields.element)),
    h("div.row", away),
  );
  const own = group({}, () => [
    [named, title.value.trim() ? "" : "The condition has no name: enter one."],
    ...ends.map((end) => [end, end.isBad() ? "Not a number: enter numbers, or leave the field empty." : ""]),
  ]);
  return { element, away, read, check: () => own.check() && fields.check() };

  function read() {
    const given = ends.map(({ key, range }) => [key, range()]).filter(([, range]) => range.some((end) => end !== null));
    return { name: title.value.trim(), ranges: Object.fromEntries(given), limits: fields.read() };
  }
}

/** A Field of two numbers, each of which may be left empty. */
function rangeOf({ key, label, unit }, given = ["", ""]) {
  const inputOf = (word, end) => h("input", { type: "number", step: "any", value: given[end] ?? "", "aria-label": `${label} ${word}` });
  const inputs = ["from", "below"].map(inputOf);
  const [low, high] = inputs;
  const isBad = () => inputs.some(({ validity }) => validity.badInput);
  const range = () => inputs.map(({ value }) => (value === "" ? null : Number(value)));
  const words = h("span", label, h("span.unit", unit && ` [${unit}]`));
  return sharedField("div.field", low, [words, h("div.row.limit-range", "from", low, "below", high)], { key, isBad, range });
}
