/**
 * Tables and lists of every page.
 *
 * Exports
 *   table({columns, items, group, row, caption, classes, panel}) -> <div>    a card for each item in a narrow window
 *     columns: [[head, cell(item, k) -> content, kind]]     head: text, or hiddenHead(words) for screen readers only
 *       kind: "name" of the row's heading, "number", "date", or other classes
 *     row(item) -> attributes of its row
 *     group(item, row, k) -> <tbody>, where an item has further rows.   panel: false inside another panel
 *   factList([[name, value]]) -> <dl>             a fact in a cell of its own
 *   recipeList([[name, value, isHash]]) -> <dl>   name beside value
 *   sentences(texts) -> <ul>, or null where there are none
 */

import { h } from "./dom.js";
import { trueMinus } from "./numbers.js";

const CLASSES = { date: "dim nowrap", number: "number" };
const noAttributes = () => ({});

export function table({ columns, items, group, row = noAttributes, caption, classes = "", panel = true }) {
  const rows = items.map((item, k) => h("tr", row(item), columns.map((column) => cell(column, item, k))));
  return h(
    "div",
    { class: panel ? "table-scroll panel" : "table-scroll" },
    h(
      "table",
      { class: `table table-cards ${classes}`.trim() },
      caption && h("caption", { class: "hint" }, caption),
      h("thead", {}, h("tr", {}, columns.map(([head, , kind]) => headCell(head, kind)))),
      group ? rows.map((element, k) => group(items[k], element, k)) : h("tbody", {}, rows),
    ),
  );
}

export function hiddenHead(words) {
  return h("span", { class: "visually-hidden" }, words);
}

function headCell(head, kind) {
  return h("th", { scope: "col", class: kind === "number" ? "number" : null }, head);
}

function cell([head, contentOf, kind = null], item, k) {
  const content = contentOf(item, k);
  if (kind?.startsWith("name")) return h("th", { scope: "row", class: kind.slice(5) || null }, content);
  const label = typeof head === "string" ? head : null;
  return h(
    "td",
    { class: CLASSES[kind] ?? kind, "data-label": label },
    Array.isArray(content) ? h("span", {}, content) : content,
  );
}

export function factList(facts, classes = "facts") {
  const cells = facts.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value)));
  return h("dl", { class: classes }, cells);
}

export function recipeList(rows, classes = "recipe") {
  const parts = rows.flatMap(([name, value, isHash]) => [
    h("dt", {}, name),
    h("dd", { class: isHash ? "hash" : null }, value),
  ]);
  return h("dl", { class: classes }, parts);
}

export function sentences(texts) {
  if (!texts.length) return null;
  return h("ul", { class: "sentences" }, texts.map((text) => h("li", {}, withMinus(text))));
}

const withMinus = (text) => (typeof text === "string" ? trueMinus(text) : text);
