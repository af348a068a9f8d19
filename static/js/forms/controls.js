/**
 * Controls of every form, and how a form sends and shows why it was refused.
 *
 * select([[value, words]], attributes)    an entry may be a node;   attributes.value: the chosen one, else the first
 * Field: {element, words, say(reason), focus()}     fieldOf(control, {label: nodes, words: the label in a sentence})
 * sharedField(selector, first, content, more) -> Field     of several controls, the first of which gets the focus
 * radioGroup({name, ways: [[value, words, {beside, disabled}]], value, onchange, label}) -> {element, value()}
 * fileInput({read(file) -> Promise, failure, ...attributes})    failure: an error line
 * pasteBox({..., use(text) -> Promise})    text as pasted, or of a file
 * group({path: Field}, checks() -> [[Field, reason or ""]]) -> fields of createForm
 * refusal({fields, refuse}, error)    shows the error at the field that it names, else by refuse(words)
 * inWords(editors, message)    with the labels in place of the program's names;  editors: Map path -> Field
 * createForm({title, word, route, content, fields, send, beside, classes, follow}) -> {element, form, go, refuse(words)}
 *     fields: [{check() -> bool or Promise, editors}]     send() -> Promise; rejects with the reason
 *     beside: nodes after the button.   follow: {api, keep, title(job), done(result, back)} where send() gives a job
 */

import { ApiError, needs, reason } from "../lib/api.js";
import { button, errorLine, h } from "../lib/dom.js";
import { createJobProgress } from "../lib/job_progress.js";
import { capital, trueMinus } from "../lib/numbers.js";

const SHORT = 18; // letters of a choice that a column holds
let controls = 0;

/** @param {any[]} entries @param {Record<string, any>} [attributes] */
export function select(entries, { value, ...attributes } = {}) {
  const options = entries
    .filter(Boolean)
    .map((entry) => (Array.isArray(entry) ? h("option", { value: entry[0] }, entry[1]) : entry));
  const element = h("select", attributes, options);
  if ([...element.options].some((option) => option.value === String(value))) element.value = value;
  return element;
}

export const textInput = (attributes = {}) => h("input", { type: "text", ...attributes });

export const numberInput = (attributes = {}) => h("input", { type: "number", step: "any", ...attributes });

export const checkbox = (attributes = {}) => h("input", { type: "checkbox", ...attributes });

export function radio(words, attributes, ...more) {
  return h("label.radio", h("input", { type: "radio", ...attributes }), words, more);
}

export function radioGroup({ name, ways, value, onchange = null, label = null }) {
  const entryOf = ([key, words, { disabled = false, beside = null } = {}]) => radio(words, { name, value: key, checked: key === value, onchange, disabled }, beside);
  const element = h("div.row", { role: "radiogroup", "aria-label": label }, ways.map(entryOf));
  return { element, value: () => element.querySelector(":checked").value };
}

export function fieldOf(control, { label, words, hint = "", title = null, path = null }) {
  control.id ||= `field-${++controls}`;
  const { id } = control;
  const failure = h("p.error", { id: `${id}-error`, hidden: true });
  control.setAttribute("aria-describedby", `${id}-hint ${id}-error`);
  control.addEventListener("input", () => say("")); // not on leaving it: what is about to be clicked would move
  const isLong = [...(control.options ?? [])].some(({ text }) => text.length > SHORT);
  const element = h(
    "div.field",
    { "data-path": path, "data-long": isLong },
    h("label", { for: id }, label),
    control,
    h("p.hint", { id: `${id}-hint`, title }, hint),
    failure,
  );
  return { element, words, say, focus };

  function say(why) {
    failure.textContent = why;
    failure.hidden = !why;
    if (why) control.setAttribute("aria-invalid", "true");
    else control.removeAttribute("aria-invalid");
  }

  function focus() {
    for (let outer = element.closest("details"); outer; outer = outer.parentElement.closest("details"))
      outer.open = true;
    control.focus();
  }
}

/** @param {any} label @param {any} control @param {{hint?: any, unit?: string}} [more] */
export function labelled(label, control, { hint = "", unit = "" } = {}) {
  const words = [label, unit && h("span.unit", ` [${unit}]`)];
  return fieldOf(control, { label: words, words: label, hint });
}

export function group(editors, checks = () => []) {
  return { editors: new Map(Object.entries(editors)), check };

  function check() {
    const results = checks();
    for (const [field, why] of results) field.say(why);
    const [wrong] = results.find(([, why]) => why) ?? [];
    wrong?.focus();
    return wrong === undefined;
  }
}

export function sharedField(selector, first, content, more) {
  const failure = errorLine();
  const element = h(selector, content, failure.element);
  return { element, say: failure.show, focus: () => first.focus(), ...more };
}

/** A name that may be left out.   read() -> {name} or {} */
export function optionalName(label, id) {
  const input = textInput({ id, maxlength: 200, placeholder: "optional" });
  const read = () => (input.value.trim() ? { name: input.value.trim() } : {});
  return { ...labelled(label, input), read };
}

export function fieldset(title, ...content) {
  return h("fieldset.panel.stack", h("legend", title), content);
}

export const fold = (summary, ...content) => h("details.fold", h("summary", summary), content);

export const foldedPanel = (summary, ...content) => h("details.panel.fold", h("summary", summary), content);

export function fileInput({ read, failure, ...attributes }) {
  const input = h("input", { type: "file", ...attributes, onchange: take });
  return input;

  async function take() {
    const [file] = input.files;
    if (!file) return;
    await failure.attempt(() => read(file));
    input.value = "";
  }
}

/** ApiError with words(error) where the text is no JSON. */
export function parsedJson(text, words) {
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new ApiError(words(error), 422);
  }
}

export function pasteBox({ label, fileLabel, hint, example, word, use }) {
  const failure = errorLine();
  const text = h("textarea", { rows: 4, spellcheck: "false", class: "json", placeholder: example, "aria-label": label });
  const file = fileInput({
    accept: ".json,application/json",
    "aria-label": fileLabel,
    failure,
    read: async (chosen) => {
      text.value = await chosen.text();
      await use(text.value);
    },
  });
  const act = async () => text.setAttribute("aria-invalid", !(await failure.attempt(() => use(text.value))));
  return [
    h("p.hint", hint),
    h("div.field", text),
    h("div.row", button(word, act, { class: "button button-small" }), file),
    failure.element,
  ];
}

const lowered = (text) => text.charAt(0).toLowerCase() + text.slice(1);
const keyOf = (path) => path.split(".").at(-1);
const escaped = (text) => text.replaceAll(".", "\\.");

/** Names that people do not write; others name a parameter only before "=". */
const isProgramName = (name) => /[_.]|^dt$/.test(name);

/** Where a sentence names a parameter; Infinity where it does not. */
function placeOf(path, sentence) {
  if (new RegExp(`^${escaped(path)}(?!\\w)`).test(sentence)) return -path.length;
  const key = keyOf(path);
  const place = sentence.search(new RegExp(`(?<!\\w)${key}${isProgramName(key) ? "(?!\\w)" : "="}`));
  return place < 0 ? Infinity : place;
}

function fieldNamed(editors, message) {
  const places = [...editors].map(([path, field]) => [placeOf(path, lowered(message)), field]);
  const [place, field] = places.reduce((best, other) => (other[0] < best[0] ? other : best), [Infinity, null]);
  return Number.isFinite(place) ? field : null;
}

export function inWords(editors, message) {
  const names = [...editors].flatMap(([path, { words }]) => [[path, words], [keyOf(path), words]]);
  names.sort(([a], [b]) => b.length - a.length);
  const [prefix] = lowered(message).match(/^[\w.]+(?=: )/) ?? [];
  const isPart = prefix !== undefined && [...editors.keys()].some((path) => path.startsWith(`${prefix}.`));
  let sentence = isPart ? message.slice(prefix.length + 2) : lowered(message);
  for (const [name, words] of names) {
    const found = new RegExp(`(\\b(?:raise|lower) )?(?<![\\w.])${escaped(name)}(=${isProgramName(name) ? "|(?![\\w.])" : ""})`, "g");
    sentence = sentence.replace(found, (_, verb, sign) => `${verb ? `${verb}the ` : ""}${words}${sign ? " " : ""}`);
  }
  return trueMinus(message === lowered(message) ? sentence : capital(sentence));
}

const editorsOf = (fields) => new Map(fields.flatMap((part) => [...part.editors]));

export function refusal({ fields, refuse }, error) {
  const editors = editorsOf(fields);
  const message = reason(error);
  const words = inWords(editors, message);
  const field = error.status === 422 ? fieldNamed(editors, message) : null;
  if (!field?.element.isConnected || field.element.closest("[hidden]")) return refuse(words);
  field.say(words);
  return field.focus();
}

export function createForm({ title, word, route, content, fields = [], send, beside = null, classes = "form", follow = null }) {
  const failure = errorLine();
  const go = h("button.button.button-primary", { type: "submit" }, word);
  const form = h(
    "form",
    { class: classes, novalidate: true, onsubmit: submit, "aria-label": title, "data-keeps-input": true, ...needs(route) },
    content,
    failure.element,
    h("div", { class: classes === "form" ? "row form-end" : "row" }, go, beside),
  );
  const stage = follow ? h("div.stack", form) : form;
  return { element: stage, form, go, refuse };

  function refuse(words) {
    failure.show(words);
    if (words) failure.element.scrollIntoView({ block: "nearest" });
  }

  async function submit(event) {
    event.preventDefault();
    refuse("");
    const checked = await Promise.all(fields.map((part) => part.check()));
    if (!checked.every(Boolean)) return;
    go.disabled = true;
    try {
      const job = await send();
      if (follow) watch(job);
    } catch (error) {
      refusal({ fields, refuse }, error);
    }
    go.disabled = false;
  }

  function watch(job) {
    const { api, keep, title: titleOf, done } = follow;
    const worded = (words) => inWords(editorsOf(fields), words);
    const progress = keep(createJobProgress({ api, job, title: titleOf(job), worded, done: (result) => done(result, back), back }));
    form.hidden = true;
    stage.append(progress.element);

    function back() {
      progress.close();
      progress.element.remove();
      form.hidden = false;
      go.focus();
    }
  }
}
