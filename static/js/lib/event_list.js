/**
 * Events by time, newest first: alerts, exceedances, changes of state, acknowledgements.
 *
 * createEventList(element, {go, label, most}) -> {add(event), times(level) -> [t], showUntil(t)}
 *     go(t)    called when an event is chosen.   most: events kept
 *     showUntil(t)    events later than t [s] move below a separate heading until t reaches them
 *     event: {t [s] | null, at, when, text, level "alert" | "caution" | "", seen}; at: sort key, t by default;
 *     when: shown in place of t. A repeated event (in a loop) is counted, not listed again; `seen` is not counted
 */

import { secondsText } from "./clock.js";
import { formatted, h, put } from "./dom.js";
import { followUnits } from "./numbers.js";

const SAME = 1e-6; // s

export function createEventList(element, { go, label = "Events, newest first", most = 300 }) {
  const list = h("ol.event-list", { "aria-live": "off", "aria-label": label });
  const empty = h(
    "p.dim",
    "Alerts, exceedances and changes of state appear here. Choose one to go to its time.",
  );
  const later = h("ol.event-list.event-later", { "aria-live": "off", "aria-label": "Later than the time shown" });
  const ahead = h("section", { hidden: true }, h("h3.event-later-title", "Later than the time shown"), later);
  element.append(h("h2.event-title", "Events"), empty, list, ahead);
  const known = new Map();
  const timeOf = new WeakMap(); // sort keys of items; null for none
  let until = Infinity;

  const isLater = ({ t }) => t !== null && t > until + SAME;

  function place(event) {
    event.later = isLater(event);
    insert(event, event.later ? later : list);
    ahead.hidden = later.childElementCount === 0;
  }

  /** Newest first; an event without a time stays where it was added. */
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

  function add({ t, at = t, when = null, text, level = "", seen = false }) {
    const key = `${t === null ? "" : t.toFixed(3)} ${text}`;
    const again = known.get(key);
    if (again !== undefined) {
      if (seen) return;
      again.times += 1;
      put(again.count, `×${again.times}`);
      place(again);
      return;
    }
    const [time, count] = [h("span.event-time"), h("span.event-count")];
    const parts = [
      followUnits(time, () => put(time, when ?? (t === null ? "" : secondsText(t)))),
      h("span.event-text", text.split(/(\s+)/).map(formatted)),
      count,
    ];
    const visit = t !== null && { type: "button", title: `Go to ${secondsText(t)}`, onclick: () => go(t) };
    const body = visit ? h("button.event-body", visit, parts) : h("div.event-body", parts);
    const item = h("li.event", { "data-level": level }, body);
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
    times: (level) => [...known.values()].filter((event) => event.level === level && event.t !== null).map(({ t }) => t),
  };
}
