/**
 * Keep a flight or a recording permanently, or release it.
 *
 * Exports  createKeepButton({api, path, keep, fail, name, attributes}) -> <button>
 *   path: of the flight or recording.   keep: whether it is kept.   fail(error): the server refused
 *   name: read aloud after the button's text, where a page has several
 */

import { h } from "./dom.js";
import { needs } from "./me.js";
import { button } from "./view_states.js";

export function createKeepButton({ api, path, keep, fail, name = "", attributes = {} }) {
  let isKept = keep;
  const element = button("", press, { ...attributes, ...needs(`PUT ${path.replace(/[^/]+$/, "{}")}/keep`) });
  show();

  function show() {
    const hidden = name && h("span", { class: "visually-hidden" }, ` ${name}`);
    element.replaceChildren(isKept ? "✓ Kept permanently" : "Keep permanently", hidden);
    element.setAttribute("aria-pressed", String(isKept));
    element.title = isKept ? "Protected from deletion; press to release it" : "Protect it from deletion by retention and by people";
  }

  async function press() {
    element.disabled = true;
    try {
      isKept = (await api.put(`${path}/keep`, { keep: !isKept })).keep;
      show();
    } catch (error) {
      fail(error);
    }
    element.disabled = false;
  }

  return element;
}
