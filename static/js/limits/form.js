/**
 * Form of a limit set's next version: flight conditions, each with its limits.
 *
 * newest: the version to begin with; null for a new set, which also needs a name
 * route: its request; without permission for it the form is hidden.   send(version) -> Promise
 */

import { createConditions } from "../forms/conditions.js";
import { createForm, group, labelled, textInput } from "../forms/controls.js";
import { createFields } from "../forms/form.js";
import { h } from "../lib/dom.js";

export function createLimitForm({ catalog, newest, word, route, send }) {
  const name = textInput({ maxlength: 200, required: true });
  const why = textInput({ maxlength: 2000 });
  const named = labelled("Name", name);
  const conditions = createConditions(catalog, newest?.cases ?? [{ name: "any condition", ranges: {} }], limitsOf);
  const reasonGiven = () => (why.value.trim() ? { text: why.value.trim() } : {});
  const own = newest === null ? { name: named } : {};
  return createForm({
    title: word,
    word,
    route,
    classes: "panel form",
    fields: [
      group(own, () => (name.value.trim() || newest ? [] : [[named, "No name was given: name the limit set."]])),
      conditions,
    ],
    content: [
      h("h2", newest === null ? "New limit set" : "Next version"),
      h("p.hint", "A version never changes, and each flight records its version. Conditions must not overlap; an empty field is unbounded."),
      newest === null ? named.element : null,
      conditions.elements,
      labelled("Reason", why).element,
    ],
    send: () => send({ ...(newest === null && { name: name.value.trim() }), ...reasonGiven(), cases: conditions.read() }),
  }).element;

  function limitsOf({ limits }) {
    const { schema } = catalog.families.limits.entries.limits;
    const fields = createFields(schema, limits, { catalog, path: "limits" });
    return { elements: h("div.field-grid", fields.keys.map(fields.element)), check: fields.check, read: () => ({ limits: fields.read() }) };
  }
}
