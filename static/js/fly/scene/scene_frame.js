/**
 * The three-dimensional scene of a flight, in its own frame at /scene/{flight}/.
 *
 * viser's client reconnects only while its document has the focus, so the frame pretends to have it.
 * The scene can be hidden on a slow machine. Its camera is remembered, and `camera` in the page's address; a view that
 * the mouse made stays until a camera is chosen or reset.
 *
 * createSceneFrame(element, flight, address) -> {show(frame, hello), nextCamera(), wake(), close(text)}
 *     address: see ../../lib/address.js.   show: the newest sample's attitude in figures, null for none
 *     wake: the server is back.   close: the flight has ended
 */

import { button as buttonOf, h, state } from "../../lib/dom.js";
import { remember, remembered } from "../../lib/storage.js";
import { createAttitudeIndicator } from "./attitude_indicator.js";

const KEY = "forewarn.scene";
const CAMERA = "forewarn.camera";
const CAMERAS = { chase: "Chase", tail: "Tail", side: "Side" };

/** Nothing before viser's client knows its theme. */
const STYLE = `html:not([data-mantine-color-scheme="dark"]) body { visibility: hidden; }`;

export function createSceneFrame(element, flight, address) {
  element.classList.add("scene-panel");
  element.setAttribute("aria-label", "Scene");
  let frame = null;
  let camera = [address.get("camera"), remembered(CAMERA)].find((name) => name in CAMERAS) ?? "chase";
  const indicator = createAttitudeIndicator();
  const cameras = Object.entries(CAMERAS).map(([name, text]) => buttonOf(text, () => look(name), { class: "button button-small", "data-camera": name }));
  const reset = buttonOf("Reset view", () => look(camera), { class: "button button-small", title: "Back to this camera after a move of the mouse" });
  const views = h("div.scene-views", { role: "group", "aria-label": "Camera (key V)" }, cameras, reset);
  const looks = new MutationObserver(paint);
  looks.observe(document.documentElement, { attributeFilter: ["data-theme"] });
  const view = element.closest(".flight");
  looks.observe(view, { attributeFilter: ["data-wall"] });
  const button = h("button", { type: "button", class: "button button-small scene-toggle", onclick: toggle });
  if (remembered(KEY) === "hidden") hide();
  else open();

  function open() {
    frame = h("iframe", { src: `/scene/${encodeURIComponent(flight)}/?camera=${camera}`, title: "Three-dimensional view of the aircraft", onload: check });
    button.textContent = "Hide scene";
    views.append(button);
    press();
    element.replaceChildren(frame, indicator.element, indicator.figures, views);
  }

  function look(name) {
    camera = name;
    remember(CAMERA, name);
    address.set("camera", name);
    address.write();
    press();
    frame?.contentWindow?.lookFrom?.(name);
  }

  function press() {
    for (const each of cameras) each.setAttribute("aria-pressed", String(each.dataset.camera === camera));
  }

  function nextCamera() {
    const names = Object.keys(CAMERAS);
    look(names[(names.indexOf(camera) + 1) % names.length]);
  }

  /** A flight without a scene answers with a problem document. */
  function check() {
    if (frame === null) return;
    const inside = frame.contentDocument; // null where the browser shows its own page
    if (inside?.contentType === "text/html") {
      inside.hasFocus = () => true;
      const style = inside.createElement("style");
      style.textContent = STYLE;
      inside.head.append(style);
      paint();
      inside.addEventListener("keydown", pass);
      return;
    }
    frame = null;
    element.replaceChildren(state("empty", "No scene", "This flight has no scene. Strips and gauge show all assessments."));
  }

  /** In the page's theme, without the words that stand on the page; on the wall without any, which are too small there. */
  function paint() {
    const inside = frame?.contentDocument?.documentElement;
    if (!inside) return;
    inside.dataset.theme = document.documentElement.dataset.theme;
    frame.contentWindow.showWords?.(view.hasAttribute("data-wall") ? "none" : "numbers");
  }

  /** Keys work after a click into the scene too: alarms can still be acknowledged. */
  function pass(event) {
    const { key, ctrlKey, metaKey, altKey, shiftKey } = event;
    const again = { key, ctrlKey, metaKey, altKey, shiftKey, bubbles: true, cancelable: true };
    element.dispatchEvent(new KeyboardEvent("keydown", again));
  }

  function hide() {
    frame = null;
    button.textContent = "Show scene";
    element.replaceChildren(state("empty", "Scene hidden", "Strips and gauge continue.", button));
  }

  function toggle() {
    const hidden = frame !== null;
    remember(KEY, hidden ? "hidden" : "shown");
    if (hidden) hide();
    else open();
  }

  function wake() {
    frame?.contentWindow?.dispatchEvent(new Event("focus"));
  }

  return {
    show: indicator.show,
    nextCamera,
    wake,
    close: (text) => {
      looks.disconnect();
      frame = null;
      element.replaceChildren(...(text ? [state("empty", "No scene", text)] : []));
    },
  };
}
