/**
 * Where the user arranges a view: strips, panels, presets, layouts by name and as files.
 *
 * createLayoutEditor({arrangement, panels, address, keys, presets}) -> {element, unknown, toggle(), tell()}     tell: the address changed
 *     arrangement: of the strips, see arrangement.js.   panels: of those beside them.   keys: of the channels
 *     presets: {word: layout}, see layouts.js.   unknown: element for what the link asks for and this view does not have, and for hidden strips
 */

import { button, errorLine, formatted, h, hiddenHead, put } from "../../lib/dom.js";
import { decimal } from "../../lib/numbers.js";
import { saveText } from "../picture.js";
import { SIZES } from "./arrangement.js";
import { dragInOrder } from "./drag_order.js";
import { applyLayout, layoutFile, layoutNow, layoutOf, savedLayouts, saveLayout, unknownParts } from "./layouts.js";
import { namesAlone, ONLY, openAlone } from "./side_panels.js";

const WAYS = { shown: "shown", number: "number", hidden: "hidden" };
const SIZE_WORDS = { 0.5: "half", 1: "usual", 2: "double", 3: "triple" };

export function createLayoutEditor({ arrangement, panels, address, keys, presets }) {
  const failure = errorLine();
  const small = { class: "button button-small" };
  const close = button("Close", toggle, small);
  const chosen = h("div.row", { role: "group", "aria-label": "Presets" }, Object.entries(presets).map(([word, layout]) => button(word, () => apply(layout), small)));
  const element = h("section.layout-editor", { "aria-label": "Layout", hidden: true, onkeydown: leave },
    h("div.row", h("h2", "Layout"), chosen, h("span.spread", close)),
    failure.element,
    h("div.layout-tables", tableOf("Strips, from top to bottom", arrangement, failure, true), tableOf("Panels beside them", panels, failure, false)),
    h("div.row", { role: "group", "aria-label": "In a second window" }, h("span.dim", "In a second window:"), windowsOf(panels)),
    savedPart());
  const unknown = h("p.warning.layout-unknown", { role: "status", hidden: true });
  const known = { strips: keysOf(arrangement), panels: keysOf(panels), channels: keys };
  let opener = null;
  for (const each of [arrangement, panels]) each.subscribe(tell);
  tell();
  return { element, unknown, toggle, tell };

  function tell() {
    const alone = [address.get(ONLY)].filter((name) => name !== null && !Object.hasOwn(namesAlone(panels), name));
    const missing = [...unknownParts(layoutNow(address), known), ...alone];
    const isBare = arrangement.items.every(({ key }) => arrangement.shown(key) === "hidden");
    const told = [
      ...(missing.length > 0 ? [`Not in this view, so not shown: ${missing.join(", ")}.`] : []),
      ...(isBare ? ["All strips are hidden: show some by View > Layout."] : []),
    ];
    put(unknown, `◆ ${told.join(" ")}`);
    unknown.hidden = told.length === 0;
  }

  function toggle() {
    element.hidden = !element.hidden;
    if (!element.hidden) opener = document.activeElement;
    (element.hidden ? opener : close)?.focus();
    if (!element.hidden) element.scrollIntoView({ block: "nearest" });
  }

  function leave(event) {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    toggle();
  }

  function apply(layout) {
    failure.show("");
    applyLayout(address, layout);
  }

  function savedPart() {
    const name = h("input", { type: "text", maxlength: 60, required: true, "aria-label": "Name of the layout", placeholder: "name" });
    const names = h("select", { "aria-label": "Layouts saved in this browser for these channels" });
    const open = button("Open", () => apply(savedLayouts(keys)[names.value]), small);
    const remove = button("Delete", () => keep(names.value, null), small);
    const file = h("input.visually-hidden", { type: "file", accept: ".json,application/json", onchange: read, "aria-label": "Open a layout file", tabindex: -1 });
    const stored = h("span.row", names, open, remove);
    const form = h("form.row", { onsubmit: save }, name, h("button.button.button-small", "Save in this browser"));
    list();
    return h("div.row.layout-saved", form, stored,
      button("Save as file", () => saveText(layoutFile(keys, name.value || "layout", layoutNow(address)), `${name.value || "layout"}.json`, "application/json"), small),
      button("Open a file", () => file.click(), small), file,
      h("span.hint", "The page's address holds the layout: share it as a link."));

    function list() {
      const known = Object.keys(savedLayouts(keys)).sort();
      names.replaceChildren(...known.map((each) => h("option", { value: each }, each)));
      stored.hidden = known.length === 0;
    }

    function keep(wanted, layout) {
      saveLayout(keys, wanted, layout);
      list();
      if (layout !== null) names.value = wanted;
    }

    function save(event) {
      event.preventDefault();
      keep(name.value.trim() || "layout", layoutNow(address));
    }

    async function read() {
      const [given] = file.files;
      if (given === undefined) return;
      try {
        const { name: wanted, layout } = layoutOf(await given.text());
        const missing = unknownParts(layout, known);
        if (missing.length > 0) throw new Error(`not in this view: ${missing.join(", ")}`);
        apply(layout);
        name.value = wanted;
      } catch (error) {
        failure.show(`${given.name}: ${error.message}`);
      }
      file.value = "";
    }
  }
}

const keysOf = ({ parts }) => parts.map(({ key }) => key);

function windowsOf(panels) {
  return Object.entries(namesAlone(panels)).map(([name, word]) => button(word, () => openAlone(name), { class: "button button-small" }));
}

function tableOf(caption, arrangement, failure, isScaled) {
  const rows = new Map(arrangement.parts.map((part) => [part.key, rowOf(part, arrangement, failure, isScaled)]));
  const body = h("tbody");
  const heads = ["Part", "Show", "Size", isScaled && "Scale"].filter(Boolean).map((word) => h("th", { scope: "col" }, word));
  arrangement.subscribe(show);
  show();
  dragInOrder(body, "th", ({ dataset }) => dataset.part, arrangement);
  return h("div.layout-table", h("table", h("caption", caption), h("thead", h("tr", heads, h("th", { scope: "col" }, hiddenHead("Order")))), body));

  function show() {
    const focused = document.activeElement;
    arrangement.items.forEach((item, k) => {
      const row = rows.get(item.key);
      row.show(item, k, arrangement.items.length);
      if (body.children[k] !== row.element) body.insertBefore(row.element, body.children[k] ?? null);
    });
    if (body.contains(focused)) /** @type {any} */ (focused).focus({ preventScroll: true });
  }
}

function rowOf({ key, label, ways, factor, unit }, arrangement, failure, isScaled) {
  const choose = (name, words, act) => h("select", { "aria-label": `${name} of ${label}`, onchange: (event) => act(event.target.value) }, Object.entries(words).map(([value, word]) => h("option", { value }, word)));
  const as = choose("Show", Object.fromEntries(ways.map((way) => [way, WAYS[way]])), (value) => arrangement.change(key, { as: value }));
  const size = choose("Size", Object.fromEntries(SIZES.map((value) => [value, SIZE_WORDS[value]])), (value) => arrangement.change(key, { size: Number(value) }));
  const ends = ["Least", "Greatest"].map((word) => h("input", { type: "text", inputmode: "decimal", size: 6, placeholder: "auto", "aria-label": `${word} value of ${label}`, onchange: rescale }));
  const [up, down] = [["▲", -1, "up"], ["▼", 1, "down"]].map(([sign, by, word]) => button(sign, () => arrangement.move(key, by), { class: "button button-small", "aria-label": `${sign} Move ${label} ${word}` }));
  const note = h("span.layout-note", { hidden: true }, "▲ exceeded its limit: shown");
  const scale = isScaled && h("td", factor !== null && h("span.row", ends, h("span.dim", unit)));
  const element = h("tr", { "data-part": key }, h("th", { scope: "row" }, formatted(label), note), h("td", as), h("td", size), scale, h("td", up, down));
  return { element, show };

  function rescale() {
    failure.show("");
    const texts = ends.map((input) => input.value.trim());
    const range = texts.map((text) => Number((decimal(text) / factor).toPrecision(7)));
    if (texts.every((text) => text === "")) arrangement.change(key, { range: null });
    else if (range[0] < range[1]) arrangement.change(key, { range });
    else if (texts.every((text) => text !== "")) failure.show(`Scale of ${label}: ${texts.join(" to ")} was given; give a least and a greater value, or neither for an automatic scale.`);
  }

  function show({ as: wanted, size: given, range }, k, n) {
    as.value = wanted;
    size.value = String(given);
    if (range !== null) ends.forEach((input, end) => {
      input.value = String(Number((range[end] * factor).toPrecision(6)));
    });
    else if (ends.every((input) => input !== document.activeElement && Number.isFinite(decimal(input.value)))) for (const input of ends) input.value = "";
    up.disabled = k === 0;
    down.disabled = k === n - 1;
    note.hidden = !arrangement.isForced(key);
  }
}
