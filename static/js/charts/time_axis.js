/**
 * The time axis under the strips: round times, and flags on the cursors.
 *
 * Exports
 *   timeTicks(start, end, width) -> {times, step}    round times about 90 px apart
 *   createTimeAxis(canvas) -> {draw(frame), resize(width, height, ratio), setPalette(palette)}
 */

import { formatTime } from "../lib/numbers.js";
import { sizeCanvas } from "./layout.js";
import { GUTTER } from "./strip_frame.js";
import { roundStep } from "./value_axis.js";

const STEPS = [10, 15, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 14400, 21600];

export function timeTicks(start, end, width) {
  const least = ((end - start) * 90) / width;
  const step = STEPS.find((candidate) => least > 5 && candidate >= least) ?? roundStep(least);
  const times = [];
  for (let k = Math.ceil(start / step); k * step <= end; k++) times.push(k * step);
  return { times, step };
}

export function createTimeAxis(canvas) {
  const pen = canvas.getContext("2d", { alpha: false });
  let size = { width: 0, height: 0, ratio: 1 };
  let palette = {};

  function draw(frame) {
    const { ticks } = frame;
    pen.setTransform(size.ratio, 0, 0, size.ratio, 0, 0);
    pen.fillStyle = palette.panel;
    pen.fillRect(0, 0, size.width, size.height);
    pen.font = `12px ${palette.font}`;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    pen.fillStyle = palette.dim;
    pen.fillText("t [s]", GUTTER - 6, size.height / 2);
    pen.translate(GUTTER, 0);
    pen.textAlign = "center";
    for (const t of ticks.times) {
      const at = frame.x(t);
      const text = formatTime(t, ticks.step);
      const half = pen.measureText(text).width / 2;
      if (at < Math.max(8, half - 4) || at > frame.width - 8) continue; // the unit is at the left
      pen.fillRect(Math.round(at), 0, 1, 4);
      pen.fillText(text, at, size.height / 2 + 1);
    }
    flag(frame, frame.cursor, "", palette.cursor);
    flag(frame, frame.marks.a, "A", palette["mark-a"]);
    flag(frame, frame.marks.b, "B", palette["mark-b"]);
  }

  function flag(frame, t, name, colour) {
    const at = frame.x(t);
    if (!(at >= 0 && at <= frame.width)) return;
    const text = `${name} ${formatTime(t, 0.01)}`.trim();
    pen.font = `700 12px ${palette.font}`;
    const wide = pen.measureText(text).width + 10;
    const left = Math.min(frame.width - wide, Math.max(0, at - wide / 2));
    pen.fillStyle = colour;
    pen.fillRect(left, 2, wide, size.height - 4);
    pen.fillStyle = palette.panel;
    pen.fillText(text, left + wide / 2, size.height / 2 + 0.5);
  }

  return {
    draw,
    resize: (...given) => {
      size = sizeCanvas(canvas, ...given);
    },
    setPalette: (given) => {
      palette = given;
    },
  };
}
