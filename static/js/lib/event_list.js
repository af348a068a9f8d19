/**
 * What happened, by its time, newest first: alerts, exceedances, changes of state, acknowledgements.
 *
 * Exports
 *   createEventList(element, {go, label, most}) -> {add(event), times(level) -> [t], showUntil(t), clear()}
 *     go(t)    called when an event is chosen.   label: what the list is called.   most: events kept
 *     showUntil(t)    those later than t [s] are set apart under a heading of their own, until t has passed them
 *     event: {t [s] | null, at, when, text, level "alert" | "caution" | "", seen}; at: by which it is sorted, t unless given; when: said in the place of t; the same one again (a loop
 *     flies past it each time round) is counted, not repeated, and not even counted where `seen`
 */

import { formatted, h, put } from "./dom.js";
import { formatTime } from "./numbers.js";

const SAME = 1e-6; // s

export function createEventList(element, { go, label = "Events, newest first", most = 300 }) {
  const title = h("h2", { class: "event-title" }, "Events");
  const list = h("ol", { class: "event-list", "aria-live": "off", "aria-label": label });
  const empty = h(
    "p",
    { class: "dim" },
    "Alerts, exceedances and changes of state are listed here; choose one to go there.",
  );
  const later = h("ol", { class: "event-list event-later", "aria-live": "off", "aria-label": "Later than the time shown" });
  const ahead = h("section", { hidden: true }, h("h3", { class: "event-later-title" }, "Later than the time shown, seen before"), later);
  element.append(title, empty, list, ahead);
  const known = new Map();
  const timeOf = new WeakMap(); // of items, by which they are sorted; null for none
  let until = Infinity;

  const isLater = ({ t }) => t !== null && t > until + SAME;

  function place(event) {
    event.later = isLater(event);
    insert(event, event.later ? later : list);
    ahead.hidden = later.childElementCount === 0;
  }

  /** By the time of the event, newest first; what has none stays where it was added. */
  function insert({ item, at }, into) {
    timeOf.set(item, at);
    const newer = at === null ? [] : [...into.children].filter((one) => one !== item && timeOf.get(one) > at + SAME);
    if (newer.length > 0) newer.at(-1).after(item);
    else into.prepend(item);
  }

  function showUntil(t) {
    until = t;
    const moved = [...known.values()].filter((event) => isLater(event) !== event.later);
    moved.sort((a, b) => a.t - b.t).forEach(place);
  }

  function add({ t, at = t, when, text, level = "", seen = false }) {
    const key = `${t === null ? "" : t.toFixed(3)} ${text}`;
    const again = known.get(key);
    if (again !== undefined && seen) return;
    if (again !== undefined) {
      again.times += 1;
      put(again.count, `×${again.times}`);
      place(again);
      return;
    }
    const count = h("span", { class: "event-count" });
    const parts = [
      h("span", { class: "event-time" }, when ?? (t === null ? "" : `${formatTime(t, 0.01)} s`)),
      h("span", { class: "event-text" }, text.split(/(\s+)/).map(formatted)),
      count,
    ];
    const body =
      t === null
        ? h("div", { class: "event-body" }, ...parts)
        : h(
            "button",
            {
              type: "button",
              class: "event-body",
              title: `Go to ${formatTime(t, 0.01)} s`,
              onclick: () => go(t),
            },
            ...parts,
          );
    const item = h("li", { class: "event", "data-level": level }, body);
    const event = { item, count, times: 1, t, at, level };
    known.set(key, event);
    place(event);
    empty.hidden = true;
    if (known.size > most) {
      const [oldest, { item: gone }] = known.entries().next().value;
      gone.remove();
      known.delete(oldest);
    }
  }

  return {
    add,
    showUntil,
    times: (level) =>
      [...known.values()]
        .filter((event) => event.level === level && event.t !== null)
        .map(({ t }) => t),
    clear: () => {
      known.clear();
      list.replaceChildren();
      later.replaceChildren();
      ahead.hidden = true;
      empty.hidden = false;
    },
  };
}
