/**
 * Markers and notes on a recording: at the cursor, or from A to B.
 *
 * Exports
 *   createNotesPanel({api, recording, place, go, changed}) -> {element, load(), quick(), moved()}
 *     place() -> {t, end | null} | null    of the chart's cursors.   go(t)
 *     changed([marker])    after each change.   quick(): adds a marker without text at the cursor
 *     moved(): the cursors moved
 *   laneOfMarkers(markers, row) -> [item]    for a chart's lane
 */

import { reason } from "../lib/api.js";
import { h, put } from "../lib/dom.js";
import { keepDraft } from "../lib/drafts.js";
import { needs } from "../lib/me.js";
import { secondsText } from "../lib/numbers.js";
import { button, errorLine } from "../lib/view_states.js";
import { createNoteList, noteSign } from "./note_list.js";

export function createNotesPanel({ api, recording, place, go, changed }) {
  const path = `/recordings/${recording}/markers`;
  let markers = [];
  const list = createNoteList({ go, save, remove });
  const text = h("input", {
    type: "text",
    maxlength: 2000,
    "aria-label": "text of the note",
    placeholder: "what happened here?",
  });
  const clear = keepDraft(text, path);
  const where = h("span", { class: "hint" });
  const add = h("button", { class: "button button-small", type: "submit" }, "Add note");
  const flag = button("Set marker", quick, {
    class: "button button-small",
    title: "Marker without text (key M on the strips)",
  });
  const failure = errorLine();
  const element = h(
    "section",
    { class: "event-panel notes-panel", "aria-label": "Notes" },
    h("h2", { class: "event-title" }, "Notes and markers"),
    h(
      "form",
      { class: "note-form", onsubmit: send, "aria-label": "Add a note", ...needs("POST /recordings/{}/markers") },
      h("div", { class: "field" }, text),
      h("div", { class: "row" }, add, flag, where),
    ),
    failure.element,
    list.element,
  );
  moved();

  function moved() {
    const at = place();
    put(where, at === null ? "Click on the strips to choose the time" : placeText(at));
    add.disabled = flag.disabled = at === null;
  }

  function placeText({ t, end }) {
    return end === null ? `at ${secondsText(t)}` : `${secondsText(t)} to ${secondsText(end)}`;
  }

  async function send(event) {
    event.preventDefault();
    const words = text.value.trim();
    if (!words) text.focus();
    else if (await create({ ...place(), text: words, kind: "note" })) clear();
  }

  function quick() {
    if (place() === null) return;
    const n = markers.filter(({ kind }) => kind === "marker").length + 1;
    create({ ...place(), text: `marker ${n}`, kind: "marker" });
  }

  function load() {
    return attempt(async () => showMarkers(await api.get(path)));
  }

  function create(marker) {
    return attempt(async () => showMarkers([...markers, await api.post(path, marker)]));
  }

  function save({ id, t, end, kind }, text) {
    return attempt(async () => {
      const saved = await api.put(`${path}/${id}`, { t, end, kind, text });
      showMarkers(markers.map((marker) => (marker.id === id ? saved : marker)));
    });
  }

  function remove({ id }) {
    return attempt(async () => {
      await api.delete(`${path}/${id}`);
      showMarkers(markers.filter((marker) => marker.id !== id));
    });
  }

  async function attempt(act) {
    failure.show("");
    try {
      await act();
      return true;
    } catch (error) {
      failure.show(reason(error));
      return false;
    }
  }

  function showMarkers(given) {
    markers = [...given].sort((a, b) => a.t - b.t);
    list.show(markers);
    changed(markers);
  }

  return { element, load, quick, moved };
}

export function laneOfMarkers(markers, row) {
  return markers.map(({ id, t, end, text, kind }) => ({
    id: `marker-${id}`,
    t,
    row,
    start: t,
    end,
    text,
    mark: noteSign(kind),
    level: "plain",
    title: `${kind}, ${secondsText(t)}: ${text}`,
  }));
}
