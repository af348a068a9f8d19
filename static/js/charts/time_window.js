/**
 * The interval of time that the strips of a chart show, and the cursors in it.
 *
 * createTimeWindow({width, least, longest, start, end, follow}) -> TimeWindow     all [s]
 *     width: until the window is held or zoomed.   start, end: it stays between them
 *     follow(width, wall) -> {start, end, now}: where it is while it is not held; else from `start` on
 *   view(wall) -> {start, end, now, live}     live: not held
 *   setWindow(start, end), pan(seconds, wall), hold(wall)     hold the window there
 *   zoom(factor, t, wall)       t keeps its place; a window that follows goes on doing so
 *   goLive()                    stop holding, at the first width
 *   forget()                    also the cursors, for another flight; a window that follows keeps its zoom
 *   pinned -> t | NaN           the cursor that stays
 *   setCursor(t | null), setHover(fraction | null), cursorAt(view) -> t | NaN
 *   setMark("a" | "b", t | null), clearMarks(), marks -> {a, b}    [s], NaN if unset
 *   subscribe(listener) -> unsubscribe, changed(), revision    of the window and the cursors
 */

export function createTimeWindow(options) {
  const { width: usual, least, longest = usual, start = -Infinity, end = Infinity, follow } = options;
  const marks = { a: NaN, b: NaN };
  const listeners = new Set();
  let width = usual;
  let held = null; // where a held window begins [s]
  let cursor = NaN;
  let hover = NaN;

  const own = {
    revision: 0,
    marks,
    changed,
    view,
    setWindow,
    zoom,
    pan: (by, wall) => setWindow(view(wall).start + by, view(wall).end + by),
    hold: (wall) => setWindow(view(wall).start, view(wall).end),
    goLive: () => {
      [held, width] = [null, usual];
      changed();
    },
    forget: () => {
      if (held !== null) width = usual;
      held = null;
      own.setCursor(null);
      own.clearMarks();
    },
    get width() {
      return width;
    },
    get pinned() {
      return cursor;
    },
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
    for (const listener of listeners) listener();
  }

  function view(wall) {
    const place = follow?.(width, wall) ?? { start, end: start + width, now: NaN };
    return held === null ? { ...place, live: true } : { ...place, start: held, end: held + width, live: false };
  }

  function setWindow(from, to) {
    if (!(Number.isFinite(from) && to > from)) return;
    width = clamped(to - from);
    held = Math.min(end - width, Math.max(start, (from + to - width) / 2));
    changed();
  }

  function zoom(factor, t, wall) {
    const seen = view(wall);
    const wanted = clamped(width * factor);
    const first = t - ((t - seen.start) * wanted) / width;
    if (!follow || !seen.live) return setWindow(first, first + wanted);
    width = wanted;
    changed();
  }

  function clamped(wanted) {
    return Math.min(longest, Math.max(least, wanted));
  }

  return own;
}
