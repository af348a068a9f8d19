/**
 * The aircraft that the scenes of a monitor's flights draw: one of the program's, or the user's own as a .glb file.
 *
 * createAirframeChoice({api, id, airframe}) -> element     airframe: as GET /monitors/{id}/airframe has it
 */

import { fileInput } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { button, errorLine, h, put } from "../lib/dom.js";
import { moment } from "../lib/numbers.js";

export function createAirframeChoice({ api, id, airframe }) {
  const path = `/monitors/${id}/airframe`;
  const failure = errorLine();
  const words = h("p", { role: "status" });
  const upload = "POST /monitors/{}/airframe";
  const input = fileInput({ read, failure, accept: ".glb", "aria-label": "Aircraft as a .glb file", ...needs(upload) });
  const remove = button("Remove it", () => failure.attempt(drop), { class: "button button-small", ...needs("DELETE /monitors/{}/airframe") });
  show(airframe);
  return h("div.stack",
    words,
    h("label.row", h("span", "Own aircraft, .glb"), input),
    remove,
    failure.element,
    h("p.hint", "Binary glTF 2.0 of at most 8 MiB with everything inside, +z forward, +y up. It is drawn with the span of the other aircraft, in its materials' colours, without textures; its surfaces do not move. The next flight shows it."));

  function show(known) {
    put(words, known ? `Own aircraft, ${(known.size / 1024).toFixed(0)} KiB, uploaded by ${known.by}, ${moment(known.created)}.` : "Drawn as its class: fighter, transport or trainer.");
    remove.hidden = known === null;
  }

  async function read(file) {
    show(await api.upload(path, file).ended);
  }

  async function drop() {
    await api.delete(path);
    show(null);
  }
}
