/**
 * Manoeuvres, exceedances and notes of a replayed recording.
 *
 * createReplayNotes({api, source, now, add, marked, fail}) -> {element, times() -> [{t, level}], write(), moved(t), close()}
 *     source: {recording, scoring} of a flight's hello.   now() -> s, time of the flight
 *     add(event): {t, text, level}, for the event list, once the replay has reached it
 *     marked(): times() has changed; it includes later events.   fail(error): notes could not be read
 *     write(): opens the field for a note at this moment.   moved(t): events up to t are listed
 */

import { may, needs } from "../../lib/api.js";
import { secondsText } from "../../lib/clock.js";
import { button, errorLine, h, put } from "../../lib/dom.js";
import { withdrawnAt } from "../../recordings/scoring/events.js";
import { readScoring } from "../../recordings/scoring/source.js";

const NOTE = "POST /recordings/{}/markers";
const SAME = 1e-6; // s

export function createReplayNotes({ api, source, now, add: addEvent, marked, fail }) {
  const path = `/recordings/${encodeURIComponent(source.recording)}`;
  const marks = [];
  let ahead = []; // events that the replay has not reached, by time
  let at = 0;
  let closed = false;
  const when = h("span.dim");
  const text = h("input", { type: "text", maxlength: 2000, "aria-label": "Note", placeholder: "Note", required: true });
  const failure = errorLine();
  const small = { class: "button button-small" };
  const form = h(
    "form.replay-note",
    { hidden: true, onsubmit: save },
    when,
    text,
    h("button.button.button-small.button-primary", "Save"),
    button("Cancel", () => (form.hidden = true), small),
    failure.element,
  );
  const open = button("Note here", write, { ...small, title: "Note at this moment (key T)" });
  const element = h("div.replay-notes", needs(NOTE), open, form);
  load().catch((error) => !closed && fail(error));

  async function load() {
    const [scoring, markers] = await Promise.all([
      readScoring(api, source.recording, source.scoring),
      api.get(`${path}/markers`),
    ]);
    if (closed) return;
    for (const { name, start, exceedance, alerts, ...about } of scoring.manoeuvres) {
      const withdrawn = withdrawnAt({ start, ...about });
      add({ t: start, text: `${name} begins` });
      if (withdrawn !== null) list({ t: withdrawn, text: `${name} is invalid from here on` });
      for (const [begin] of alerts) marks.push({ t: begin, level: "alert" });
      if (exceedance !== null) marks.push({ t: exceedance.t, level: "caution" });
    }
    markers.forEach(showMarker);
  }

  function showMarker({ t, text: words, kind }) {
    add({ t, text: `${kind}: ${words}` });
  }

  function add(event) {
    marks.push({ t: event.t, level: "caution" });
    list(event);
    marked();
  }

  function list(event) {
    ahead = [...ahead, { level: "", ...event, seen: true }].sort((a, b) => a.t - b.t);
    moved(now());
  }

  function moved(t) {
    while (ahead.length > 0 && ahead[0].t <= t + SAME) addEvent(ahead.shift());
  }

  function write() {
    if (!may(NOTE)) return;
    at = now();
    put(when, secondsText(at));
    failure.show("");
    form.hidden = false;
    text.focus();
  }

  async function save(submitted) {
    submitted.preventDefault();
    const isSaved = await failure.attempt(async () => showMarker(await api.post(`${path}/markers`, { t: at, text: text.value, kind: "note" })));
    if (!isSaved) return;
    text.value = "";
    form.hidden = true;
  }

  return {
    element,
    times: () => marks,
    write,
    moved,
    close: () => {
      closed = true;
    },
  };
}
