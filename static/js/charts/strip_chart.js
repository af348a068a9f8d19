/**
 * Strips above one time axis: traces, limits, gaps, exceedances, moments, cursors, zoom.
 *
 * Exports
 *   createStripChart(host, {strips, source, layout, extras, steps, autostart}) -> StripChart
 *     strips: [Strip], see strips.js.   layout: of layout.js, in the host
 *     extras [{canvas, draw(frame), resize(width, height, ratio), setPalette(palette)}]: more canvases
 *     steps {next, back}: what two more buttons do, keys N and P
 *     autostart true: false draws nothing until update() is called
 *
 * Source  gives samples of an interval of time at a resolution
 *   time                    what is in view, and cursors: a Timeline or a TimeWindow
 *   dt, alertAbove          interval of samples [s]; alert level of the risk, or NaN
 *   newest()                time of the last sample [s]; NaN for none
 *   follows                 whether samples arrive: the readouts are then shown five times a second
 *   flags                   moments that are marked, see strip.js
 *   begin(wall)             a turn begins
 *   stamp(), news()         change with what is drawn; with what is to be read at once
 *   read({view, start, step, width, x, wall}) -> {parts, bands, now, lead, ahead}      see strip.js
 *   reading(strip, view, cursor), bar(view), describe(strip), valuesAt(strip, t)   see readings.js
 *
 * StripChart
 *   update(wall) -> ms      draws now, if anything changed; returns the time it took
 *   redraw()                something changed that the source does not know of
 *   measure()               the layout changed
 *   setMarking(flag)        whether a drag sets A and B in place of moving the window
 *   destroy()
 */

import { addDrawer } from "../lib/draw_loop.js";
import { attachControls, attachMarking } from "./input.js";
import { readPalette, watchTheme } from "./palette.js";
import { createReadings } from "./readings.js";
import { createStrip } from "./strip.js";
import { GUTTER } from "./strip_frame.js";
import { createTimeAxis, timeTicks } from "./time_axis.js";

const READ_EVERY = 200; // ms; faster digits cannot be read
const DESCRIBED_EVERY = 1000; // ms

export function createStripChart(host, options) {
  const { strips, source, layout, extras = [], steps, autostart = true } = options;
  const { time } = source;
  const canvases = strips.map((strip, k) => {
    const { canvas } = layout.rowOf[k];
    return { canvas, ...createStrip(canvas, strip) };
  });
  const parts = [...canvases, { canvas: layout.axis, ...createTimeAxis(layout.axis) }, ...extras];
  const readings = createReadings(strips, layout, source);
  const drawn = { picture: "", first: NaN, news: "", read: -1e9, told: "", described: -1e9 };
  let look = 0; // counts changes of size, theme, limits
  let plot = 1;
  let wall = performance.now();
  let measured = false;

  function measure() {
    const ratio = devicePixelRatio || 1;
    const widths = parts.map(({ canvas, resize }) => {
      const { width, height } = canvas.parentElement.getBoundingClientRect();
      resize(width, height, ratio);
      return width;
    });
    plot = Math.max(16, Math.floor(widths[0]) - GUTTER);
    measured = widths[0] > 0;
    if (measured) setPalette(); // colours exist only on the page
  }

  function setPalette() {
    const palette = readPalette(host);
    for (const part of parts) part.setPalette(palette);
    look += 1;
  }

  function update(at = performance.now()) {
    const begin = performance.now();
    wall = at;
    if (!measured) measure();
    if (!measured) return 0;
    source.begin(wall);
    const view = time.view(wall);
    const step = (view.end - view.start) / plot;
    const first = Math.round(view.end / step) - plot; // whole columns: the trace does not shimmer
    const picture = `${source.stamp()} ${time.revision} ${look}`;
    const isMoving = strips.some(({ axis }) => axis.moving || axis.roomy);
    if (picture !== drawn.picture || first !== drawn.first || isMoving) draw(view, step, first);
    const news = `${source.news()} ${time.revision} ${look}`;
    if (news !== drawn.news || (source.follows && wall - drawn.read >= READ_EVERY)) {
      Object.assign(drawn, { news, read: wall });
      readings.show(view);
    }
    if (picture !== drawn.told && wall - drawn.described >= DESCRIBED_EVERY) {
      Object.assign(drawn, { told: picture, described: wall });
      readings.describe();
    }
    Object.assign(drawn, { picture, first });
    return performance.now() - begin;
  }

  function draw(view, step, first) {
    const start = first * step;
    const x = (t) => (t - start) / step;
    const window = { view, start, step, first, width: plot, x, wall };
    const frame = {
      ...window,
      ticks: timeTicks(start, start + plot * step, plot),
      cursor: time.cursorAt(view),
      marks: time.marks,
      flags: source.flags,
      alertAbove: source.alertAbove,
      ...source.read(window),
    };
    for (const part of parts) part.draw(frame);
  }

  attachControls(host, layout, time, {
    view: () => time.view(wall),
    plotWidth: () => plot,
    dt: () => source.dt,
    newest: source.newest,
    wall: () => wall,
    steps,
  });
  const marking = attachMarking(layout.rows, time, { left: () => GUTTER, width: () => plot });
  const resizing = new ResizeObserver(() => {
    measured = false;
    if (autostart) update();
  });
  resizing.observe(host);
  const unwatch = watchTheme(host, () => {
    setPalette();
    update(wall); // printing does not wait for a frame
  });
  const stop = autostart ? addDrawer(update) : () => {};

  return {
    update,
    redraw: () => {
      look += 1;
    },
    measure: () => {
      measured = false;
    },
    setMarking: marking.set,
    destroy: () => {
      stop();
      unwatch();
      resizing.disconnect();
      host.replaceChildren();
    },
  };
}
