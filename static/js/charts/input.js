/**
 * Mouse, touch, keyboard and buttons of the strips: wheel zooms, drag pans, a click pins the cursor.
 *
 * attachControls(host, {rows, bar, keys}, timeline, chart) -> {setMarking(flag)}     fills tool bar and list of keys
 *     setMarking: whether a drag sets the cursors A and B in place of moving the window
 *     host: the focusable element.   rows: the element whose box holds the plots
 *     chart: {view() -> View, plotWidth() -> units, dt() -> s, newest() -> t, wall() -> ms, follows, steps, address}
 *     follows: whether samples arrive.   steps: {next(), back()} for two more buttons, if any
 */

import { button } from "../lib/dom.js";
import { GUTTER, unit } from "./layout.js";

const CLICK = 4; // px that the pointer may move during a click
const APART = 400; // ms between turns of the wheel that are undone one by one

export function attachControls(host, { rows: plots, bar, keys: help }, timeline, chart) {
  let held = null; // {id, x} of the pointer that drags
  let travelled = 0;
  let begun = NaN; // where a drag began [s]
  let marking = false;
  let turned = -Infinity; // when the wheel last was

  const place = (event) => {
    return ((event.clientX - plots.getBoundingClientRect().left) / unit() - GUTTER) / chart.plotWidth();
  };
  const timeAt = (fraction) => {
    const seen = chart.view();
    return seen.start + Math.min(1, Math.max(0, fraction)) * (seen.end - seen.start);
  };

  plots.addEventListener("pointerdown", (event) => {
    const fraction = place(event);
    if (event.button !== 0 || fraction < 0 || fraction > 1) return;
    held = { id: event.pointerId, x: event.clientX };
    travelled = 0;
    begun = timeAt(fraction);
    timeline.keepPlace();
    plots.setPointerCapture(event.pointerId);
    host.focus({ preventScroll: true });
  });

  plots.addEventListener("pointermove", (event) => {
    const fraction = place(event);
    const inside = fraction >= 0 && fraction <= 1;
    if (event.pointerType === "mouse") timeline.setHover(inside ? fraction : null);
    if (event.pointerId !== held?.id) return;
    travelled += Math.abs(event.clientX - held.x);
    if (travelled > CLICK) drag(event);
    held.x = event.clientX;
  });

  function drag(event) {
    if (marking) {
      const t = timeAt(place(event));
      timeline.setMark("a", Math.min(begun, t));
      timeline.setMark("b", Math.max(begun, t));
      return;
    }
    const seen = chart.view();
    timeline.pan(((held.x - event.clientX) * (seen.end - seen.start)) / chart.plotWidth() / unit(), chart.wall());
  }

  for (const kind of ["pointerup", "pointercancel"]) {
    plots.addEventListener(kind, (event) => {
      if (event.pointerId !== held?.id) return;
      held = null;
      const fraction = place(event);
      const isClick = kind === "pointerup" && !marking && travelled <= CLICK;
      if (isClick && fraction >= 0 && fraction <= 1) timeline.setCursor(timeAt(fraction));
    });
  }
  plots.addEventListener("pointerleave", () => timeline.setHover(null));
  plots.addEventListener("dblclick", () => {
    timeline.setCursor(null);
    timeline.keepPlace();
    timeline.goLive();
  });
  plots.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      if (event.timeStamp - turned > APART) timeline.keepPlace();
      turned = event.timeStamp;
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
    timeline.keepPlace();
    if (to < seen.start) timeline.setWindow(to - 0.1 * width, to + 0.9 * width);
    else if (to > seen.end) timeline.setWindow(to - 0.9 * width, to + 0.1 * width);
  }

  const [end, word, follow] = chart.follows
    ? ["newest sample", "Newest", "Follow the newest sample"]
    : ["recording's end", "All", "Show all of the recording"];
  const { back, next } = chart.steps ?? {};
  /** [key, the button's text, what it does, act] */
  const commands = [
    ...(chart.steps ? [["P", "◀ Event", "Go to the event before", back]] : []),
    ...(chart.steps ? [["N", "Event ▶", "Go to the next event", next]] : []),
    ["A", "A", "Set cursor A", () => mark("a")],
    ["B", "B", "Set cursor B", () => mark("b")],
    ["C", "Clear", "Clear the cursors A and B", timeline.clearMarks],
    ["-", "−", "Show more time", () => zoom(2)],
    ["+", "+", "Show less time", () => zoom(0.5)],
    ["L", word, follow, entire],
    ["Z", "↶", "Back to the window before", chart.address.back],
    ["Y", "↷", "Forward to the window after", chart.address.forward],
  ];
  const keys = {
    ...Object.fromEntries(commands.map(([key, , , act]) => [key.toLowerCase(), act])),
    ArrowLeft: (event) => arrow(-1, event),
    ArrowRight: (event) => arrow(1, event),
    Home: () => moveCursor(chart.view().start),
    End: () => moveCursor(chart.newest()),
    PageUp: () => page(-0.5),
    PageDown: () => page(0.5),
    "=": () => zoom(0.5),
    Escape: () => timeline.setCursor(null),
  };
  help.textContent =
    `Left and right arrows move the cursor, with Shift ten times as far; Home and End go to the window's start and the ${end}; ` +
    "Page Up and Page Down move the window, Escape removes the cursor. " +
    commands.map(([key, , what]) => `${key}: ${what}`).join("; ");
  for (const [key, text, what, act] of commands) {
    const title = `${what} (key ${{ "+": "plus", "-": "minus" }[key] ?? key})`;
    bar.element.append(button(text, () => act(), { class: "button button-small", title, "aria-label": title }));
  }

  function arrow(direction, event) {
    const seen = chart.view();
    const px = (seen.end - seen.start) / chart.plotWidth();
    const from = timeline.cursorAt(seen);
    const by = Math.max(chart.dt(), px) * (event.shiftKey ? 10 : 1);
    const newest = chart.newest();
    if (Number.isNaN(newest)) return;
    moveCursor(Number.isNaN(from) ? newest : Math.min(newest, from + direction * by));
  }

  function entire() {
    timeline.keepPlace();
    timeline.goLive();
  }

  function page(share) {
    timeline.keepPlace();
    const seen = chart.view();
    timeline.pan(share * (seen.end - seen.start), chart.wall());
  }

  function zoom(factor) {
    timeline.keepPlace();
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

  return {
    setMarking: (flag) => {
      marking = flag;
      plots.toggleAttribute("data-marking", flag);
    },
  };
}
