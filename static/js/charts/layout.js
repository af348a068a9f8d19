/**
 * The elements of a strip chart: a row for each strip, the time axis, the tool bar.
 *
 * Exports
 *   layOut(host, strips, {label, help, buttons}) -> {rows, rowOf: [{canvas, readout}], axis, bar}
 *     buttons: [[name, text, title]] of the tool bar; by default a b clear out in live
 *     bar: {mode, interval, values: elements; on(name, act)}
 */

import { KEYS_HELP } from "./input.js";

const BUTTONS = [
  ["a", "A", "Set cursor A (key A)"],
  ["b", "B", "Set cursor B (key B)"],
  ["clear", "Clear", "Clear the cursors A and B (key C)"],
  ["out", "−", "Show more time (key minus)"],
  ["in", "+", "Show less time (key plus)"],
  ["live", "Newest", "Follow the newest sample (key L, or double click)"],
];

let charts = 0;

export function layOut(
  host,
  strips,
  { label = "Strip charts", help = KEYS_HELP, buttons = BUTTONS } = {},
) {
  host.replaceChildren();
  host.classList.add("strip-chart");
  host.tabIndex = 0;
  host.setAttribute("role", "group");
  host.setAttribute("aria-label", label);
  const keys = add(host, "p", "visually-hidden");
  keys.id = `strip-chart-help-${++charts}`;
  keys.textContent = help;
  host.setAttribute("aria-describedby", keys.id);

  const rows = add(host, "div", "strips");
  const rowOf = strips.map((strip) => {
    const row = add(rows, "div", strip.limit !== null || strip.risk ? "strip strip-tall" : "strip");
    row.dataset.key = strip.key;
    const canvas = add(add(row, "div", "strip-plot"), "canvas", "");
    canvas.setAttribute("role", "img");
    return { canvas, readout: add(row, "div", "readout") };
  });
  const axisRow = add(host, "div", "strip-axis");
  const axis = add(add(axisRow, "div", "strip-plot"), "canvas", "");
  axis.setAttribute("aria-hidden", "true");
  return { rows, rowOf, axis, bar: toolBar(host, buttons) };
}

function toolBar(host, wanted) {
  const bar = add(host, "div", "strip-toolbar");
  const mode = add(bar, "span", "chip");
  const interval = add(bar, "span", "strip-interval");
  const values = add(bar, "output", "strip-cursors");
  values.setAttribute("aria-live", "polite");
  const buttons = {};
  for (const [name, text, title] of wanted) {
    buttons[name] = add(bar, "button", "button button-small");
    buttons[name].type = "button";
    buttons[name].textContent = text;
    buttons[name].title = title;
    buttons[name].setAttribute("aria-label", title);
  }
  return {
    mode,
    interval,
    values,
    on: (name, act) => buttons[name].addEventListener("click", act),
  };
}

function add(parent, tag, className) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  parent.append(element);
  return element;
}
