/**
 * What a panel says while it has nothing to show, and texts that change only when they differ.
 *
 * Exports
 *   state(kind, title, text, ...actions) -> section    kind "empty" | "loading" | "error"
 *   put(element, text)
 */

import { h } from "./dom.js";

export function state(kind, title, text, ...actions) {
  const role = kind === "error" ? "alert" : "status";
  const row = actions.length > 0 ? h("div", { class: "row" }, actions) : null;
  return h("section", { class: `state-${kind}`, role }, h("h2", {}, title), h("p", {}, text), row);
}

export function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
