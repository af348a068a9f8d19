/**
 * The stretch of a recording that its chart shows, and the cursors in it.
 *
 * All of a recording is there from the start, so nothing runs by the clock: the window stays within
 * the recording, and the calls are those of a flight's timeline, as far as input needs them.
 *
 * Exports
 *   createTimeWindow({start, end, least}) -> TimeWindow    all [s]; least: narrowest window
 *
 * TimeWindow
 *   view() -> {start, end}, setWindow(start, end), showAll()
 *   pan(seconds), zoom(factor, t)         t keeps its place
 *   pinned -> t | NaN                     the cursor that stays
 *   setCursor(t | null), setHover(fraction | null), cursorAt(view) -> t | NaN
 *   setMark("a" | "b", t | null), clearMarks(), marks -> {a, b}    [s], NaN where unset
 *   subscribe(listener) -> unsubscribe, revision    of any change
 *   hold(), goLive()                      as input calls them: nothing to hold; all is shown
 */

export function createTimeWindow({ start, end, least = 0.25 }) {
  const marks = { a: NaN, b: NaN };
  const listeners = new Set();
  const longest = Math.max(end - start, least);
  let shown = { start, end: start + longest };
  let cursor = NaN;
  let hover = NaN;

  const own = {
    revision: 0,
    marks,
    view: () => shown,
    get pinned() {
      return cursor;
    },
    setWindow,
    showAll: () => setWindow(start, start + longest),
    pan: (by) => setWindow(shown.start + by, shown.end + by),
    zoom,
    hold: () => {},
    goLive: () => own.showAll(),
    setCursor: (t) => {
      cursor = t ?? NaN;
      changed();
    },
    setHover: (fraction) => {
      hover = fraction ?? NaN;
      changed();
    },
    cursorAt: (seen) =>
      Number.isNaN(hover) ? cursor : seen.start + hover * (seen.end - seen.start),
    setMark: (name, t) => {
      marks[name] = t ?? NaN;
      changed();
    },
    clearMarks: () => {
      [marks.a, marks.b] = [NaN, NaN];
      changed();
    },
    subscribe: (listener) => {
      listeners.add(listener);
      return () => listeners.delete(listener);
    },
  };

  function changed() {
    own.revision += 1;
    for (const listener of listeners) listener(own);
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

  return own;
}
