/**
 * Data quality over time: gaps, repeated, missing and frozen samples.
 *
 * show({clocks: [{start, end}], faults: [{start, end, kind}], sentences: [text]} | null, {start, end} | null)
 *     times in [s];  kind "gap", "missing:beta", ...
 */

import { niceTicks } from "../charts/figure.js";
import { h, sentences, svg } from "../lib/dom.js";
import { durationText, formatTime } from "../lib/numbers.js";

const ALWAYS = {
  gap: "gaps",
  repeated: "repeated times",
  missing: "missing values",
  frozen: "frozen values",
  implausible: "implausible values",
};
const OTHERS = { clock: "clock jumps", reordered: "rows out of order" };
const WORDS = { missing: "missing", frozen: "frozen", implausible: "implausible" };
const LEAST = 0.35; // smallest width of an interval, in % of the strip
const LISTED = 8;

export function createQualityStrip() {
  const element = h("section.panel.stack-tight.quality", { "aria-label": "Data quality" });
  const title = h("h2.panel-title", "Data quality");
  return { element, show };

  function show(quality, range) {
    const none = h("p.dim", "Available once the mapping can be applied.");
    element.replaceChildren(title, ...(quality ? rowsOf(quality, range).filter(Boolean) : [none]));
  }
}

function rowsOf({ clocks, faults, sentences: texts }, range) {
  const extent = range ?? extentOf(clocks);
  const rows = extent && kindsOf(faults).map((kind) => row(kind, faults, extent));
  return [extent && h("div.quality-rows", rows, axis(extent)), sentences(texts)];
}

function extentOf(clocks) {
  if (!clocks.length) return null;
  return { start: Math.min(...clocks.map(({ start }) => start)), end: Math.max(...clocks.map(({ end }) => end)) };
}

const kindOf = (kind) => kind.split(":")[0];

/** Kinds of faults found, one a channel, and the usual kinds even without a fault. */
function kindsOf(faults) {
  const order = Object.keys(ALWAYS);
  const present = [...new Set(faults.map(({ kind }) => kind))];
  const absent = order.filter((kind) => !present.some((found) => kindOf(found) === kind));
  return [...present, ...absent].sort((a, b) => order.indexOf(kindOf(a)) - order.indexOf(kindOf(b)));
}

function row(kind, all, extent) {
  const faults = all.filter((fault) => fault.kind === kind);
  const total = faults.reduce((sum, { start, end }) => sum + end - start, 0);
  const share = (t) => (100 * (t - extent.start)) / (extent.end - extent.start || 1);
  const marks = faults.map(({ start, end }) => {
    const width = Math.max(LEAST, share(end) - share(start));
    return svg("rect", { x: Math.min(100 - width, share(start)), y: 0, width, height: 10 });
  });
  const times = faults.slice(0, LISTED).map(({ start, end }) => `${formatTime(start, 0.01)} to ${formatTime(end, 0.01)} s`);
  const title = times.join(", ") + (faults.length > LISTED ? `, and ${faults.length - LISTED} more` : "");
  const track = { class: "quality-track", viewBox: "0 0 100 10", preserveAspectRatio: "none", "aria-hidden": true };
  return h(
    "div.quality-row",
    { "data-kind": kind, "data-any": String(faults.length > 0), title },
    h("span.quality-name", nameOf(kind)),
    svg("svg", track, svg("rect.quality-track-base", { width: 100, height: 10 }), marks),
    h("span.quality-words", faults.length ? `${faults.length}, ${durationText(total)}` : "none"),
    h("span.visually-hidden", title),
  );
}

function nameOf(kind) {
  const [what, channel] = kind.split(":");
  if (channel) return `${channel} ${WORDS[what] ?? what}`;
  return ALWAYS[kind] ?? OTHERS[kind] ?? kind;
}

function axis({ start, end }) {
  const ticks = niceTicks(start, end, 6).filter((t) => t < end - 0.04 * (end - start));
  const at = (t) => `left: ${(100 * (t - start)) / (end - start)}%`;
  const words = ticks.map((t) => h("span", { style: at(t) }, formatTime(t, (end - start) / 6)));
  const parts = [h("span"), h("div.quality-ticks", words), h("span.dim", "t [s]")];
  return h("div.quality-row.quality-axis", { "aria-hidden": true }, parts);
}
