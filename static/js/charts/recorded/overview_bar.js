/**
 * The whole recording in one low bar: risk, manoeuvres, and the interval shown. Press or drag to move it.
 *
 * createOverviewBar(canvas, {timeWindow, start, end, key, entire, manoeuvres}) -> Sheet with draw(frame), see ../layout.js
 *     key: the series drawn, "risk" or a channel's.   entire() -> TileSet | null of all
 */

import { createSheet, GUTTER } from "../layout.js";

export function createOverviewBar(canvas, options) {
  const { timeWindow, start, end, key, entire, manoeuvres } = options;
  const sheet = createSheet(canvas);
  const { pen } = sheet;
  const width = () => Math.max(1, sheet.width - GUTTER);
  const x = (t) => ((t - start) / (end - start)) * width();

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    move(event);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (canvas.hasPointerCapture(event.pointerId)) move(event);
  });

  function move(event) {
    const left = canvas.getBoundingClientRect().left + GUTTER;
    const t = start + ((event.clientX - left) / width()) * (end - start);
    const { start: from, end: to } = timeWindow.view();
    timeWindow.setWindow(t - (to - from) / 2, t + (to - from) / 2);
  }

  function draw({ alertAbove, view }) {
    const set = entire();
    const { height, palette } = sheet;
    sheet.clear("all");
    pen.fillStyle = palette.grid;
    pen.fillRect(0, 0, width(), height);
    if (set) drawSeries(set, alertAbove);
    for (const manoeuvre of manoeuvres) {
      pen.fillStyle = palette.text;
      const [x0, x1] = [x(manoeuvre.start), x(manoeuvre.end)];
      pen.fillRect(x0, height - 3, Math.max(2, x1 - x0), 3);
    }
    drawWindow(view);
  }

  function drawSeries(set, alertAbove) {
    const risk = key === "risk";
    const { height, palette } = sheet;
    const shown = set.series(key);
    const low = risk ? 0 : Math.min(...finite(shown.low));
    const high = risk ? 1 : Math.max(...finite(shown.high));
    const room = height - 4;
    const y = (value) => {
      const share = (value - low) / (high - low || 1);
      return room - (risk ? Math.sqrt(Math.max(0, share)) : share) * (room - 2);
    };
    const wide = Math.max(1, (set.step / (end - start)) * width() + 0.3);
    const withdrawn = risk ? set.series("withdrawn").high : [];
    for (let i = 0; i < set.n; i++) {
      const at = x(set.x0[i]);
      const column = (from, to, colour) => {
        pen.fillStyle = colour;
        pen.fillRect(at, Math.min(from, to), wide, Math.max(1, Math.abs(from - to)));
      };
      if (risk && withdrawn[i] >= 0) column(y(withdrawn[i]), room, palette.stale);
      if (!Number.isFinite(shown.high[i])) continue;
      if (risk) {
        column(y(shown.high[i]), room, shown.high[i] > alertAbove ? palette.alert : palette.trace);
        continue;
      }
      const before = Number.isFinite(shown.high[i - 1]) ? i - 1 : i; // the trace does not break
      const top = Math.max(shown.high[i], shown.low[before]);
      column(y(top), y(Math.min(shown.low[i], shown.high[before])), palette.trace);
    }
  }

  function drawWindow(view) {
    const [x0, x1] = [x(view.start), x(view.end)];
    const { height, palette } = sheet;
    if (x1 - x0 > width() - 1) return;
    pen.fillStyle = palette.panel;
    pen.globalAlpha = 0.55;
    pen.fillRect(0, 0, x0, height);
    pen.fillRect(x1, 0, width() - x1, height);
    pen.globalAlpha = 1;
    pen.strokeStyle = palette.cursor;
    pen.lineWidth = 2;
    pen.strokeRect(x0 + 1, 1, Math.max(4, x1 - x0) - 2, height - 2);
  }

  return Object.assign(sheet, { draw });
}

function finite(values) {
  return [...values].filter(Number.isFinite);
}
