/**
 * The elements of a strip chart: a row for each strip, the time axis, the tool bar.
 *
 * layOut(host, strips, label) -> {rows, rowOf: [{canvas, readout}], axis, keys, bar: {element, mode, interval, values}}
 *     keys: element for what the keys do.   bar: its buttons follow the other elements
 * createSheet(canvas) -> Sheet     a canvas drawn in px of the page, in the colours of its theme
 *     {canvas, pen, width, height, palette, hatches, resize(width, height, ratio), setPalette(palette), clear(name "")}
 *     clear: empties it but for a name in the gutter; the pen's origin is then the plot's left edge
 * GUTTER    width of the value axis left of the plot [px]
 */

import { h } from "../lib/dom.js";
import { hatch } from "./palette.js";

export const GUTTER = 46;

let charts = 0;

export function layOut(host, strips, label) {
  const keys = h("p", { class: "visually-hidden", id: `strip-chart-help-${++charts}` });
  const rowOf = strips.map(() => ({ canvas: h("canvas", { role: "img" }), readout: h("div.readout") }));
  const rows = h("div.strips", strips.map(({ key, limits, risk }, k) => {
    const { canvas, readout } = rowOf[k];
    const row = h("div.strip", { "data-key": key }, h("div.strip-plot", canvas), readout);
    row.classList.toggle("strip-tall", limits !== null || risk);
    return row;
  }));
  const axis = h("canvas", { "aria-hidden": "true" });
  const mode = h("span", { class: "chip" });
  const interval = h("span", { class: "strip-interval" });
  const values = h("output", { class: "strip-cursors", "aria-live": "polite" });
  const bar = h("div", { class: "strip-toolbar" }, mode, interval, values);
  host.classList.add("strip-chart");
  host.tabIndex = 0;
  host.setAttribute("role", "group");
  host.setAttribute("aria-label", label);
  host.setAttribute("aria-describedby", keys.id);
  host.replaceChildren(
    keys,
    rows,
    h("div", { class: "strip-axis" }, h("div", { class: "strip-plot" }, axis)),
    bar,
  );
  return { rows, rowOf, axis, keys, bar: { element: bar, mode, interval, values } };
}

export function createSheet(canvas) {
  const pen = canvas.getContext("2d", { alpha: false });
  const sheet = { canvas, pen, width: 1, height: 1, palette: {}, hatches: {}, resize, setPalette, clear };
  let ratio = 1;

  function resize(width, height, given) {
    ratio = given;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    Object.assign(sheet, { width, height });
  }

  function setPalette(palette) {
    const made = ["stale", "alert", "warming"].map((name) => [name, hatch(pen, name, palette)]);
    Object.assign(sheet, { palette, hatches: Object.fromEntries(made) });
  }

  function clear(name = "") {
    const { width, height, palette } = sheet;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = palette.panel;
    pen.fillRect(0, 0, width, height);
    pen.font = `12px ${palette.font}`;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.fillStyle = palette.dim;
    pen.fillText(name, GUTTER - 6, height / 2);
    pen.translate(GUTTER, 0);
  }

  return sheet;
}
