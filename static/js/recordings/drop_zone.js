/** Upload recordings: drop files anywhere on the page, or choose them. Each shows its progress. */

import { labelled, textInput } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { button, h } from "../lib/dom.js";
import { createUploads } from "./uploads.js";

const LONGEST_NAME = 200;

export function knownNames(id, names) {
  const options = names.map((value) => h("option", { value }));
  return { element: h("datalist", { id }, options), attributes: { list: id, maxlength: LONGEST_NAME, autocomplete: "off" } };
}

export function createDropZone({ aircraft, formats, done }) {
  const input = h("input", {
    type: "file",
    multiple: true,
    class: "visually-hidden",
    tabindex: -1,
    "aria-label": "recorded telemetry file",
    onchange: () => {
      uploads.send([...input.files]);
      input.value = "";
    },
  });
  const known = knownNames("known-aircraft", aircraft);
  const name = textInput({ ...known.attributes, placeholder: "optional, such as PH-LAB" });
  const uploads = createUploads({ aircraft: () => name.value.trim(), done });
  const zone = h(
    "div.drop-zone",
    { ...needs("POST /recordings") },
    h("p.drop-words", "Drop a recording anywhere on this page"),
    h("div.row", button("Choose a file", () => input.click(), { class: "button button-primary" }), input),
    formats.length ? h("p.hint", `Formats: ${formats.join(", ")}`) : null,
  );
  const named = labelled("Aircraft", name, {
    hint: "Forewarn remembers the mapping for this aircraft and proposes it next time.",
  });
  const element = h(
    "section.panel.stack",
    { "aria-label": "Upload" },
    h("div.upload-columns", zone, h("div", named.element, known.element)),
    uploads.element,
  );
  const leaving = new AbortController();
  for (const handler of [dragover, dragleave, drop]) addEventListener(handler.name, handler, { signal: leaving.signal });

  function dragover(event) {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    zone.toggleAttribute("data-over", true);
  }

  function dragleave(event) {
    if (event.relatedTarget === null) zone.toggleAttribute("data-over", false);
  }

  function drop(event) {
    event.preventDefault();
    zone.toggleAttribute("data-over", false);
    uploads.send([...(event.dataTransfer?.files ?? [])]);
  }

  return {
    element,
    choose: () => input.click(),
    close: () => {
      leaving.abort();
      uploads.close();
    },
  };
}
