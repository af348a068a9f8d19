/**
 * The elements of a strip chart: a row for each strip, the time axis, the tool bar.
 *
 * layOut(host, strips, label, arrangement) -> {rows, rowOf: [{canvas, readout}], axis, keys, arrangement, bar: {element, mode, interval, values}, onchange}
 *     strips: as arranged by strips.js; of one that is a number only the reading is shown, below the time axis
 *     arrangement: of arranging/arrangement.js.   keys: element for what the keys do.   bar: its buttons follow the other elements
 *     onchange(): to be set; the arrangement changed
 * stripArrangement(address, strips) -> Arrangement of them
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

import { channelName } from "../lib/catalog.js";
import { button, h } from "../lib/dom.js";
import { shownIn } from "../lib/numbers.js";
import { createArrangement } from "./arranging/arrangement.js";
import { hatch } from "./palette.js";

export const GUTTER = 46;

const WAYS = ["shown", "number", "hidden"];

export const unit = () => parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;

let charts = 0;

export function stripArrangement(address, strips) {
  const usual = strips.map(({ key, fold }) => ({ key, as: fold === null || fold.isOpen ? "shown" : "number" }));
  const parts = strips.map((strip) => {
    const { factor, unit } = shownIn(strip);
    return { key: strip.key, label: channelName(strip), ways: WAYS, factor: strip.risk ? null : factor, unit };
  });
  return createArrangement(address, "strips", usual, parts);
}

export function layOut(host, strips, label, arrangement) {
  const keys = h("p", { class: "visually-hidden", id: `strip-chart-help-${++charts}` });
  const rowOf = strips.map(() => ({ canvas: h("canvas", { role: "img" }), readout: h("div.readout"), back: h("p.strip-back", { hidden: true }, "▲ hidden by the layout, shown since it exceeded its limit") }));
  const elements = strips.map(({ key, isTall, label: name }, k) => {
    const { canvas, readout, back } = rowOf[k];
    const turn = button("", () => arrangement.change(key, { as: arrangement.shown(key) === "shown" ? "number" : "shown" }), { class: "strip-turn", "aria-label": `Show or fold the strip of ${name}` });
    const row = h("div.strip", { "data-key": key }, h("div.strip-plot", canvas), readout, back, turn);
    row.classList.toggle("strip-tall", isTall);
    return row;
  });
  const rows = h("div.strips");
  const axis = h("canvas", { "aria-hidden": "true" });
  const mode = h("span", { class: "chip" });
  const interval = h("span", { class: "strip-interval" });
  const values = h("output", { class: "strip-cursors", "aria-live": "polite" });
  const bar = h("div", { class: "strip-toolbar" }, mode, interval, values);
  const layout = { rows, rowOf, axis, keys, arrangement, bar: { element: bar, mode, interval, values }, onchange: () => {} };
  const foldable = strips.filter(({ fold }) => fold !== null);
  const groups = [...Map.groupBy(foldable, ({ fold }) => fold.group)].map(([name, members]) => createGroup(name, members, arrangement));
  const numbers = h("div.strip-readings", { role: "group", "aria-label": "Numbers" });
  const folds = h("div.strip-folds", { role: "group", "aria-label": "Channels by group" }, numbers, groups.map(({ element }) => element));
  host.classList.add("strip-chart");
  host.tabIndex = 0;
  host.setAttribute("role", "group");
  host.setAttribute("aria-label", label);
  host.setAttribute("aria-describedby", keys.id);
  host.toggleAttribute("data-many", groups.length > 0);
  host.replaceChildren(keys, rows, h("div", { class: "strip-axis" }, h("div", { class: "strip-plot" }, axis)), bar);
  arrangement.subscribe(place);
  place();
  return layout;

  function place() {
    const focused = document.activeElement;
    const ordered = arrangement.items.map((item) => {
      const k = strips.findIndex(({ key }) => key === item.key);
      const as = arrangement.shown(item.key);
      rowOf[k].back.hidden = !arrangement.isForced(item.key);
      elements[k].style.setProperty("--size", String(item.size));
      strips[k].axis.fix(item.range);
      return { as, group: groups.find(({ name }) => name === strips[k].fold?.group), row: elements[k] };
    });
    const rowsOf = (wanted) => ordered.filter(wanted).map(({ row }) => row);
    put(rows, rowsOf(({ as }) => as === "shown"));
    put(numbers, rowsOf(({ as, group }) => as === "number" && group === undefined));
    for (const each of groups) {
      put(each.readings, rowsOf(({ as, group }) => as === "number" && group === each));
      each.show();
    }
    numbers.hidden = numbers.childElementCount === 0;
    if (numbers.hidden && groups.every(({ element }) => element.hidden)) folds.remove();
    else if (folds.parentNode === null) bar.before(folds);
    if (host.contains(focused) && document.activeElement !== focused) /** @type {any} */ (focused).focus({ preventScroll: true });
    layout.onchange();
  }
}

function put(parent, rows) {
  if (rows.length !== parent.childElementCount || rows.some((row, k) => parent.children[k] !== row)) parent.replaceChildren(...rows);
}

/** A heading that opens or folds all strips of a group, and the readings of the folded ones. */
function createGroup(name, members, arrangement) {
  const isFolded = ({ key }) => arrangement.shown(key) === "number";
  const heading = button("", turn, { class: "strip-fold" });
  const readings = h("div.strip-readings");
  const element = h("div.strip-group", heading, readings);
  return { name, element, readings, show };

  function turn() {
    const as = members.some(isFolded) ? "shown" : "number";
    for (const { key } of members) if (arrangement.shown(key) !== "hidden") arrangement.change(key, { as });
  }

  function show() {
    const n = members.filter(isFolded).length;
    element.hidden = members.every(({ key }) => arrangement.shown(key) === "hidden");
    heading.textContent = `${n > 0 ? "▸" : "▾"} ${name}`;
    heading.title = n > 0 ? `Show the strips of this group: ${n}` : "Fold the strips of this group";
    heading.setAttribute("aria-expanded", String(n === 0));
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
