/**
 * Elements in one expression.
 *
 * h("tag.class.class", attributes, ...children), svg(...)     attributes may be left out
 *     children: nodes, text, lists; null and false are left out.   Attributes that are functions become listeners
 *     (`onclick`), true is an empty attribute, false, null and undefined are left out; `value`, `checked` and
 *     `disabled` are set as properties
 * put(element, text)           changes the text only where it differs
 * symbolNodes(symbol) -> Node[]     "N_y" as N with subscript y
 * formatted(words) -> Node     "|N_y| < 0.5 g" with y as a subscript
 * piecesOf(words) -> [[text, index]]     the same, cut at each symbol; the index is empty for what is no symbol
 */

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

export function symbolNodes(symbol) {
  const [head, tail] = symbol.split("_");
  const base = document.createTextNode(head);
  return tail === undefined ? [base] : [base, h("sub", tail)];
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
