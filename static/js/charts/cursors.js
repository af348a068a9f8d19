/**
 * The cursor and the marks A and B that all strips of a chart share.
 *
 * Exports
 *   createCursors() -> Cursors
 *
 * Cursors
 *   pinned -> t | NaN                     the cursor that stays
 *   setCursor(t | null), setHover(fraction | null), cursorAt(view) -> t | NaN
 *   setMark("a" | "b", t | null), clearMarks(), marks -> {a, b}    [s], NaN if unset
 *   subscribe(listener) -> unsubscribe, revision, changed()    of any change
 */

export function createCursors() {
  const marks = { a: NaN, b: NaN };
  const listeners = new Set();
  let cursor = NaN;
  let hover = NaN;

  const cursors = {
    revision: 0,
    marks,
    changed,
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
    cursorAt: (view) =>
      Number.isNaN(hover) ? cursor : view.start + hover * (view.end - view.start),
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
    cursors.revision += 1;
    for (const listener of listeners) listener();
  }

  return cursors;
}
