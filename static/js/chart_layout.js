/**
 * The elements of a strip chart: a row for each strip, the time axis, the tool bar.
 *
 * Exports
 *   layOut(host, strips) -> {rows, rowOf: [{canvas, readout}], axis, bar}
 *     bar: {mode, span, values: elements; on(name, act)}, names: a b clear in out live
 */

import { KEYS_HELP } from "./chart_input.js";

const BUTTONS = [
  ["a", "A", "Set cursor A (key A)"],
  ["b", "B", "Set cursor B (key B)"],
  ["clear", "Clear", "Clear the cursors A and B (key C)"],
  ["out", "−", "Show more time (key minus)"],
  ["in", "+", "Show less time (key plus)"],
  ["live", "Live", "Follow live data (key L, or double click)"],
];

let charts = 0;

export function layOut(host, strips) {
  host.replaceChildren();
  host.classList.add("strip-chart");
  host.tabIndex = 0;
  host.setAttribute("role", "group");
  host.setAttribute("aria-label", "Strip charts");
  const help = add(host, "p", "visually-hidden");
  help.id = `strip-chart-help-${++charts}`;
  help.textContent = KEYS_HELP;
  host.setAttribute("aria-describedby", help.id);

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
  return { rows, rowOf, axis, bar: toolBar(host) };
}

function toolBar(host) {
  const bar = add(host, "div", "strip-toolbar");
  const mode = add(bar, "span", "chip");
  const span = add(bar, "span", "strip-span");
  const values = add(bar, "output", "strip-cursors");
  values.setAttribute("aria-live", "polite");
  const buttons = {};
  for (const [name, text, title] of BUTTONS) {
    buttons[name] = add(bar, "button", "button button-small");
    buttons[name].type = "button";
    buttons[name].textContent = text;
    buttons[name].title = title;
    buttons[name].setAttribute("aria-label", title);
  }
  return { mode, span, values, on: (name, act) => buttons[name].addEventListener("click", act) };
}

function add(parent, tag, className) {
  const element = document.createElement(tag);
  if (className) element.className = className;
  parent.append(element);
  return element;
}
