/**
 * Tables and lists of every page.
 *
 * Exports
 *   tableHead([[words, isNumber]]) -> <thead>     words: text or a node; hiddenHead(words): for screen readers only
 *   scrolledTable({heads, rows, caption}) -> <div>     as above; rows: of <tr>
 *   factList([[name, value]]) -> <dl>                a fact in a cell of its own
 *   recipeList([[name, value, isHash]]) -> <dl>   name beside value; a hash in its own type
 *   sentences(texts) -> <ul>, or null where there are none
 */

import { h } from "./dom.js";

export function tableHead(heads) {
  const cells = heads.map(([words, isNumber]) =>
    h("th", { scope: "col", class: isNumber ? "number" : null }, words),
  );
  return h("thead", {}, h("tr", {}, cells));
}

export function scrolledTable({ heads, rows, caption }) {
  return h(
    "div",
    { class: "table-scroll panel" },
    h(
      "table",
      { class: "table" },
      caption && h("caption", { class: "hint" }, caption),
      tableHead(heads),
      h("tbody", {}, rows),
    ),
  );
}

export function hiddenHead(words) {
  return [h("span", { class: "visually-hidden" }, words)];
}

export function factList(facts, classes = "facts") {
  return h(
    "dl",
    { class: classes },
    facts.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))),
  );
}

export function recipeList(rows, classes = "recipe") {
  return h(
    "dl",
    { class: classes },
    rows.flatMap(([name, value, isHash]) => [
      h("dt", {}, name),
      h("dd", { class: isHash ? "hash" : null }, value),
    ]),
  );
}

export function sentences(texts) {
  if (!texts.length) return null;
  return h(
    "ul",
    { class: "sentences" },
    texts.map((text) => h("li", {}, text)),
  );
}
