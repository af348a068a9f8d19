/**
 * Elements in one expression, and those of every page: states of a view, headings, buttons, dialogs, tables and lists.
 *
 * h("tag.class.class", attributes, ...children), svg(...)     attributes may be left out
 *     children: nodes, text, lists; null and false are left out.   Attributes that are functions become listeners
 *     (`onclick`), true is an empty attribute, false, null and undefined are left out; `value`, `checked` and
 *     `disabled` are set as properties
 * put(element, text)           changes the text only where it differs
 * formatted(words) -> Node     "|N_y| < 0.5 g" with y as a subscript
 * piecesOf(words) -> [[text, index]]     the same, cut at each symbol; the index is empty for what is no symbol
 * loadingView(element, {title, text, loads, build}) -> {close()}    loading, then what was built, or why not
 *     loads: paths, or functions of `api`.   build({keep, again}, ...loaded) -> Promise<Node>
 *     keep({close}): what must end with the view.   again(): loads and builds again
 * state(kind, title, text, ...actions)    of a panel; kind "empty" | "loading" | "error"
 * panel(title, content, {beside, ...attributes})     beside: nodes in the row of the heading
 * errorLine(classes) -> {element, show(words), attempt(act)}     hidden while there are no words
 *     attempt(act) -> Promise<bool>     shows why act() failed; whether it did not
 * deleteButton({api, path, what, consequence, done, short})     asks first; done() after the deletion
 *     path: of the resource.   what: "monitor “card 7”".   short: its name, for a small button in a list
 * openDialog(title, content, classes) -> dialog, removed when it closes
 * askToConfirm(question, consequence, word, act) -> open dialog; it shows why act() failed
 * createKeepButton({api, path, keep, fail, name, attributes})   keeps a flight or a recording, or releases it
 *     fail(error): the server refused.   name: read aloud after the text, where a page has several
 * guideLink(place, about)     place: "slug" or "slug#anchor";  about: read aloud and shown as a tooltip
 * table({columns, items, group, row, caption, classes, panel})    a card for each item in a narrow window
 *     columns: [[head, cell(item, k) -> content, kind]]     head: text, or hiddenHead(words) for screen readers only
 *       kind: "name" of the row's heading, "number", "date", or other classes
 *     row(item) -> attributes.   group(item, row, k) -> <tbody>, where an item has further rows.   panel: false inside another
 * factList([[name, value]])    a fact in its own cell;   recipeList([[name, value, isHash]])   name beside value
 */

import { api, beginsBy, needs, reason } from "./api.js";
import { trueMinus } from "./numbers.js";

const PROPERTIES = ["value", "checked", "disabled", "open", "indeterminate"];
const ABSENT = [null, undefined, false];
const SYMBOL = /(?<![\p{L}\w])(\p{L})_([\p{L}\w]+)/gu;
const SVG = "http://www.w3.org/2000/svg";

export function h(selector, ...parts) {
  return built((tag) => document.createElement(tag), selector, parts);
}

export function svg(selector, ...parts) {
  return built((tag) => document.createElementNS(SVG, tag), selector, parts);
}

function built(create, selector, parts) {
  const [tag, ...classes] = selector.split(".");
  const element = create(tag);
  const [attributes, children] = parts[0]?.constructor === Object ? [parts[0], parts.slice(1)] : [{}, parts];
  if (classes.length) element.setAttribute("class", classes.join(" "));
  element.append(...children.flat(3).filter((child) => !ABSENT.includes(child)));
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.replace(/^on/, ""), value);
    else if (PROPERTIES.includes(name) && name in element) element[name] = value;
    else if (!ABSENT.includes(value)) element.setAttribute(name, value === true ? "" : value);
  }
  return element;
}

export function formatted(words) {
  const pieces = piecesOf(trueMinus(words)).map(([text, index]) =>
    index ? h("span.symbol", text, h("sub", index)) : text,
  );
  return pieces.length === 1 && typeof pieces[0] !== "string" ? pieces[0] : h("span", pieces);
}

export function piecesOf(words) {
  const pieces = [];
  let end = 0;
  for (const { 0: match, 1: base, 2: index, index: start } of words.matchAll(SYMBOL)) {
    if (start > end) pieces.push([words.slice(end, start), ""]);
    pieces.push([base, index]);
    end = start + match.length;
  }
  return end < words.length ? [...pieces, [words.slice(end), ""]] : pieces;
}

export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function loadingView(element, { title, text, loads = [], build }) {
  let open = true;
  let closing = [];
  const keep = (thing) => {
    if (open) closing.push(thing);
    else thing.close();
    return thing;
  };
  const release = () => {
    closing.forEach((thing) => thing.close());
    closing = [];
  };
  load();
  return {
    close: () => {
      open = false;
      release();
    },
  };

  async function load() {
    if (!open) return;
    release();
    element.replaceChildren(pageOf(title, [], loading(text)));
    try {
      const loaded = await Promise.all(loads.map((wanted) => (typeof wanted === "string" ? api.get(wanted) : wanted(api))));
      const built = await build({ keep, again: load }, ...loaded);
      if (open) element.replaceChildren(built);
    } catch (error) {
      if (open) element.replaceChildren(pageOf(title, [], failure(error, load)));
    }
  }
}

export function loading(text) {
  return h("div.state-loading", { role: "status" }, h("p", text));
}

export const empty = (...parts) => state("empty", ...parts);

export const REFUSED = "Not shown to your role";

export function failure(error, again) {
  const isRefused = error.status === 403;
  const isFinal = isRefused || error.status === 404; // so is the next request
  const list = location.hash.split(/[/?]/, 2).join("/");
  const back = error.status === 404 && list !== location.hash ? [h("a.button", { href: list }, "Back to the list")] : [];
  const actions = again && !isFinal ? [button("Try again", again)] : back;
  return state("error", isRefused ? REFUSED : "This could not be shown", reason(error), ...actions);
}

export function state(kind, title, text, ...actions) {
  const role = kind === "error" ? "alert" : "status";
  const row = actions.length > 0 ? h("div.row", actions) : null;
  return h("section", { class: `state-${kind}`, role }, h("h2", title), h("p", text), row);
}

export function pageOf(title, actions, ...content) {
  const head = h("header.page-head", h("h1", title), h("div.row.page-actions", actions));
  return h("div.page", h("div.page-body.stack", head, content));
}

export function link(text, hash, primary = false) {
  const route = hash.startsWith("#/fly?") ? "POST /flights" : beginsBy(hash);
  return h("a", { class: primary ? "button button-primary" : "button", href: hash, ...(route && needs(route)) }, text);
}

export function button(text, pressed, attributes = {}) {
  return h("button", { type: "button", class: "button", onclick: pressed, ...attributes }, text);
}

/** @param {any} title @param {any} content @param {Record<string, any>} [attributes] */
export function panel(title, content, { beside, ...attributes } = {}) {
  const heading = h("h2.panel-title", title);
  return h("section.panel.stack-tight", attributes, beside ? h("div.row", heading, beside) : heading, content);
}

export function chip(words, level, title = null) {
  return h("span.chip", { "data-level": level, title }, words);
}

export function deleteButton({ api, path, what, consequence, done, short = "" }) {
  const route = `DELETE ${path.replace(/(\/[^/]+)\/[^/]+/g, "$1/{}")}`;
  const look = short
    ? { class: "button button-small", "aria-label": `Delete ${short}` }
    : { class: "button button-danger" };
  return button("Delete", ask, { ...look, ...needs(route) });

  function ask() {
    askToConfirm(`Delete the ${what}?`, consequence, "Delete permanently", async () => {
      await api.delete(path);
      await done();
    });
  }
}

export function errorLine(classes = "") {
  const element = h("p", { class: `error ${classes}`.trim(), role: "alert", hidden: true });
  return { element, show, attempt };

  function show(words) {
    element.textContent = trueMinus(words);
    element.hidden = words === "";
  }

  async function attempt(act) {
    show("");
    try {
      await act();
      return true;
    } catch (error) {
      show(reason(error));
      return false;
    }
  }
}

export function openDialog(title, content, classes = "") {
  const heading = h("h2", { id: "dialog-title" }, title);
  const dialog = h("dialog", { class: `dialog ${classes}`.trim(), "aria-labelledby": "dialog-title" }, heading, content);
  dialog.addEventListener("close", () => dialog.remove());
  document.querySelector("#page").append(dialog);
  dialog.showModal();
  return dialog;
}

export function askToConfirm(question, consequence, word, act) {
  const failure = errorLine();
  const yes = button(word, perform, { class: "button button-danger" });
  const no = button("Cancel", () => dialog.close(), { autofocus: true });
  const dialog = openDialog(question, [h("p", consequence), failure.element, h("div.row", yes, no)]);
  return dialog;

  async function perform() {
    yes.disabled = true;
    if (await failure.attempt(act)) return dialog.close();
    yes.disabled = false;
    return no.focus();
  }
}

export function guideLink(place, about) {
  return h(
    "a.guide-link",
    { href: `/guide/${place}`, target: "_blank", rel: "noopener", title: `Guide: ${about}` },
    "?",
    h("span.visually-hidden", ` ${about}`),
  );
}

export function createKeepButton({ api, path, keep, fail, name = "", attributes = {} }) {
  let isKept = keep;
  const element = button("", press, { ...attributes, ...needs(`PUT ${path.replace(/[^/]+$/, "{}")}/keep`) });
  show();

  function show() {
    const hidden = name && h("span.visually-hidden", ` ${name}`);
    element.replaceChildren(isKept ? "✓ Kept permanently" : "Keep permanently", hidden);
    element.setAttribute("aria-pressed", String(isKept));
    element.title = isKept ? "Protected from deletion; press to release it" : "Protect it from deletion by retention and by people";
  }

  async function press() {
    element.disabled = true;
    try {
      isKept = (await api.put(`${path}/keep`, { keep: !isKept })).keep;
      show();
    } catch (error) {
      fail(error);
    }
    element.disabled = false;
  }

  return element;
}

const CLASSES = { date: "dim nowrap", number: "number" };
const noAttributes = (_item) => ({});

export function table({ columns, items, group = null, row = noAttributes, caption = null, classes = "", panel = true }) {
  const rows = items.map((item, k) => h("tr", row(item), columns.map((column) => cell(column, item, k))));
  return h(
    "div",
    { class: panel ? "table-scroll panel" : "table-scroll" },
    h(
      "table",
      { class: `table table-cards ${classes}`.trim() },
      caption && h("caption.hint", caption),
      h("thead", h("tr", columns.map(([head, , kind]) => headCell(head, kind)))),
      group ? rows.map((element, k) => group(items[k], element, k)) : h("tbody", rows),
    ),
  );
}

export function hiddenHead(words) {
  return h("span.visually-hidden", words);
}

function headCell(head, kind) {
  return h("th", { scope: "col", class: kind?.startsWith("number") ? "number" : null }, head);
}

function cell([head, contentOf, kind = null], item, k) {
  const content = contentOf(item, k);
  if (kind?.startsWith("name")) return h("th", { scope: "row", class: kind.slice(5) || null }, content);
  const attributes = { class: CLASSES[kind] ?? kind, "data-label": typeof head === "string" && head };
  return h("td", attributes, Array.isArray(content) ? h("span", content) : content);
}

export function factList(facts, classes = "facts") {
  const cells = facts.map(([name, value]) => h("div", h("dt", name), h("dd", value)));
  return h("dl", { class: classes }, cells);
}

export function recipeList(rows, classes = "recipe") {
  const parts = rows.flatMap(([name, value, isHash]) => [h("dt", name), h(isHash ? "dd.hash" : "dd", value)]);
  return h("dl", { class: classes }, parts);
}

export function sentences(texts) {
  if (!texts.length) return null;
  return h("ul.sentences", texts.map((text) => h("li", typeof text === "string" ? trueMinus(text) : text)));
}
