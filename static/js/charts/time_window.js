/**
 * The interval of time that the strips of a chart show, and the cursors in it.
 *
 * createTimeWindow({width, least, longest, start, end, follow}) -> TimeWindow     all [s]
 *     width: until the window is held or zoomed.   start, end: it stays between them
 *     follow(width, wall) -> {start, end, now}: where it is while it is not held; else from `start` on
 *   view(wall) -> {start, end, now, live}     live: not held
 *   setWindow(start, end), pan(seconds, wall)     hold the window there
 *   zoom(factor, t, wall)       t keeps its place; a window that follows goes on doing so
 *   goLive()                    stop holding, at the first width
 *   setWidth(seconds)           of a window that is not held
 *   usual, held -> {start, width}    the first width; start: NaN while it is not held
 *   keepPlace(), steps    keepPlace: the next change of the window is a step, with all that follow it.   steps: their number
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
  let begun = false; // whether the next change is a step
  let cursor = NaN;
  let hover = NaN;

  const own = {
    revision: 0,
    steps: 0,
    marks,
    changed,
    view,
    setWindow,
    zoom,
    pan: (by, wall) => setWindow(view(wall).start + by, view(wall).end + by),
    goLive: () => place(null, usual),
    setWidth: (wanted) => place(null, clamped(wanted)),
    keepPlace: () => {
      begun = true;
    },
    usual,
    get held() {
      return { start: held ?? NaN, width };
    },
    forget: () => {
      if (held !== null) width = usual;
      held = null;
      begun = false;
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
    const wide = clamped(to - from);
    place(Math.min(end - wide, Math.max(start, (from + to - wide) / 2)), wide);
  }

  function place(at, wide) {
    if (begun && (at !== held || wide !== width)) {
      own.steps += 1;
      begun = false;
    }
    [held, width] = [at, wide];
    changed();
  }

  function zoom(factor, t, wall) {
    const seen = view(wall);
    const wanted = clamped(width * factor);
    const first = t - ((t - seen.start) * wanted) / width;
    if (!follow || !seen.live) return setWindow(first, first + wanted);
    place(null, wanted);
  }

  function clamped(wanted) {
    return Math.min(longest, Math.max(least, wanted));
  }

  return own;
}
