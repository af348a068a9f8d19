/**
 * ABORT, KNOCK IT OFF and events in words: a button and a key each; everyone who watches sees the marker.
 *
 * Their words come from the server. A marker neither ends nor pauses the flight. A call is in force, and heads the page,
 * until CALL CLEARED or the next manoeuvre.
 *
 * createFlightMarkers({buttons, events, last, refused, entry}, {set, now, heard, unheard}) -> FlightMarkers
 *     events: the panel with the button of an event.   refused: why a call was not set.   entry: the field of an event
 *     now() -> time of the flight [s], null before it
 *     set({kind, text, t}) -> Promise; the marker arrives by the stream
 *     heard(marker)    a new call, from anyone.   unheard()    one was not set
 *   offer(kinds)     that may be set: {kind, word, meaning, level, shortcut}
 *   onMarker(marker) -> bool     whether it is new
 *   show(call) -> the same with `about`: the call in force, as the server decided it; null for none
 *   keys             {key: act}, filled by offer;   shortcuts()   [[key, meaning, request]]
 * markerNote(marker) -> {event, flag}    for the event list and the strips
 */

import { needs, reason } from "../../lib/api.js";
import { secondsText } from "../../lib/clock.js";
import { button, errorLine, h, put } from "../../lib/dom.js";
import { capital } from "../../lib/numbers.js";
import { aboutCall, LEVEL_OF } from "../headline.js";

const SET = "POST /flights/{}/markers";
const ANSWERED = 1000; // ms
const CLEAR = "call_cleared";
const STORED_LATE = 503; // shown, and not stored yet
const LONGEST_FLAG = 28; // letters of an event on the strips

export function createFlightMarkers({ buttons, events, last, refused, entry }, { set, now, heard, unheard }) {
  const keys = {};
  const known = new Set(); // numbers
  let kinds = [];

  function offer(given) {
    if (kinds.length > 0) return;
    kinds = given;
    const calls = kinds.filter(({ asks_text: asks }) => !asks);
    buttons.replaceChildren(...calls.filter(({ kind }) => kind !== CLEAR).map(callButton));
    last.replaceChildren(h("span"), ...calls.filter(({ kind }) => kind === CLEAR).map(callButton));
    events.prepend(...kinds.filter(({ asks_text: asks }) => asks).map(eventButton));
  }

  /** Opens a field; the event is about the moment at which it was opened. */
  function eventButton({ kind, word, shortcut }) {
    const when = h("span.dim");
    const text = h("input", { type: "text", maxlength: 2000, "aria-label": "Event", placeholder: "What happened; Enter sets it", required: true });
    const failure = errorLine();
    let t = null;
    const form = h("form.event-entry", { onsubmit: save, onkeydown: ({ key }) => key === "Escape" && close() },
      when, text, h("button.button.button-small.button-primary", "Set"), button("Cancel", close, { class: "button button-small" }), failure.element);
    entry.replaceChildren(form);

    function open() {
      if (!entry.hidden || document.querySelector("dialog[open]") !== null) return;
      t = now();
      put(when, t === null ? "before the first sample" : secondsText(t));
      failure.show("");
      entry.hidden = false;
      text.focus();
    }

    function close() {
      entry.hidden = true;
      text.value = "";
    }

    async function save(submitted) {
      submitted.preventDefault();
      if (await failure.attempt(() => set({ kind, text: text.value, t }))) close();
    }

    keys[shortcut] = open;
    const key = shortcut.toUpperCase();
    return h("button", { type: "button", class: "button button-small", "data-marker": kind, title: `Event in words, at this moment (key ${key})`, onclick: open, ...needs(SET) },
      capital(word.toLowerCase()), h("span", { class: "marker-key" }, ` [${key}]`));
  }

  function callButton(about) {
    const { kind, word, meaning, level, shortcut } = about;
    const key = shortcut.toUpperCase();
    const title = `${word}: ${meaning}. Sets a marker; the flight continues (key ${key})`;
    const element = h("button", { type: "button", class: "button button-small marker-button", "data-level": LEVEL_OF[level], "data-marker": kind, title, ...needs(SET) },
      kind === CLEAR ? "Clear" : word, h("span", { class: "marker-key" }, ` [${key}]`));
    let asked = false;
    const press = async () => {
      if (asked) return;
      asked = element.disabled = true;
      refused.hidden = true;
      const late = setTimeout(() => refuse(about, `${word} IS NOT CONFIRMED. The server has not answered yet: call it by voice.`), ANSWERED);
      try {
        await set({ kind });
        refused.hidden = true;
      } catch (error) {
        refuse(about, error.status === STORED_LATE ? reason(error) : `${word} WAS NOT SET. ${reason(error)} Call it by voice.`);
      }
      clearTimeout(late);
      asked = element.disabled = false;
    };
    element.addEventListener("click", press);
    keys[shortcut] = press;
    return element;
  }

  function refuse({ kind, level }, words) {
    put(refused, words);
    refused.dataset.kind = kind;
    refused.dataset.level = LEVEL_OF[level];
    refused.hidden = false;
    unheard();
  }

  function onMarker(marker) {
    const isNew = !known.has(marker.number);
    known.add(marker.number);
    if (isNew && marker.level === "none") return true; // an event
    if (marker.kind === refused.dataset.kind) refused.hidden = true; // set after all, by anyone
    if (isNew) heard(marker);
    return isNew;
  }

  function show(call) {
    last.hidden = call === null;
    if (call === null) return null;
    last.dataset.level = LEVEL_OF[call.level];
    last.title = markerText(call);
    const about = `${aboutCall(call)}${call.stored ? "" : " · not stored yet"}`;
    put(last.firstChild, `${call.word} ${about}`);
    return { ...call, about };
  }

  return { offer, onMarker, show, keys, shortcuts: () => kinds.map(({ word, meaning, shortcut }) => [shortcut.toUpperCase(), `${word}: ${meaning}`, SET]) };
}

export function markerText({ word, meaning, t, created, by, text, level }) {
  const what = level === "none" ? [word, text].filter(Boolean).join(": ") : `${word} (${meaning})`;
  return `${what} at ${secondsText(t)}, ${created.slice(11, 19)} UTC, by ${by}${text && level !== "none" ? `: ${text}` : ""}`;
}

/** For the event list and the strips. */
export function markerNote(marker) {
  const { t, word, level, text } = marker;
  const isEvent = level === "none" && text !== null;
  const event = { t, text: isEvent ? `${text}, by ${marker.by}` : markerText(marker), level: level === "none" ? "" : LEVEL_OF[level], seen: true };
  const short = isEvent && text.length > LONGEST_FLAG ? `${text.slice(0, LONGEST_FLAG - 1).trimEnd()}…` : text;
  return { event, flag: { key: null, t, word: isEvent ? short : word, colour: { warning: "alert", none: "text" }[level] ?? "caution" } };
}
