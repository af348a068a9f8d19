/**
 * The page's keys, and the list of them that `?` opens.
 *
 * bindShortcuts(actions, urgent, signal)    {key: act}; ignored in text fields and dialogs
 *     urgent: work also in lists, boxes and every dialog but this one; once for a held key
 * openShortcuts(urgent)    the list; urgent: [[key, what, request]]
 */

import { may } from "../lib/api.js";
import { button, h, openDialog } from "../lib/dom.js";

const STEER = "POST /flights/{}/transport";
/** [title, [key, what it does, the request that it sends, if any]]. */
const GROUPS = [
  ["Alarm", [["K", "acknowledge the alarm", "POST /flights/{}/alarms/{}/acknowledge"], ["M", "mute or unmute the tone"]]],
  [
    "Transport",
    [
      ["Space", "play or pause", STEER], [", .", "one sample back, on", STEER], ["0", "to the start", STEER],
      ["N", "to the next alert", STEER], ["J", "to the next event", STEER], ["T", "note at this moment (replay of a recording)", "POST /recordings/{}/markers"],
      ["[ ]", "slower, faster", STEER], ["O", "loop", STEER],
    ],
  ],
  ["Live flight", [["G", "mark that a manoeuvre begins now", "POST /flights/{}/manoeuvre"]]],
  [
    "Strips (when chosen: click, or Tab)",
    [
      ["← →", "move the cursor; with Shift ten times as far"], ["Home End", "cursor to the window's start, the newest sample"],
      ["A B", "set cursors A and B, their difference is shown"], ["C", "clear A and B"],
      ["+ −", "zoom (or the wheel)"], ["Page ↑ ↓", "move the window (or drag)"],
      ["L", "follow the newest sample (or double click)"], ["Esc", "remove the cursor"],
      ["Z Y", "back to the window before, forward to the one after"],
    ],
  ],
  ["Scene", [["V", "next camera: chase, tail, side"]]],
  ["Page", [["W", "wall mode, to be read from across the room; Esc leaves it"], ["?", "this list"]]],
];

const TYPED = "input:not([type=range], [type=checkbox], [type=radio]), textarea, [contenteditable]";

export function bindShortcuts(actions, urgent, signal) {
  const press = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    const { target } = event;
    if (target.closest(TYPED) || document.querySelector("dialog.shortcuts[open]") !== null) return;
    const now = urgent[event.key.toLowerCase()];
    if (now !== undefined) {
      event.preventDefault();
      if (!event.repeat) now();
      return;
    }
    if (document.querySelector("dialog[open]") !== null) return;
    if (target.closest("input:not([type=range]), select")) return;
    if ([" ", "Enter"].includes(event.key) && target.closest("button, a, summary")) return;
    const act = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (act === undefined) return;
    event.preventDefault();
    act();
  };
  addEventListener("keydown", press, { signal });
}

export function openShortcuts(urgent) {
  const allowed = ([, , route]) => route === undefined || may(route);
  const groups = [["Markers, shown to everyone", urgent], ...GROUPS].map(([name, keys]) => [name, keys.filter(allowed)]);
  const keysOf = (keys) => keys.flatMap(([key, what]) => [h("dt", h("kbd", key)), h("dd", what)]);
  const sections = groups.filter(([, keys]) => keys.length > 0).map(([name, keys]) => h("section", h("h3", name), h("dl.keys", keysOf(keys))));
  const close = h("div.row", button("Close", () => dialog.close()));
  const dialog = openDialog("Keyboard shortcuts", [h("div.key-groups", sections), close], "shortcuts");
}
