/**
 * The three-dimensional scene of a flight, in a frame of its own at /scene/{flight}/.
 *
 * viser's client reconnects only while its document has the focus, so the frame pretends to have it.
 * The scene can be hidden on a slow machine.
 *
 * createSceneFrame(element, flight) -> {wake(), close(text)}     wake: the server is back; close: the flight has ended
 */

import { h, state } from "../lib/dom.js";
import { remember, remembered } from "../lib/storage.js";

const KEY = "forewarn.scene";

/** viser's own panel would cover the aircraft. */
const STYLE = `
  html:not([data-mantine-color-scheme="dark"]) body { visibility: hidden; }
  .mantine-Paper-root, .mantine-Notifications-root { display: none !important; }`;

export function createSceneFrame(element, flight) {
  element.classList.add("scene-panel");
  element.setAttribute("aria-label", "Scene");
  let frame = null;
  const theme = new MutationObserver(paint);
  theme.observe(document.documentElement, { attributeFilter: ["data-theme"] });
  const button = h("button", { type: "button", class: "button button-small scene-toggle", onclick: toggle });
  if (remembered(KEY) === "hidden") hide();
  else open();

  function open() {
    frame = h("iframe", { src: `/scene/${encodeURIComponent(flight)}/`, title: "Three-dimensional view of the aircraft", onload: check });
    button.textContent = "Hide scene";
    element.replaceChildren(frame, button);
  }

  /** A flight without a scene answers with a problem document. */
  function check() {
    if (frame === null) return;
    const inside = frame.contentDocument; // null where the browser shows a page of its own
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

  function paint() {
    const inside = frame?.contentDocument?.documentElement;
    if (inside) inside.dataset.theme = document.documentElement.dataset.theme;
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
    wake,
    close: (text) => {
      theme.disconnect();
      frame = null;
      element.replaceChildren(...(text ? [state("empty", "No scene", text)] : []));
    },
  };
}
