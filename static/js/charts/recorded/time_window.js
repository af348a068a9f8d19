/**
 * The interval of a recording that its chart shows, and the cursors in it.
 *
 * Nothing runs by the clock: the window stays within the recording. It has those calls of a flight's
 * timeline that the input needs.
 *
 * Exports
 *   createTimeWindow({start, end, least, key}) -> TimeWindow    all [s]; least: narrowest window
 *     key: of the recording: a redraw at the same address restores the window of this key
 *
 * TimeWindow
 *   view() -> {start, end}, setWindow(start, end), showAll()
 *   pan(seconds), zoom(factor, t)         t keeps its place
 *   and all of Cursors, see ../cursors.js; its revision counts changes of the window too
 *   hold(), goLive()                      for the input: nothing to hold; shows all
 */

import { createCursors } from "../cursors.js";

const left = new Map(); // key -> {shown, marks, pinned}
addEventListener("hashchange", () => left.clear()); // another view starts new

export function createTimeWindow({ start, end, least = 0.25, key = null }) {
  const cursors = createCursors();
  const { changed } = cursors;
  const longest = Math.max(end - start, least);
  let shown = { start, end: start + longest };

  const own = {
    __proto__: cursors,
    view: () => shown,
    setWindow,
    showAll: () => setWindow(start, start + longest),
    pan: (by) => setWindow(shown.start + by, shown.end + by),
    zoom,
    hold: () => {},
    goLive: () => own.showAll(),
  };
  if (key !== null) {
    resume();
    cursors.subscribe(() => left.set(key, { shown, marks: { ...own.marks }, pinned: own.pinned }));
  }

  function setWindow(from, to) {
    if (!(Number.isFinite(from) && to > from)) return;
    const width = Math.min(longest, Math.max(least, to - from));
    const middle = (from + to) / 2;
    const first = Math.min(start + longest - width, Math.max(start, middle - width / 2));
    shown = { start: first, end: first + width };
    changed();
  }

  function zoom(factor, t) {
    const before = shown.end - shown.start;
    const width = Math.min(longest, Math.max(least, before * factor));
    const first = t - ((t - shown.start) * width) / before;
    setWindow(first, first + width);
  }

  function resume() {
    const before = left.get(key);
    if (before === undefined) return;
    setWindow(before.shown.start, before.shown.end);
    Object.assign(own.marks, before.marks);
    own.setCursor(before.pinned);
  }

  return own;
}
