/**
 * Keep a flight or a recording for ever, or release it.
 *
 * Exports  createKeepButton({api, path, keep, fail, attributes}) -> <button>
 *   path: of the thing.   keep: whether it is kept now.   fail(error): the server refused
 */

import { put } from "./dom.js";
import { needs } from "./me.js";
import { button } from "./view_states.js";

export function createKeepButton({ api, path, keep, fail, attributes = {} }) {
  let kept = keep;
  const element = button("", press, { ...attributes, ...needs(`PUT ${path.replace(/[^/]+$/, "{}")}/keep`) });
  show();

  function show() {
    put(element, kept ? "✓ Kept for ever" : "Keep for ever");
    element.setAttribute("aria-pressed", String(kept));
    element.title = kept ? "Neither retention nor anybody deletes it; press to release it" : "Neither retention nor anybody deletes it then";
  }

  async function press() {
    element.disabled = true;
    try {
      kept = (await api.put(`${path}/keep`, { keep: !kept })).keep;
      show();
    } catch (error) {
      fail(error);
    }
    element.disabled = false;
  }

  return element;
}
