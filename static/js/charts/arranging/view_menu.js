/**
 * What changes the view of a chart, in a menu that opens over it.
 *
 * createViewMenu(items) -> element
 */

import { h } from "../../lib/dom.js";

export function createViewMenu(items) {
  const menu = h("details.view-menu", h("summary", { class: "button button-small", "aria-label": "View: layout, time, files" }, "View"), h("div.view-items", items));
  menu.addEventListener("focusout", ({ relatedTarget }) => {
    if (relatedTarget !== null && !menu.contains(relatedTarget)) menu.open = false;
  });
  menu.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    menu.open = false;
    menu.firstChild.focus();
  });
  return menu;
}
