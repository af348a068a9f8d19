/**
 * The whole recording in one low bar: risk, manoeuvres, and the interval shown.
 *
 * Exports
 *   createOverviewBar(canvas, options) -> {canvas, draw(frame), resize(...), setPalette(palette)}
 *     options: {timeWindow, start, end, key, entire(), manoeuvres}
 *     key: the series drawn, "risk" or a channel's.   entire() -> TileSet | null of all
 *
 * Press or drag to move the window. The keys of the strips do the same.
 */

import { sizeCanvas } from "../layout.js";
import { GUTTER } from "../strip_frame.js";

export function createOverviewBar(canvas, options) {
  const { timeWindow, start, end, key, entire, manoeuvres } = options;
  const pen = canvas.getContext("2d", { alpha: false });
  let size = { width: 1, height: 1, ratio: 1 };
  let palette = {};
  const width = () => Math.max(1, size.width - GUTTER);
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
    pen.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    pen.fillStyle = palette.panel;
    pen.fillRect(0, 0, size.width, size.height);
    pen.font = `12px ${palette.font}`;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    pen.fillStyle = palette.dim;
    pen.fillText("all", GUTTER - 6, size.height / 2);
    pen.translate(GUTTER, 0);
    pen.fillStyle = palette.grid;
    pen.fillRect(0, 0, width(), size.height);
    if (set) drawSeries(set, alertAbove);
    for (const manoeuvre of manoeuvres) {
      pen.fillStyle = palette.text;
      const [x0, x1] = [x(manoeuvre.start), x(manoeuvre.end)];
      pen.fillRect(x0, size.height - 3, Math.max(2, x1 - x0), 3);
    }
    drawWindow(view);
  }

  function drawSeries(set, alertAbove) {
    const risk = key === "risk";
    const shown = set.series(key);
    const low = risk ? 0 : Math.min(...finite(shown.low));
    const high = risk ? 1 : Math.max(...finite(shown.high));
    const room = size.height - 4;
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
    if (x1 - x0 > width() - 1) return;
    pen.fillStyle = palette.panel;
    pen.globalAlpha = 0.55;
    pen.fillRect(0, 0, x0, size.height);
    pen.fillRect(x1, 0, width() - x1, size.height);
    pen.globalAlpha = 1;
    pen.strokeStyle = palette.cursor;
    pen.lineWidth = 2;
    pen.strokeRect(x0 + 1, 1, Math.max(4, x1 - x0) - 2, size.height - 2);
  }

  return {
    canvas,
    draw,
    resize: (...given) => {
      size = sizeCanvas(canvas, ...given);
    },
    setPalette: (given) => {
      palette = given;
    },
  };
}

function finite(values) {
  return [...values].filter(Number.isFinite);
}
