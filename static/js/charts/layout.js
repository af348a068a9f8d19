/**
 * The elements of a strip chart: a row for each strip, the time axis, the tool bar.
 *
 * Exports
 *   layOut(host, strips, {label, help, buttons}) -> {rows, rowOf: [{canvas, readout}], axis, bar}
 *     buttons: [[name, text, title]] of the tool bar
 *     bar: {mode, interval, values: elements; on(name, act)}
 *   cursorButtons(follow) -> the buttons a b clear out in live; follow: [text, title] of the last one
 *   keysHelp({end, follow, more ""}) -> what the keys do
 *   sizeCanvas(canvas, width, height, ratio) -> {width, height, ratio}
 */

import { h } from "../lib/dom.js";

let charts = 0;

export function cursorButtons([text, title]) {
  return [
    ["a", "A", "Set cursor A (key A)"],
    ["b", "B", "Set cursor B (key B)"],
    ["clear", "Clear", "Clear the cursors A and B (key C)"],
    ["out", "−", "Show more time (key minus)"],
    ["in", "+", "Show less time (key plus)"],
    ["live", text, `${title} (key L, or double click)`],
  ];
}

export function keysHelp({ end, follow, more = "" }) {
  return (
    "Left and right arrows move the cursor, with Shift ten times as far; Home and End go to the " +
    `window's start and ${end}; ${more}A and B set cursors, C clears them; plus and minus zoom, ` +
    `Page Up and Page Down move the window, L ${follow}, Escape removes the cursor.`
  );
}

export function layOut(host, strips, { label, help, buttons }) {
  const keys = h("p", { class: "visually-hidden", id: `strip-chart-help-${++charts}` }, help);
  const rowOf = strips.map(() => ({
    canvas: h("canvas", { role: "img" }),
    readout: h("div", { class: "readout" }),
  }));
  const rows = h(
    "div",
    { class: "strips" },
    strips.map(({ key, limits, risk }, k) =>
      h(
        "div",
        { class: limits !== null || risk ? "strip strip-tall" : "strip", "data-key": key },
        h("div", { class: "strip-plot" }, rowOf[k].canvas),
        rowOf[k].readout,
      ),
    ),
  );
  const axis = h("canvas", { "aria-hidden": "true" });
  const mode = h("span", { class: "chip" });
  const interval = h("span", { class: "strip-interval" });
  const values = h("output", { class: "strip-cursors", "aria-live": "polite" });
  const made = buttons.map(([name, text, title]) => [
    name,
    h("button", { class: "button button-small", type: "button", title, "aria-label": title }, text),
  ]);
  const buttonOf = Object.fromEntries(made);
  host.classList.add("strip-chart");
  host.tabIndex = 0;
  host.setAttribute("role", "group");
  host.setAttribute("aria-label", label);
  host.setAttribute("aria-describedby", keys.id);
  host.replaceChildren(
    keys,
    rows,
    h("div", { class: "strip-axis" }, h("div", { class: "strip-plot" }, axis)),
    h("div", { class: "strip-toolbar" }, mode, interval, values, Object.values(buttonOf)),
  );
  const on = (name, act) => buttonOf[name].addEventListener("click", act);
  return { rows, rowOf, axis, bar: { mode, interval, values, on } };
}

export function sizeCanvas(canvas, width, height, ratio) {
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  return { width, height, ratio };
}
