/**
 * A place for files: drop them anywhere on the page, or choose them.
 *
 * createDropTarget({words, label, hint, take([file]), word, ...attributes}) -> {element, choose(), close()}
 *     label: of the file input.   hint: below the button, or ""
 */

import { button, h } from "../lib/dom.js";

export function createDropTarget({ words, label, hint, take, word = "Choose a file", ...attributes }) {
  const input = h("input", {
    type: "file",
    multiple: true,
    class: "visually-hidden",
    tabindex: -1,
    "aria-label": label,
    onchange: () => {
      take([...input.files]);
      input.value = "";
    },
  });
  const choose = () => input.click();
  const element = h(
    "div.drop-zone",
    attributes,
    h("p.drop-words", words),
    h("div.row", button(word, choose, { class: "button button-primary" }), input),
    hint ? h("p.hint", hint) : null,
  );
  const leaving = new AbortController();
  for (const handler of [dragover, dragleave, drop]) addEventListener(handler.name, handler, { signal: leaving.signal });
  return { element, choose, close: () => leaving.abort() };

  function dragover(event) {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    element.toggleAttribute("data-over", true);
  }

  function dragleave(event) {
    if (event.relatedTarget === null) element.toggleAttribute("data-over", false);
  }

  function drop(event) {
    event.preventDefault();
    element.toggleAttribute("data-over", false);
    const files = [...(event.dataTransfer?.files ?? [])];
    if (files.length) take(files);
  }
}
