/**
 * Markers and notes on a recording, at the cursor or from A to B: add, go to, edit, delete.
 *
 * place() -> {t, end | null} | null    of the chart's cursors.   changed([marker])    after each change
 * quick(): adds a marker without text at the cursor.   moved(): the cursors moved
 */

import { textInput } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { secondsText } from "../lib/clock.js";
import { button, errorLine, h, put } from "../lib/dom.js";

const LONGEST = 2000;
const NONE = "No notes yet. Notes are stored with the recording and printed in its report.";
const signOf = (kind) => (kind === "note" ? "■" : "▼");
const small = (words, pressed, attributes = {}) => button(words, pressed, { class: "button button-small", ...attributes });
const submit = (words) => h("button.button.button-small", { type: "submit" }, words);
const noteInput = (attributes) => textInput({ maxlength: LONGEST, "aria-label": "text of the note", ...attributes });

function timesOf({ t, end }, before = "") {
  return end === null ? `${before}${secondsText(t)}` : `${secondsText(t)} to ${secondsText(end)}`;
}

export function createNotesPanel({ api, recording, place, go, changed }) {
  const path = `/recordings/${recording}/markers`;
  let markers = [];
  let editing = null;
  const list = h("ul.note-list");
  const text = noteInput({ placeholder: "what happened here?" });
  const where = h("span.hint");
  const add = submit("Add note");
  const flag = small("Set marker", quick, { title: "Marker without text (key M on the strips)" });
  const failure = errorLine();
  const element = h(
    "section.event-panel.notes-panel",
    { "aria-label": "Notes" },
    h("h2.event-title", "Notes and markers"),
    h(
      "form.note-form",
      { onsubmit: send, "aria-label": "Add a note", ...needs("POST /recordings/{}/markers") },
      h("div.field", text),
      h("div.row", add, flag, where),
    ),
    failure.element,
    list,
  );
  const { attempt } = failure;
  const load = () => attempt(async () => show(await api.get(path)));
  moved();
  return { element, load, quick, moved };

  function moved() {
    const at = place();
    put(where, at === null ? "Click on the strips to choose the time" : timesOf(at, "at "));
    add.disabled = flag.disabled = at === null;
  }

  async function send(event) {
    event.preventDefault();
    const words = text.value.trim();
    if (!words) text.focus();
    else if (await create({ ...place(), text: words, kind: "note" })) text.value = "";
  }

  function quick() {
    if (place() === null) return;
    const n = markers.filter(({ kind }) => kind === "marker").length + 1;
    create({ ...place(), text: `marker ${n}`, kind: "marker" });
  }

  function create(marker) {
    return attempt(async () => show([...markers, await api.post(path, marker)]));
  }

  function save({ id, t, end, kind }, words) {
    return attempt(async () => {
      const saved = await api.put(`${path}/${id}`, { t, end, kind, text: words });
      editing = null;
      show(markers.map((marker) => (marker.id === id ? saved : marker)));
    });
  }

  function remove({ id }) {
    return attempt(async () => {
      await api.delete(`${path}/${id}`);
      show(markers.filter((marker) => marker.id !== id));
    });
  }

  function show(given) {
    markers = [...given].sort((a, b) => a.t - b.t);
    draw();
    changed(markers);
  }

  function draw() {
    const rows = markers.map((marker) => (marker.id === editing ? editor(marker) : row(marker)));
    list.replaceChildren(...(rows.length ? rows : [h("li.dim", NONE)]));
  }

  function edit(id) {
    editing = id;
    draw();
    list.querySelector("input")?.focus();
  }

  function row(marker) {
    const { id, kind, t, text: words } = marker;
    const visit = { type: "button", class: "link-button note-time", onclick: () => go(t), title: "Go there" };
    const acts = [
      small("Edit", () => edit(id), { "aria-label": `Edit: ${words}` }),
      small("Delete", () => remove(marker), { "aria-label": `Delete: ${words}` }),
    ];
    const time = h("button", visit, `${signOf(kind)} ${timesOf(marker)}`);
    return h("li.note", { "data-kind": kind }, time, h("span.note-text", words), h("span.note-acts", acts));
  }

  function editor(marker) {
    const input = noteInput({ value: marker.text });
    const onsubmit = (event) => {
      event.preventDefault();
      save(marker, input.value.trim() || marker.text);
    };
    const acts = h("div.row", submit("Save"), small("Cancel", () => edit(null)));
    return h("li.note", h("form.note-form", { onsubmit }, h("div.field", input), acts));
  }
}

export function laneOfMarkers(markers, row) {
  return markers.map(({ id, t, end, text, kind }) => ({
    id: `marker-${id}`,
    t,
    row,
    start: t,
    end,
    text,
    mark: signOf(kind),
    level: "plain",
    title: `${kind}, ${secondsText(t)}: ${text}`,
  }));
}
