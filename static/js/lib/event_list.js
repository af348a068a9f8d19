/**
 * What happened, newest first: alerts, exceedances, changes of state, acknowledgements.
 *
 * Exports
 *   createEventList(element, {go, label, most}) -> {add(event), times(level) -> [t], clear()}
 *     go(t)    called when an event is chosen.   label: what the list is called.   most: events kept
 *     event: {t [s] | null, text, level "alert" | "caution" | "", seen}; the same one again (a loop
 *     flies past it each time round) is counted, not repeated, and not even counted where `seen`
 */

import { formatted, h, put } from "./dom.js";
import { formatTime } from "./numbers.js";

export function createEventList(element, { go, label = "Events, newest first", most = 300 }) {
  const title = h("h2", { class: "event-title" }, "Events");
  const list = h("ol", { class: "event-list", "aria-live": "off", "aria-label": label });
  const empty = h(
    "p",
    { class: "dim" },
    "Alerts, exceedances and changes of state are listed here; choose one to go there.",
  );
  element.append(title, empty, list);
  const known = new Map();

  function add({ t, text, level = "", seen = false }) {
    const key = `${t === null ? "" : t.toFixed(3)} ${text}`;
    const again = known.get(key);
    if (again !== undefined && seen) return;
    if (again !== undefined) {
      again.times += 1;
      put(again.count, `×${again.times}`);
      list.prepend(again.item);
      return;
    }
    const count = h("span", { class: "event-count" });
    const parts = [
      h("span", { class: "event-time" }, t === null ? "" : `${formatTime(t, 0.01)} s`),
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
    known.set(key, { item, count, times: 1, t, level });
    list.prepend(item);
    empty.hidden = true;
    if (known.size > most) {
      const [oldest, { item: gone }] = known.entries().next().value;
      gone.remove();
      known.delete(oldest);
    }
  }

  return {
    add,
    times: (level) =>
      [...known.values()]
        .filter((event) => event.level === level && event.t !== null)
        .map(({ t }) => t),
    clear: () => {
      known.clear();
      list.replaceChildren();
      empty.hidden = false;
    },
  };
}
