/**
 * Strips above one time axis: traces, limits, gaps, exceedances, moments, cursors, zoom.
 *
 * createStripChart(host, {strips, channels, source, layout, extras, steps, autostart, address, simulated, starts}) -> StripChart
 *     strips: [Strip] of channels, see strips.js.   layout: of layout.js, in the host
 *     extras: more sheets, and others with draw(frame).   address: keeps the view, see ../lib/address.js
 *     scale: of the cross plots' axes, as for stripOf of strips.js.   panels: Arrangement of those beside the chart, see arranging/side_panels.js; without them the layout cannot be edited
 *     simulated: flights behind the flight, see simulated.js; null for none.   starts() -> [{t [s], from}] of manoeuvres
 *     steps {next, back}: what two more buttons do, keys N and P.   autostart false: draws nothing until update()
 *   update(wall) -> ms      draws now, if anything changed; returns the time it took
 *   cross, editor           the elements of the cross plots and of the layout's editor, for the page; editor: null without panels
 *   redraw()                something changed that the source does not know of;   measure()   the layout changed
 *   setMarking(flag)        whether a drag sets A and B in place of moving the window
 *
 * Source  gives samples of an interval of time at a resolution
 *   time                    a TimeWindow
 *   dt, alertAbove          interval of samples [s]; alert level of the risk, or NaN
 *   newest()                time of the last sample [s]; NaN for none
 *   follows                 whether samples arrive: the readouts are then shown five times a second
 *   flags                   moments that are marked, see strip.js
 *   begin(wall)             a turn begins
 *   stamp(), news()         change with what is drawn; with what is to be read at once
 *   read({view, start, step, first, columns, pitch, width, x, wall}) -> {parts, bands, revision, until, now, lead, ahead, tip,
 *     trail, word}            see strip.js, cross/
 *     tip: where trails end without a cursor [s].   trail, word: see cross/cross_plot.js
 *   reading(strip, view, cursor), bar(view), describe(strip), valuesAt(strip, t)   see readings.js
 */

import { createAddress } from "../lib/address.js";
import { channelName } from "../lib/catalog.js";
import { dayClock, formatTime, intervalText } from "../lib/clock.js";
import { button, h } from "../lib/dom.js";
import { addDrawer } from "../lib/draw_loop.js";
import { moment, shownIn } from "../lib/numbers.js";
import { createLayoutEditor } from "./arranging/layout_editor.js";
import { presetsOf } from "./arranging/layouts.js";
import { createCrossPanel, usualPairs } from "./cross/cross_panel.js";
import { attachControls } from "./input.js";
import { createSheet } from "./layout.js";
import { readPalette, watchTheme } from "./palette.js";
import { createVectorCanvas, pictureOf, savePicture, savePixels, saveText, valuesOf } from "./picture.js";
import { createReadings } from "./readings.js";
import { createSafeChoice } from "./simulated.js";
import { createStrip } from "./strip.js";
import { roundStep, roundTicks } from "./value_axis.js";

const STEPS = [10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 21600]; // s, of long times
const READ_EVERY = 200; // ms; faster digits cannot be read
const DESCRIBED_EVERY = 1000; // ms

export function createStripChart(host, options) {
  const { strips, channels, source, layout, extras = [], steps, autostart = true } = options;
  const { address = createAddress(), simulated = null, starts = () => [], panels = null } = options;
  const { time } = source;
  let look = 0; // counts changes of size, theme, limits
  let measured = false;
  const drawn = strips.map((strip, k) => createStrip(layout.rowOf[k].canvas, strip));
  const keys = channels.map(({ key }) => key);
  const editor = panels && createLayoutEditor({ arrangement: layout.arrangement, panels, address, keys, presets: presetsOf(strips, panels, usualPairs(channels)) });
  if (editor !== null) layout.rows.before(editor.unknown);
  const cross = createCrossPanel({ channels, strips, dt: source.dt, scale: options.scale, simulated, address, changed: onCross });
  const parts = [...drawn, createTimeAxis(layout.axis), ...extras, cross];
  const sheets = parts.filter(({ canvas }) => canvas);
  const readings = createReadings(strips, layout, source);
  const last = { picture: "", first: NaN, news: "", read: -1e9, told: "", described: -1e9 };
  let columns = 1; // pixels of the canvas across the plot
  let pitch = 1; // units a column
  let [safe, errors] = [null, null]; // of simulated flights
  let wall = performance.now();

  function onCross() {
    measured = false;
    editor?.tell();
  }

  function measure() {
    for (const { canvas, resize } of sheets) {
      const { width, height } = canvas.parentElement.getBoundingClientRect();
      resize(width, height);
    }
    for (const part of parts) part.measure?.();
    const widest = sheets.reduce((a, b) => (b.width > a.width ? b : a)); // a folded strip has none
    columns = Math.max(16, widest.canvas.width - widest.left);
    pitch = 1 / widest.ratio;
    measured = widest.width > 0;
    if (measured) setPalette(); // colours exist only on the page
  }

  function setPalette() {
    const palette = readPalette(host);
    for (const part of parts) part.setPalette?.(palette);
    look += 1;
  }

  function update(at = performance.now()) {
    const begin = performance.now();
    wall = at;
    if (!measured) measure();
    if (!measured) return 0;
    source.begin(wall);
    const seen = columnsNow();
    const { view, first } = seen;
    const picture = `${source.stamp()} ${time.revision} ${look}`;
    const isRoomy = cross.roomy || strips.some(({ axis }, k) => axis.roomy && drawn[k].width > 0);
    if (picture !== last.picture || first !== last.first || isRoomy) draw(seen);
    const news = `${source.news()} ${time.revision} ${look}`;
    if (news !== last.news || (source.follows && wall - last.read >= READ_EVERY)) {
      Object.assign(last, { news, read: wall });
      readings.show(view);
    }
    if (picture !== last.told && wall - last.described >= DESCRIBED_EVERY) {
      Object.assign(last, { told: picture, described: wall });
      readings.describe();
    }
    Object.assign(last, { picture, first });
    return performance.now() - begin;
  }

  function draw(seen) {
    const frame = frameOf(seen);
    for (const part of parts) if (part.width !== 0) part.draw(frame);
  }

  function frameOf({ view, column, first }) {
    const start = first * column;
    const step = column / pitch;
    const x = (t) => (t - start) / step;
    const window = { view, start, step, first, columns, pitch, width: columns * pitch, x, wall };
    const read = source.read(window);
    const drawn = { ticks: timeTicks(start, start + columns * column, columns * pitch), cursor: time.cursorAt(view), safe: safe && { ...safe, starts: starts().map(({ t, from }) => t + safe.shift[from]) } };
    const bands = read.bands.map(({ x0, x1, kind, word }) => `${kind} ${x0} ${x1} ${word}`);
    return {
      ...window,
      ...drawn,
      marks: time.marks,
      flags: source.flags,
      alertAbove: source.alertAbove,
      errors,
      ...read,
      revision: `${read.revision} ${look}`,
      picture: [read.revision, look, time.revision, first, column, source.flags.length, drawn.ticks.times[0], drawn.ticks.step, drawn.cursor, drawn.safe?.starts, ...bands].join(),
    };
  }

  /** Strips that the arrangement shows so, in its order. */
  function kept(...ways) {
    const { items, shown } = layout.arrangement;
    return items.filter(({ key }) => ways.includes(shown(key))).map(({ key }) => strips.find((strip) => strip.key === key));
  }

  /** What is in view, redrawn with other pens. */
  function picture() {
    const [frame, palette] = [frameOf(columnsNow()), readPalette(host)];
    const title = document.querySelector("h1")?.textContent ?? "";
    const shown = kept("shown").map((strip) => strips.indexOf(strip));
    const rows = shown.map((k) => ({ sheet: drawn[k], name: nameOf(strips[k]), make: (canvas) => createStrip(canvas, strips[k]) }));
    const all = [...rows, { sheet: parts[strips.length], name: "", make: createTimeAxis }];
    const sheets = all.map(({ sheet: { width, height }, name, make }) => {
      const canvas = createVectorCanvas(width, height);
      const sheet = Object.assign(make(canvas), { width, height });
      sheet.setPalette(palette);
      sheet.draw(frame);
      return { canvas, name };
    });
    return pictureOf({ title, words: [intervalText(frame.view.start, frame.view.end, 0.01) + (dayClock() === null ? " s" : ""), `saved ${moment(new Date().toISOString())}`, location.host + location.hash.split("?")[0]].join(" · "), palette, sheets });
  }

  function columnsNow() {
    const view = time.view(wall);
    const column = time.width / columns; // s
    return { view, column, first: Math.round(view.end / column) - columns }; // whole columns: the trace does not shimmer
  }

  function values() {
    const { parts: [first], view } = frameOf(columnsNow());
    return valuesOf(kept("shown", "number"), { cells: first.cells, from: view.start, to: view.end });
  }

  const controls = attachControls(host, layout, time, {
    view: () => time.view(wall),
    plotWidth: () => columns * pitch,
    dt: () => source.dt,
    newest: source.newest,
    wall: () => wall,
    follows: source.follows,
    steps,
    address,
  });
  const safeChoice = createSafeChoice(simulated, address, (band, interval) => {
    [safe, errors] = [band, interval];
    source.setErrors?.(interval);
    look += 1;
  });
  const small = { class: "button button-small" };
  const name = () => `forewarn-${new Date().toISOString().slice(0, 19).replaceAll(":", "")}Z`;
  const files = [
    button("PNG", () => savePixels(picture(), `${name()}.png`), { ...small, "aria-label": "Save the picture as PNG" }),
    button("SVG", () => savePicture(picture(), `${name()}.svg`), { ...small, "aria-label": "Save the picture as SVG" }),
    button("CSV", () => saveText(values(), `${name()}.csv`, "text/csv"), { ...small, "aria-label": "Save the values in view as CSV" }),
  ];
  layout.bar.element.append(createViewMenu([editor && button("Layout", editor.toggle, small), button("Add a cross plot", cross.add, small), safeChoice, h("div.row", h("span", "Save what is seen:"), files)]));
  const remeasure = () => {
    measured = false;
    if (autostart) update();
  };
  const resizing = new ResizeObserver(remeasure);
  resizing.observe(host);
  resizing.observe(layout.rows); // the tool bar takes more lines or fewer
  layout.onchange = remeasure;
  const unwatch = watchTheme(host, () => {
    setPalette();
    update(wall); // printing does not wait for a frame
  });
  const stop = autostart ? addDrawer(update) : () => {};

  return {
    update,
    cross: cross.element,
    editor: editor?.element ?? null,
    redraw: () => {
      look += 1;
    },
    measure: () => {
      measured = false;
    },
    setMarking: controls.setMarking,
    destroy: () => {
      stop();
      unwatch();
      resizing.disconnect();
      host.replaceChildren();
    },
  };
}

/** What changes the view, in a menu that opens over the chart. */
function createViewMenu(items) {
  const menu = h("details.view-menu", h("summary", { class: "button button-small", "aria-label": "View: layout, time, files" }, "View"), h("div.view-items", items));
  menu.addEventListener("focusout", ({ relatedTarget }) => {
    if (relatedTarget !== null && !menu.contains(relatedTarget)) menu.open = false;
  });
  menu.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    event.stopPropagation();
    menu.open = false;
    menu.firstChild.focus();
  });
  return menu;
}

function nameOf(strip) {
  const { unit } = shownIn(strip);
  return unit ? `${channelName(strip)} [${unit}]` : channelName(strip);
}

/** Round times about 90 px apart. */
function timeTicks(start, end, width) {
  const least = ((end - start) * 90) / width;
  const step = STEPS.find((candidate) => least > 5 && candidate >= least) ?? roundStep(least);
  const zero = dayClock()?.seconds ?? 0;
  return { times: roundTicks(start + zero, end + zero, step).map((t) => t - zero), step };
}

/** Below the strips: round times, and flags on the cursors. */
function createTimeAxis(canvas) {
  const sheet = createSheet(canvas);
  const { pen } = sheet;

  function draw(frame) {
    const { ticks } = frame;
    sheet.clear(dayClock()?.name ?? "t [s]");
    pen.textAlign = "center";
    for (const t of ticks.times) {
      const at = frame.x(t);
      const text = formatTime(t, ticks.step);
      const half = pen.measureText(text).width / 2;
      if (at < Math.max(8, half - 4) || at > frame.width - 8) continue; // the unit is at the left
      pen.fillRect(Math.round(at), 0, 1, 4);
      pen.fillText(text, at, sheet.height / 2 + 1);
    }
    flag(frame, frame.cursor, "", "cursor");
    flag(frame, frame.marks.a, "A", "mark-a");
    flag(frame, frame.marks.b, "B", "mark-b");
  }

  function flag(frame, t, name, colour) {
    const { height, palette } = sheet;
    const at = frame.x(t);
    if (!(at >= 0 && at <= frame.width)) return;
    const text = `${name} ${formatTime(t, 0.01)}`.trim();
    pen.font = `700 12px ${palette.font}`;
    const wide = pen.measureText(text).width + 10;
    const left = Math.min(frame.width - wide, Math.max(0, at - wide / 2));
    pen.fillStyle = palette[colour];
    pen.fillRect(left, 2, wide, height - 4);
    pen.fillStyle = palette.panel;
    pen.fillText(text, left + wide / 2, height / 2 + 0.5);
  }

  return Object.assign(sheet, { draw });
}
