/**
 * The lane above a recording's strips: its manoeuvres with their outcome, its markers and notes.
 *
 * Exports
 *   createEventLane(element, {chosen}) -> {show(items), draw({view})}
 *     items: [{id, row, start, end | null, text, short, mark, level, title, quiet}] times in [s]; row: 0
 *       is the top one; short: used where the text does not fit; mark: sign of the level, besides its
 *       colour; quiet: only a bar, no button
 *     chosen(item)   one was pressed
 */

import { h } from "../../lib/dom.js";

const ROW = 26; // px
const THIN = 16; // px a manoeuvre below which only its bar is seen

export function createEventLane(element, { chosen }) {
  const plot = h("div", { class: "lane-plot" });
  element.classList.add("event-lane");
  element.append(plot);
  let parts = [];

  function show(items) {
    parts = items.map((item) => ({ item, element: elementOf(item) }));
    plot.replaceChildren(...parts.map((part) => part.element));
    const rows = Math.max(0, ...items.map(({ row }) => row + 1));
    element.hidden = rows === 0;
    plot.style.height = `${rows * ROW}px`;
  }

  function elementOf(item) {
    const words = h(
      "span",
      { class: item.short ? "lane-words lane-fits" : "lane-words" },
      h("span", { class: "lane-mark", "aria-hidden": true }, item.mark ?? ""),
      h("span", { class: "lane-long" }, item.text),
      item.short ? h("span", { class: "lane-short" }, item.short) : null,
    );
    const attributes = {
      class: item.end === null ? "lane-item lane-flag" : "lane-item",
      "data-level": item.level,
      "data-item": item.id,
      title: item.title,
      style: `top: ${item.row * ROW}px`,
    };
    if (item.quiet) return h("span", attributes, words);
    const label = `${item.title ?? item.text}. Show it.`;
    const press = () => chosen(item); // by key: from the tables and lists that name the same
    return h(
      "button",
      { type: "button", tabindex: -1, ...attributes, "aria-label": label, onclick: press },
      words,
    );
  }

  function draw({ view: { start, end } }) {
    const share = (t) => (100 * (t - start)) / (end - start);
    const thin = (100 * THIN) / Math.max(1, plot.clientWidth);
    for (const { item, element: part } of parts) {
      const [from, to] = [share(item.start), share(item.end ?? item.start)];
      part.hidden = to < 0 || from > 100;
      if (part.hidden) continue;
      const left = Math.max(0, from);
      part.style.left = `${left}%`;
      part.style.width = item.end === null ? "" : `${Math.min(100, to) - left}%`;
      part.toggleAttribute("data-thin", item.end !== null && to - from < thin);
      part.toggleAttribute("data-cut-left", from < -0.01);
      part.toggleAttribute("data-cut-right", to > 100.01);
    }
  }

  return { show, draw };
}
