/**
 * The whole recording in one low strip: risk, manoeuvres, and the interval shown. Press or drag to move it.
 *
 * createOverviewBar(canvas, strip, {timeWindow, start, end, entire, manoeuvres}) -> Sheet with draw(frame), see ../layout.js
 *     entire() -> TileSet | null of all
 */

import { GUTTER, unit } from "../layout.js";
import { createStrip } from "../strip.js";
import { cellsOf } from "./cells.js";

const UNMARKED = { ticks: { times: [], step: 1 }, flags: [], bands: [], cursor: NaN, marks: { a: NaN, b: NaN } };

export function createOverviewBar(canvas, strip, { timeWindow, start, end, entire, manoeuvres }) {
  const face = createStrip(canvas, strip);
  const { pen } = face;
  const width = () => Math.max(1, face.width - GUTTER);
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
    const at = (event.clientX - canvas.getBoundingClientRect().left) / unit() - GUTTER;
    const t = start + (at / width()) * (end - start);
    const { start: from, end: to } = timeWindow.view();
    timeWindow.setWindow(t - (to - from) / 2, t + (to - from) / 2);
  }

  function draw(frame) {
    const whole = { view: { start, end }, start, step: (end - start) / width(), first: 0, columns: face.canvas.width - face.left, pitch: 1 / face.ratio, width: width(), x };
    const cells = cellsOf(entire(), null, whole);
    const parts = cells ? [{ cells, colour: "trace", quiet: { boxes: [] }, withdrawn: true }] : [];
    drawStrip({ ...frame, ...UNMARKED, ...whole, parts, picture: NaN }); // the window is drawn over it
    for (const manoeuvre of manoeuvres) {
      pen.fillStyle = face.palette.text;
      const [x0, x1] = [x(manoeuvre.start), x(manoeuvre.end)];
      pen.fillRect(x0, face.height - 3, Math.max(2, x1 - x0), 3);
    }
    drawWindow(frame.view);
  }

  function drawWindow(view) {
    const [x0, x1] = [x(view.start), x(view.end)];
    const { height, palette } = face;
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

  const drawStrip = face.draw;
  return Object.assign(face, { draw });
}
