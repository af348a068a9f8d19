/**
 * A list of which the server sends the newest entries: a search box, and a button that shows more of it.
 *
 * createLongList({api, path, search, step, show, address}) -> {box, more, load()}
 *     path   "/recordings", or with its own query, or a function that gives it; entries are searched by its parameter `text`
 *     search    label of the box;   step    entries to begin with, and how many more each time
 *     show(entries, text)    called at each answer, with what was searched for
 *     address    Address that keeps the text as `find`, if given
 * load() -> Promise    ask again; rejects with an ApiError
 */

import { button, errorLine, h } from "./dom.js";

const MOST = 1000; // entries that the server sends at once
const TYPING = 250; // ms

export function createLongList({ api, path, search, step, show, address = null }) {
  let limit = step;
  let timer = 0;
  let asked = "";
  const input = h("input.list-search", { type: "search", placeholder: search, "aria-label": search, value: address?.get("find") ?? "", oninput: typed });
  const failure = errorLine();
  const next = button("Show more", showMore, { class: "button button-small", hidden: true });
  return { box: input, more: h("div", next, failure.element), load };

  async function load() {
    const query = new URLSearchParams({ limit, ...(input.value.trim() && { text: input.value.trim() }) });
    const place = typeof path === "function" ? path() : path;
    const address = `${place}${place.includes("?") ? "&" : "?"}${query}`;
    asked = address;
    const entries = await api.get(address);
    if (asked !== address) return; // another text was typed meanwhile
    next.hidden = entries.length < limit || limit === MOST;
    show(entries, input.value.trim());
  }

  function showMore() {
    limit = Math.min(limit + step, MOST);
    failure.attempt(load);
  }

  function typed() {
    clearTimeout(timer);
    limit = step;
    address?.set("find", input.value.trim() || null);
    timer = setTimeout(() => failure.attempt(load), TYPING);
  }
}
