/**
 * Form of a limit set's next version: flight conditions, each with its limits.
 *
 * Exports
 *   createLimitForm({catalog, newest, word, route, send}) -> form
 *     newest: the version to begin with; null for a new set, which also needs a name
 *     word: text of the button.   route: its request; without permission for it the form is hidden
 *     send(version) -> Promise    rejects with the reason
 *   rangeText(range) -> string     "from 0.4 to below 0.8"
 */

import { createFields } from "../forms/form.js";
import { reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { needs } from "../lib/me.js";
import { button, errorLine } from "../lib/view_states.js";

let inputs = 0;

export function createLimitForm({ catalog, newest, word, route, send }) {
  const failure = errorLine();
  const name = h("input", { type: "text", maxlength: 200, required: true });
  const why = h("input", { type: "text", maxlength: 2000 });
  const holder = h("div", { class: "stack" });
  let cases = [];
  const go = h("button", { class: "button button-primary", type: "submit" }, word);
  (newest?.cases ?? [{ name: "any condition", ranges: {}, limits: undefined }]).forEach(add);

  function add(given) {
    const added = createCase(catalog, given, () => {
      cases = cases.filter((other) => other !== added);
      place();
    });
    cases.push(added);
    place();
  }

  function place() {
    holder.replaceChildren(...cases.map(({ element }) => element));
    for (const { setRemovable } of cases) setRemovable(cases.length > 1);
  }

  async function submit(event) {
    event.preventDefault();
    failure.show("");
    if (newest === null && name.value.trim() === "") {
      failure.show("No name was given: name the limit set.");
      name.focus();
      return;
    }
    if (!cases.every(({ check }) => check())) return;
    go.disabled = true;
    try {
      await send({
        ...(newest === null ? { name: name.value.trim() } : {}),
        ...(why.value.trim() && { text: why.value.trim() }),
        cases: cases.map(({ read }) => read()),
      });
    } catch (error) {
      failure.show(reason(error));
    }
    go.disabled = false;
  }

  return h("form", { class: "panel form", novalidate: true, onsubmit: submit, "aria-label": word, "data-keeps-input": true, ...needs(route) },
    h("h2", {}, newest === null ? "New limit set" : "Next version"),
    h("p", { class: "hint" }, "A version never changes, and each flight records its version. Conditions must not overlap; an empty field is unbounded."),
    newest === null ? labelled("Name", name) : null,
    holder,
    h("div", { class: "row" }, button("Add a condition", () => add({ name: "", ranges: {}, limits: undefined }))),
    labelled("Reason", why),
    h("div", { class: "row" }, go),
    failure.element);
}

function createCase(catalog, { name, ranges, limits }, remove) {
  const schema = catalog.families.limits.entries.limits.schema;
  const title = h("input", { type: "text", maxlength: 200, required: true, value: name });
  const failure = errorLine();
  const ends = catalog.conditions.map(({ key, label, unit }) => {
    const [low, high] = [0, 1].map((end) => h("input", { type: "number", step: "any", value: ranges[key]?.[end] ?? "", "aria-label": `${label} ${end === 0 ? "from" : "below"}` }));
    return { key, low, high, element: h("div", { class: "field" }, h("span", {}, label, h("span", { class: "unit" }, unit && ` [${unit}]`)), h("div", { class: "row limit-range" }, "from", low, "below", high)) };
  });
  const fields = createFields(schema, limits, { catalog, path: "limits" });
  const away = button("Remove this condition", remove, { class: "button button-small" });
  const element = h("fieldset", {}, h("legend", {}, "Condition"),
    labelled("Name of the condition", title),
    h("div", { class: "limit-ranges" }, ...ends.map((end) => end.element)),
    h("div", { class: "field-grid" }, ...fields.keys.map((key) => fields.element(key))),
    h("div", { class: "row" }, away), failure.element);

  function check() {
    const unread = ends.flatMap(({ low, high }) => [low, high]).find((input) => input.validity.badInput);
    const wrong = title.value.trim() === "" ? "The condition has no name: enter one." : unread ? "A range contains a non-number: enter numbers, or leave the field empty." : "";
    failure.show(wrong);
    return wrong === "" && fields.check();
  }

  const number = (input) => (input.value === "" ? null : Number(input.value));

  function read() {
    const given = ends.map(({ key, low, high }) => [key, [number(low), number(high)]]).filter(([, range]) => range.some((end) => end !== null));
    return { name: title.value.trim(), ranges: Object.fromEntries(given), limits: fields.read() };
  }

  return { element, check, read, setRemovable: (removable) => { away.hidden = !removable; } };
}

function labelled(words, control) {
  control.id = `limit-input-${++inputs}`;
  return h("div", { class: "field" }, h("label", { for: control.id }, words), control);
}

export function rangeText([low, high] = [null, null]) {
  const parts = [low === null ? "" : `from ${low}`, high === null ? "" : `below ${high}`].filter(Boolean);
  return parts.join(", ") || "any";
}
