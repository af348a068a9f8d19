/**
 * The page's keys, and the list of them that `?` opens.
 *
 * Exports
 *   bindShortcuts(actions) -> unbind    {key: act}; ignored while a text or a dialog takes the keys
 *   createShortcutList() -> {dialog, open()}
 */

import { h } from "../lib/dom.js";

const GROUPS = [
  ["Alarm", [["K", "acknowledge the alarm"], ["M", "mute or unmute the tone"]]],
  [
    "Transport",
    [
      ["Space", "play or pause"], [", .", "one sample back, on"], ["0", "to the start"],
      ["N", "to the next alert"], ["E", "to the next event"], ["T", "note at this moment (replay of a recording)"], ["[ ]", "slower, faster"], ["O", "loop"],
    ],
  ],
  [
    "Strips (when chosen: click, or Tab)",
    [
      ["← →", "move the cursor; with Shift ten times as far"], ["Home End", "cursor to the window's start, the newest sample"],
      ["A B", "set cursors A and B, their difference is shown"], ["C", "clear A and B"],
      ["+ −", "zoom (or the wheel)"], ["Page ↑ ↓", "move the window (or drag)"],
      ["L", "follow the newest sample (or double click)"], ["Esc", "remove the cursor"],
    ],
  ],
  ["Page", [["?", "this list"]]],
];

export function bindShortcuts(actions) {
  const press = (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    const { target } = event;
    if (document.querySelector("dialog[open]") !== null) return;
    if (target.closest("input:not([type=range]), select, textarea")) return;
    if ([" ", "Enter"].includes(event.key) && target.closest("button, a, summary")) return;
    const act = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (act === undefined) return;
    event.preventDefault();
    act();
  };
  addEventListener("keydown", press);
  return () => removeEventListener("keydown", press);
}

export function createShortcutList() {
  const close = h("button", { type: "button", class: "button", onclick: () => dialog.close() }, "Close");
  const groups = GROUPS.map(([name, keys]) =>
    h(
      "section",
      {},
      h("h3", {}, name),
      h("dl", { class: "keys" }, ...keys.flatMap(([key, what]) => [h("dt", {}, h("kbd", {}, key)), h("dd", {}, what)])),
    ),
  );
  const dialog = h("dialog", { class: "shortcuts", "aria-label": "Keyboard shortcuts" }, h("h2", {}, "Keyboard shortcuts"), h("div", { class: "key-groups" }, groups), close);
  return { dialog, open: () => dialog.showModal() };
}
