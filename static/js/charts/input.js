/**
 * Mouse, touch and keyboard on the strips, turned into calls of the timeline.
 *
 * Exports
 *   attachControls(host, {rows, bar}, timeline, chart)
 *     host: the focusable element.   rows: the element whose box holds the plots.   bar: the tool bar
 *     chart: {view() -> View, plotWidth() -> px, dt() -> s, newest() -> t, wall() -> ms, steps}
 *     steps: {next(), back()} of two more buttons and the keys N and P, if any
 *   attachMarking(plots, timeWindow, {left() -> px, width() -> px}) -> {set(active)}
 *     while active a drag sets the cursors A and B in place of moving the window
 *
 * Wheel zooms, drag pans, two fingers do both, a click pins the cursor, a double click goes live.
 */

import { GUTTER } from "./strip_frame.js";

const CLICK = 4; // px that the pointer may move during a click

function attachInput(host, plots, timeline, chart) {
  const pointers = new Map();
  let travelled = 0;

  const place = (event) => {
    const left = plots.getBoundingClientRect().left + GUTTER;
    return (event.clientX - left) / chart.plotWidth();
  };
  const timeAt = (fraction) => {
    const seen = chart.view();
    return seen.start + Math.min(1, Math.max(0, fraction)) * (seen.end - seen.start);
  };

  plots.addEventListener("pointerdown", (event) => {
    const fraction = place(event);
    if (event.button !== 0 || fraction < 0 || fraction > 1) return;
    pointers.set(event.pointerId, event.clientX);
    travelled = 0;
    plots.setPointerCapture(event.pointerId);
    host.focus({ preventScroll: true });
  });

  plots.addEventListener("pointermove", (event) => {
    const fraction = place(event);
    const inside = fraction >= 0 && fraction <= 1;
    if (event.pointerType === "mouse") timeline.setHover(inside ? fraction : null);
    if (!pointers.has(event.pointerId)) return;
    const before = pointers.get(event.pointerId);
    travelled += Math.abs(event.clientX - before);
    if (travelled > CLICK) drag(event, before);
    pointers.set(event.pointerId, event.clientX);
  });

  function drag(event, before) {
    const seen = chart.view();
    const perPx = (seen.end - seen.start) / chart.plotWidth();
    const others = [...pointers].filter(([id]) => id !== event.pointerId);
    if (others.length === 0) {
      timeline.pan((before - event.clientX) * perPx, chart.wall());
      return;
    }
    const anchor = others[0][1];
    const [was, is] = [Math.abs(before - anchor), Math.abs(event.clientX - anchor)];
    if (was < 8 || is < 8) return;
    timeline.hold(chart.wall());
    timeline.zoom(was / is, timeAt(place({ clientX: anchor })), chart.wall());
  }

  for (const kind of ["pointerup", "pointercancel"]) {
    plots.addEventListener(kind, (event) => {
      const held = pointers.delete(event.pointerId);
      const fraction = place(event);
      const click = kind === "pointerup" && held && travelled <= CLICK;
      if (click && fraction >= 0 && fraction <= 1) timeline.setCursor(timeAt(fraction));
    });
  }
  plots.addEventListener("pointerleave", () => timeline.setHover(null));
  plots.addEventListener("dblclick", () => {
    timeline.setCursor(null);
    timeline.goLive();
  });
  plots.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const seen = chart.view();
      if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) {
        const by = (event.deltaX || event.deltaY) / 800;
        timeline.pan(by * (seen.end - seen.start), chart.wall());
        return;
      }
      timeline.zoom(Math.exp(event.deltaY * 0.0015), timeAt(place(event)), chart.wall());
    },
    { passive: false },
  );

  function moveCursor(to) {
    const seen = chart.view();
    timeline.setHover(null);
    timeline.setCursor(to);
    const width = seen.end - seen.start;
    if (to < seen.start) timeline.setWindow(to - 0.1 * width, to + 0.9 * width);
    else if (to > seen.end) timeline.setWindow(to - 0.9 * width, to + 0.1 * width);
  }

  /** @type {Record<string, (event: KeyboardEvent) => void>} */
  const keys = {
    ArrowLeft: (event) => arrow(-1, event),
    ArrowRight: (event) => arrow(1, event),
    Home: () => moveCursor(chart.view().start),
    End: () => moveCursor(chart.newest()),
    PageUp: () => page(-0.5),
    PageDown: () => page(0.5),
    "+": () => zoom(0.5),
    "=": () => zoom(0.5),
    "-": () => zoom(2),
    a: () => mark("a"),
    b: () => mark("b"),
    c: () => timeline.clearMarks(),
    l: () => timeline.goLive(),
    Escape: () => timeline.setCursor(null),
    ...(chart.steps ? { n: chart.steps.next, p: chart.steps.back } : {}),
  };

  function arrow(direction, event) {
    const seen = chart.view();
    const px = (seen.end - seen.start) / chart.plotWidth();
    const from = timeline.cursorAt(seen);
    const by = Math.max(chart.dt(), px) * (event.shiftKey ? 10 : 1);
    const newest = chart.newest();
    if (Number.isNaN(newest)) return;
    moveCursor(Number.isNaN(from) ? newest : Math.min(newest, from + direction * by));
  }

  function page(share) {
    const seen = chart.view();
    timeline.pan(share * (seen.end - seen.start), chart.wall());
  }

  function zoom(factor) {
    const seen = chart.view();
    const cursor = timeline.cursorAt(seen);
    const middle = (seen.start + seen.end) / 2;
    timeline.zoom(factor, Number.isNaN(cursor) ? middle : cursor, chart.wall());
  }

  function mark(name) {
    const cursor = timeline.cursorAt(chart.view());
    timeline.setMark(name, Number.isNaN(cursor) ? chart.newest() : cursor);
  }

  host.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target !== host) return;
    const act = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (act === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    act(event);
  });

  return { zoom, mark };
}

export function attachMarking(plots, timeWindow, { left, width }) {
  let active = false;
  let from = NaN;

  const timeAt = (event) => {
    const share = (event.clientX - plots.getBoundingClientRect().left - left()) / width();
    const { start, end } = timeWindow.view();
    return share < 0 || share > 1.2 ? NaN : start + Math.min(1, share) * (end - start);
  };

  plots.addEventListener(
    "pointerdown",
    (event) => {
      const t = timeAt(event);
      if (!active || event.button !== 0 || Number.isNaN(t)) return;
      event.stopImmediatePropagation();
      plots.setPointerCapture(event.pointerId);
      from = t;
    },
    { capture: true },
  );
  plots.addEventListener("pointermove", (event) => {
    const t = timeAt(event);
    if (Number.isNaN(from) || Number.isNaN(t)) return;
    timeWindow.setMark("a", Math.min(from, t));
    timeWindow.setMark("b", Math.max(from, t));
  });
  for (const kind of ["pointerup", "pointercancel"])
    plots.addEventListener(kind, () => (from = NaN));

  return {
    set: (wanted) => {
      active = wanted;
      plots.toggleAttribute("data-marking", wanted);
    },
  };
}

export function attachControls(host, { rows, bar }, timeline, chart) {
  const input = attachInput(host, rows, timeline, chart);
  bar.on("a", () => input.mark("a"));
  bar.on("b", () => input.mark("b"));
  bar.on("clear", () => timeline.clearMarks());
  bar.on("in", () => input.zoom(0.5));
  bar.on("out", () => input.zoom(2));
  bar.on("live", () => timeline.goLive());
  for (const [name, act] of Object.entries(chart.steps ?? {})) bar.on(name, act);
}
