/**
 * Rows of markers and notes: go to, edit, delete.
 *
 * Exports
 *   createNoteList({go, save, remove}) -> {element, show(markers)}
 *     go(t).   save(marker, text) -> Promise<bool>.   remove(marker)
 *   noteSign(kind) -> string     "■" of a note, "▼" of a marker
 */

import { h } from "../lib/dom.js";
import { secondsText } from "../lib/numbers.js";
import { button } from "../lib/view_states.js";

const NONE = "No notes yet. Notes are stored with the recording and printed in its report.";

export function createNoteList({ go, save, remove }) {
  const element = h("ul", { class: "note-list" });
  let markers = [];
  let editing = null;

  function show(given) {
    markers = given;
    const rows = markers.map((marker) => (marker.id === editing ? editor(marker) : row(marker)));
    element.replaceChildren(...(rows.length ? rows : [h("li", { class: "dim" }, NONE)]));
  }

  function edit(id) {
    editing = id;
    show(markers);
    element.querySelector("input")?.focus();
  }

  function row(marker) {
    const { kind, t, end, text } = marker;
    const when = end === null ? secondsText(t) : `${secondsText(t)} to ${secondsText(end)}`;
    return h(
      "li",
      { class: "note", "data-kind": kind },
      h(
        "button",
        {
          type: "button",
          class: "link-button note-time",
          onclick: () => go(t),
          title: "Go there",
        },
        `${noteSign(kind)} ${when}`,
      ),
      h("span", { class: "note-text" }, text),
      h(
        "span",
        { class: "note-acts" },
        small("Edit", () => edit(marker.id), `Edit: ${text}`),
        small("Delete", () => remove(marker), `Delete: ${text}`),
      ),
    );
  }

  function editor(marker) {
    const input = h("input", {
      type: "text",
      value: marker.text,
      maxlength: 2000,
      "aria-label": "text of the note",
    });
    const submit = async (event) => {
      event.preventDefault();
      if (await save(marker, input.value.trim() || marker.text)) edit(null);
    };
    return h(
      "li",
      { class: "note" },
      h(
        "form",
        { class: "note-form", onsubmit: submit },
        h("div", { class: "field" }, input),
        h(
          "div",
          { class: "row" },
          h("button", { class: "button button-small", type: "submit" }, "Save"),
          small("Cancel", () => edit(null)),
        ),
      ),
    );
  }

  return { element, show };
}

export function noteSign(kind) {
  return kind === "note" ? "■" : "▼";
}

function small(words, pressed, label = null) {
  return button(words, pressed, { class: "button button-small", "aria-label": label });
}
