/**
 * The elements of a recording's chart: lane, strips, time axis, overview, tool bar, error.
 *
 * Exports
 *   layOutRecording(host, strips, label) -> {rows, rowOf, axis, bar, lane, overview, fail(words, again)}
 *     rows, rowOf, axis, bar: as in ../layout.js.   lane: element.   overview: canvas
 *     fail(words, again): shown until again() is called
 */

import { h } from "../../lib/dom.js";
import { button } from "../../lib/view_states.js";
import { layOut } from "../layout.js";

const BUTTONS = [
  ["back", "◀ Event", "Go to the event before (key P)"],
  ["next", "Event ▶", "Go to the next event (key N)"],
  ["a", "A", "Set cursor A (key A)"],
  ["b", "B", "Set cursor B (key B)"],
  ["clear", "Clear", "Clear the cursors A and B (key C)"],
  ["out", "−", "Show more time (key minus)"],
  ["in", "+", "Show less time (key plus)"],
  ["live", "All", "Show all of the recording (key L, or double click)"],
];
const HELP =
  "Left and right arrows move the cursor, with Shift ten times as far; Home and End go to the window's " +
  "start and the recording's end; N and P go to the next event and the one before; A and B set cursors, " +
  "C clears them; plus and minus zoom, Page Up and Page Down move the window, L shows the entire " +
  "recording, Escape removes the cursor.";

export function layOutRecording(host, strips, label) {
  const parts = layOut(host, strips, { label, help: HELP, buttons: BUTTONS });
  const lane = h("div", {});
  const overview = h("canvas", { "aria-hidden": true });
  const failure = h("div", { class: "chart-failure", role: "alert", hidden: true });
  host.classList.add("recording-chart");
  parts.rows.before(lane);
  parts.axis
    .closest(".strip-axis")
    .after(
      h("div", { class: "strip-axis overview" }, h("div", { class: "strip-plot" }, overview)),
      failure,
    );
  parts.bar.mode.hidden = true;

  function fail(words, again) {
    const retry = () => {
      failure.hidden = true;
      again();
    };
    failure.replaceChildren(
      h("span", {}, words),
      button("Read again", retry, { class: "button button-small" }),
    );
    failure.hidden = false;
  }

  return { ...parts, lane, overview, fail };
}
