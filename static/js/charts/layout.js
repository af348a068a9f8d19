/**
 * The elements of a strip chart: a row for each strip, the time axis, the tool bar.
 *
 * layOut(host, strips, label) -> {rows, rowOf: [{canvas, readout}], axis, keys, bar: {element, mode, interval, values}, onfold}
 *     strips: as arranged by strips.js; of a folded one only the reading is shown, below the time axis
 *     keys: element for what the keys do.   bar: its buttons follow the other elements
 *     onfold(): to be set; strips were folded or unfolded
 * createSheet(canvas) -> Sheet     a canvas drawn in units, in the colours of its theme
 *     {canvas, pen, width, height, ratio, left, palette, hatches, resize(width, height), setPalette(palette), clear(name "")}
 *     ratio: px of the canvas a unit.   left: of the plot [px of the canvas], whole
 *     resize: to px of the page
 *     clear: empties it but for a name in the gutter; the pen's origin is then the plot's left edge
 *     paste(image, left): px for px, from the plot's left edge unless another place is given
 *     clearPlot(from): the same right of a place in the plot.   isFresh: whether nothing was drawn since a resize or a new palette
 * GUTTER    width of the value axis left of the plot [units]
 * unit() -> px of the page: a sixteenth of a rem, so that canvases grow with the text beside them
 */

import { button, h } from "../lib/dom.js";
import { hatch } from "./palette.js";

export const GUTTER = 46;

export const unit = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;

let charts = 0;

export function layOut(host, strips, label) {
  const keys = h("p", { class: "visually-hidden", id: `strip-chart-help-${++charts}` });
  const rowOf = strips.map(() => ({ canvas: h("canvas", { role: "img" }), readout: h("div.readout") }));
  const elements = strips.map(({ key, isTall }, k) => {
    const { canvas, readout } = rowOf[k];
    const row = h("div.strip", { "data-key": key }, h("div.strip-plot", canvas), readout);
    row.classList.toggle("strip-tall", isTall);
    return row;
  });
  const rows = h("div.strips", elements);
  const axis = h("canvas", { "aria-hidden": "true" });
  const mode = h("span", { class: "chip" });
  const interval = h("span", { class: "strip-interval" });
  const values = h("output", { class: "strip-cursors", "aria-live": "polite" });
  const bar = h("div", { class: "strip-toolbar" }, mode, interval, values);
  const layout = { rows, rowOf, axis, keys, bar: { element: bar, mode, interval, values }, onfold: () => {} };
  const folds = createFolds(strips, elements, rows, () => layout.onfold());
  host.classList.add("strip-chart");
  host.tabIndex = 0;
  host.setAttribute("role", "group");
  host.setAttribute("aria-label", label);
  host.setAttribute("aria-describedby", keys.id);
  host.toggleAttribute("data-many", folds.length > 0);
  host.replaceChildren(...[
    keys,
    rows,
    h("div", { class: "strip-axis" }, h("div", { class: "strip-plot" }, axis)),
    folds.length > 0 && h("div.strip-folds", { role: "group", "aria-label": "Channels by group" }, folds),
    bar,
  ].filter(Boolean));
  return layout;
}

/** A heading for each group of strips that fold, which opens or folds all of them, and the readings of the folded ones. */
function createFolds(strips, elements, rows, changed) {
  const foldable = strips.map((strip, k) => ({ strip, row: elements[k] })).filter(({ strip }) => strip.fold !== null);
  const groups = [...Map.groupBy(foldable, ({ strip }) => strip.fold.group)];
  return groups.map(([name, members]) => foldOf(name, members));

  function foldOf(name, members) {
    const heading = button("", () => turn(members, members.some(isFolded)), { class: "strip-fold" });
    const readings = h("div.strip-readings");
    for (const member of members) {
      const { strip, row } = member;
      row.append(button("", () => turn([member], isFolded(member)), { class: "strip-turn", "aria-label": `Show or fold the strip of ${strip.label}` }));
      if (!strip.fold.isOpen) readings.append(row);
    }
    show();
    return h("div.strip-group", heading, readings);

    function isFolded({ row }) {
      return row.parentNode === readings;
    }

    function turn(some, isOpen) {
      for (const { row } of some) put(row, isOpen ? rows : readings);
      show();
      changed();
    }

    function show() {
      const n = members.filter(isFolded).length;
      heading.textContent = `${n > 0 ? "▸" : "▾"} ${name}`;
      heading.title = n > 0 ? `Show the strips of this group: ${n}` : "Fold the strips of this group";
      heading.setAttribute("aria-expanded", String(n === 0));
    }
  }

  /** In the order of the strips. */
  function put(row, parent) {
    const later = elements.slice(elements.indexOf(row) + 1);
    parent.insertBefore(row, later.find((other) => other.parentNode === parent) ?? null);
  }
}

export function createSheet(canvas) {
  const pen = canvas.getContext("2d", { alpha: false });
  const sheet = { canvas, pen, width: 1, height: 1, palette: {}, hatches: {}, resize, setPalette, clear, clearPlot, paste, isFresh: true, ratio: 1, left: GUTTER };

  function resize(width, height) {
    const px = unit();
    const dense = devicePixelRatio || 1;
    const ratio = px * dense;
    canvas.width = Math.round(width * dense);
    canvas.height = Math.round(height * dense);
    Object.assign(sheet, { width: width / px, height: height / px, ratio, left: Math.round(ratio * GUTTER), isFresh: true });
  }

  function setPalette(palette) {
    const made = ["stale", "alert", "warming"].map((name) => [name, hatch(pen, name, palette)]);
    Object.assign(sheet, { palette, hatches: Object.fromEntries(made), isFresh: true });
  }

  function clear(name = "") {
    const { width, height, palette, ratio, left } = sheet;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.fillStyle = palette.panel;
    pen.fillRect(0, 0, width, height);
    pen.font = `12px ${palette.font}`;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.fillStyle = palette.dim;
    pen.fillText(name, GUTTER - 6, height / 2);
    pen.setTransform(ratio, 0, 0, ratio, left, 0);
    sheet.isFresh = false;
  }

  function clearPlot(from) {
    const { ratio, left } = sheet;
    pen.setTransform(ratio, 0, 0, ratio, left, 0);
    pen.fillStyle = sheet.palette.panel;
    pen.fillRect(from, 0, sheet.width, sheet.height + 1); // pixels at the edges too
  }

  function paste(image, at = sheet.left) {
    const { ratio, left } = sheet;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(image, at, 0);
    pen.setTransform(ratio, 0, 0, ratio, left, 0);
  }

  return sheet;
}
