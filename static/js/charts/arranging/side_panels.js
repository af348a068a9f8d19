/**
 * The panels beside the strips: shown, hidden, in another order, magnified; or one of them alone in a separate window.
 *
 * arrangePanels(address, column, {name: {label, element}}) -> Arrangement     see arrangement.js; kept in the address as `panels`
 *     column: holds the elements.   A frame is never moved, since it would load again: the others move around it
 * showAlone(view, address, panels) -> name | null     of the part that the address wants alone (`only`), as data-only of the view;
 *     the style sheet hides the other parts, except those that tell of alarms, of the link and of the end
 * namesAlone(panels) -> {name: word}     of the parts that may be alone
 * openAlone(name)     in a second window
 */

import { createArrangement } from "./arrangement.js";
import { dragInOrder } from "./drag_order.js";

export const ONLY = "only";

export function arrangePanels(address, column, panels) {
  const keys = Object.keys(panels);
  const parts = keys.map((key) => ({ key, label: panels[key].label, ways: ["shown", "hidden"], factor: null, unit: "" }));
  const arrangement = createArrangement(address, "panels", keys.map((key) => ({ key, as: "shown" })), parts);
  const usual = keys.join();
  arrangement.subscribe(place);
  place();
  dragInOrder(column, "h2", (part) => keys.find((key) => panels[key].element === part) ?? null, arrangement);
  return arrangement;

  function place() {
    const { items, shown } = arrangement;
    const elements = items.map(({ key }) => panels[key].element);
    const still = elements.find((element) => element.querySelector("iframe") !== null);
    const isUsual = items.every(({ key, size }) => size === 1 && shown(key) === "shown") && items.map(({ key }) => key).join() === usual;
    column.toggleAttribute("data-arranged", !isUsual);
    column.toggleAttribute("data-away", items.every(({ key }) => shown(key) === "hidden"));
    for (const { key, size } of items) {
      panels[key].element.toggleAttribute("data-away", shown(key) === "hidden");
      panels[key].element.style.setProperty("--size", String(size));
    }
    if (isUsual && !column.hasAttribute("data-moved")) return;
    column.setAttribute("data-moved", "");
    const focused = document.activeElement;
    const at = elements.indexOf(still);
    elements.slice(0, Math.max(0, at)).forEach((element) => still.before(element));
    elements.slice(at + 1).forEach((element) => column.append(element));
    if (document.activeElement !== focused && column.contains(focused)) /** @type {any} */ (focused).focus({ preventScroll: true });
  }
}

export const namesAlone = ({ parts }) => ({ strips: "Strips", cross: "Cross plots", ...Object.fromEntries(parts.map(({ key, label }) => [key, label])) });

export function showAlone(view, address, panels) {
  const name = address.get(ONLY);
  if (name === null || !Object.hasOwn(namesAlone(panels), name)) return null;
  view.dataset.only = name;
  return name;
}

export function openAlone(name) {
  const [path, search] = location.hash.split("?");
  const query = new URLSearchParams(search);
  query.set(ONLY, name);
  window.open(`${location.pathname}${path}?${query}`, "_blank", "popup,width=960,height=720");
}
