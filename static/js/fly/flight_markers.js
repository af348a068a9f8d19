/**
 * ABORT and KNOCK IT OFF: a button and a key each; everyone who watches sees the marker.
 *
 * Their words come from the server. A marker neither ends nor pauses the flight.
 *
 * createFlightMarkers({buttons, last, refused}, {set, heard, unheard}) -> FlightMarkers
 *     refused: why a marker was not set.   set(kind) -> Promise; the marker arrives by the stream
 *     heard(marker)    a new marker, from anyone.   unheard()    one was not set
 *   offer(kinds)     that may be set: {kind, word, meaning, level, shortcut}
 *   onMarker(marker) -> bool     shows the newest of the most urgent; returns whether it is new
 *   keys             {key: act}, filled by offer;   shortcuts()   [[key, meaning, request]]
 * markerNote(marker) -> {event, flag}    for the event list and the strips
 */

import { needs, reason } from "../lib/api.js";
import { h, put } from "../lib/dom.js";
import { LEVEL_OF } from "./headline.js";

const SET = "POST /flights/{}/markers";
const ANSWERED = 1000; // ms
const STORED_LATE = 503; // shown, and not stored yet

export function createFlightMarkers({ buttons, last, refused }, { set, heard, unheard }) {
  const keys = {};
  const known = new Map(); // by number
  let kinds = [];

  function offer(given) {
    if (kinds.length > 0) return;
    kinds = given;
    buttons.replaceChildren(...kinds.map(button));
  }

  function button(about) {
    const { kind, word, meaning, level, shortcut } = about;
    const key = shortcut.toUpperCase();
    const title = `${word}: ${meaning}. Sets a marker; the flight continues (key ${key})`;
    const element = h("button", { type: "button", class: "button button-small marker-button", "data-level": LEVEL_OF[level], "data-marker": kind, title, ...needs(SET) },
      word, h("span", { class: "marker-key" }, ` [${key}]`));
    let asked = false;
    const press = async () => {
      if (asked) return;
      asked = element.disabled = true;
      refused.hidden = true;
      const late = setTimeout(() => refuse(about, `${word} IS NOT CONFIRMED. The server has not answered yet: call it by voice.`), ANSWERED);
      try {
        await set(kind);
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
    known.set(marker.number, marker);
    const set = [...known.values()];
    const shown = set.findLast(({ level }) => level === "warning") ?? set.at(-1);
    last.hidden = false;
    last.dataset.level = LEVEL_OF[shown.level];
    last.title = markerText(shown);
    put(last, `${shown.word} at ${shown.t.toFixed(2)} s, by ${shown.by}${set.every(({ stored }) => stored) ? "" : " · not stored yet"}`);
    if (marker.kind === refused.dataset.kind) refused.hidden = true; // set after all, by anyone
    if (isNew) heard(marker);
    return isNew;
  }

  return { offer, onMarker, keys, shortcuts: () => kinds.map(({ word, meaning, shortcut }) => [shortcut.toUpperCase(), `${word}: ${meaning}`, SET]) };
}

export function markerText({ word, meaning, t, created, by, text }) {
  return `${word} (${meaning}) at ${t.toFixed(2)} s, ${created.slice(11, 19)} UTC, by ${by}${text ? `: ${text}` : ""}`;
}

/** For the event list and the strips. */
export function markerNote(marker) {
  const { t, word, level } = marker;
  const event = { t, text: markerText(marker), level: LEVEL_OF[level], seen: true };
  return { event, flag: { key: null, t, word, colour: level === "warning" ? "alert" : "caution" } };
}
