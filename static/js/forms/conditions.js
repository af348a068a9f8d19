/**
 * Flight conditions of a set, each with what holds there.
 *
 * createCaseForm({catalog, word, route, heading, hint, nameless, cases, contentOf, send}) -> form
 *     word: of the button.   nameless: words where no name is given; null for a set that has one
 *     cases: to begin with.   contentOf(case) -> {elements, check() -> bool, read()}     what holds there, as part of the case
 *     send({name, text, cases}) -> Promise
 * conditionColumns(catalog)    columns of a table of cases
 */

import { button, h } from "../lib/dom.js";
import { createForm, group, labelled, sharedField, textInput } from "./controls.js";

export function createCaseForm({ catalog, word, route, heading, hint, nameless, cases, contentOf, send }) {
  const name = textInput({ maxlength: 200, required: true });
  const why = textInput({ maxlength: 2000 });
  const named = labelled("Name", name);
  const isNamed = nameless === null;
  const conditions = createConditions(catalog, cases, contentOf);
  return createForm({
    title: word,
    word,
    route,
    classes: "panel form",
    fields: [group(isNamed ? {} : { name: named }, () => [[named, isNamed || name.value.trim() ? "" : nameless]]), conditions],
    content: [h("h2", heading), h("p.hint", hint), !isNamed && named.element, conditions.elements, labelled("Reason", why).element],
    send: () => send({ ...(!isNamed && { name: name.value.trim() }), ...(why.value.trim() && { text: why.value.trim() }), cases: conditions.read() }),
  }).element;
}

function createConditions(catalog, cases, contentOf) {
  const holder = h("div.stack");
  let shown = [];
  cases.forEach(add);
  const more = h("div.row", button("Add a condition", () => add({ name: "", ranges: {} })));
  const check = () => shown.every((each) => each.check());
  return { elements: [holder, more], editors: new Map(), check, read: () => shown.map(({ read }) => read()) };

  function add(given) {
    const added = createCase(catalog, given, contentOf(given), () => place(shown.filter((other) => other !== added)));
    place([...shown, added]);
  }

  function place(left) {
    shown = left;
    holder.replaceChildren(...shown.map((each) => each.element));
    for (const { away } of shown) away.hidden = shown.length === 1;
  }
}

function createCase(catalog, { name, ranges }, content, remove) {
  const title = textInput({ maxlength: 200, required: true, value: name });
  const named = labelled("Name of the condition", title);
  const ends = catalog.conditions.map((condition) => rangeOf(condition, ranges[condition.key]));
  const away = button("Remove this condition", remove, { class: "button button-small" });
  const element = h(
    "fieldset",
    h("legend", "Condition"),
    named.element,
    h("div.limit-ranges", ends.map((end) => end.element)),
    content.elements,
    h("div.row", away),
  );
  const own = group({}, () => [
    [named, title.value.trim() ? "" : "The condition has no name: enter one."],
    ...ends.map((end) => [end, end.isBad() ? "Not a number: enter numbers, or leave the field empty." : ""]),
  ]);
  return { element, away, read, check: () => own.check() && content.check() };

  function read() {
    const given = ends.map(({ key, range }) => [key, range()]).filter(([, range]) => range.some((end) => end !== null));
    return { name: title.value.trim(), ranges: Object.fromEntries(given), ...content.read() };
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

export function conditionColumns(catalog) {
  const ranges = catalog.conditions.map(({ key, label, unit }) => [
    `${label}${unit && ` [${unit}]`}`,
    (each) => rangeText(each.ranges[key]),
    "nowrap",
  ]);
  return [["Condition", ({ name }) => name, "name"], ...ranges];
}

function rangeText([low, high] = [null, null]) {
  const parts = [low !== null && `from ${low}`, high !== null && `below ${high}`].filter(Boolean);
  return parts.join(", ") || "any";
}
