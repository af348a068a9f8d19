/**
 * Draws one channel against another: simulated flights behind, limits, and a trail that fades with age.
 *
 * createCrossPlot(canvas, {x, y, dt}) -> CrossPlot     x, y: strips of strips.js, not shared;   dt [s]
 *   canvas, resize(width, height), setPalette(palette)     see ../layout.js
 *   setFlights({safe, unsafe} | null)     [{x: [value], y: [value]}], values null where unknown
 *   draw({trail, from, to, word, at, limits, wall})
 *     trail(keys, from, to, visit), visit(t, xLow, xHigh, yLow, yHigh, isCut)     of samples, or bins of samples, of
 *       from..to [s] in order; isCut: nothing is known between it and the one before
 *     limits {x, y}: [low, high] | null at `to`.   word: why the trail is not current, or ""
 *     at: where it ends, in words, or ""
 *   describe() -> text
 */

import { piecesOf } from "../../lib/dom.js";
import { isBeyond } from "../../lib/limits.js";
import { quantity, shownIn } from "../../lib/numbers.js";
import { createSheet, GUTTER } from "../layout.js";
import { tickText } from "../strip_frame.js";
import { axisTicks } from "../value_axis.js";

const [LEGEND, FOOT, RIGHT] = [22, 22, 10]; // px above, below and right of the plot
const PAD = 4; // px between the range and the plot's edge
const STEPS = 12; // of fading
const FAINTEST = 0.12;
const OVERLAP = 12; // px between an axis' words
const MOST = 20_000; // samples of a trail


export function createCrossPlot(canvas, { x, y, dt }) {
  const sheet = createSheet(canvas);
  const ground = createSheet(document.createElement("canvas"));
  const column = () => new Float64Array(MOST);
  const points = { n: 0, cut: new Uint8Array(MOST), t: column(), xLow: column(), xHigh: column(), yLow: column(), yHigh: column() };
  let flights = null;
  let grounded = ""; // what the ground shows
  let look = 0; // counts changes of colours and flights

  const plot = { width: 1, height: 1 };
  const left = (value) => PAD + x.axis.share(value) * (plot.width - 2 * PAD);
  const top = (value) => LEGEND + PAD + (1 - y.axis.share(value)) * (plot.height - 2 * PAD);

  function visit(t, xLow, xHigh, yLow, yHigh, isCut) {
    const k = points.n;
    if (k === MOST) return;
    points.t[k] = t;
    points.xLow[k] = xLow;
    points.xHigh[k] = xHigh;
    points.yLow[k] = yLow;
    points.yHigh[k] = yHigh;
    points.cut[k] = isCut || !(xLow <= xHigh && yLow <= yHigh);
    points.n += 1;
  }

  function draw({ trail, from, to, word, at, limits, wall }) {
    points.n = 0;
    trail([x.key, y.key], from, to, visit);
    fit(limits, wall);
    drawGround(limits);
    drawTrail(from, to);
    drawHead(to, word, at, limits);
  }

  function fit(limits, wall) {
    for (const [strip, low, high, name] of [[x, "xLow", "xHigh", "x"], [y, "yLow", "yHigh", "y"]]) {
      let [least, greatest] = flights?.ranges[name] ?? [Infinity, -Infinity];
      for (let k = 0; k < points.n; k++) {
        if (points[low][k] < least) least = points[low][k];
        if (points[high][k] > greatest) greatest = points[high][k];
      }
      const [now, before] = [String(limits[name]), String(strip.limits)];
      if (now !== before) strip.axis.setLimits((strip.limits = limits[name]));
      strip.axis.fit(least, greatest, wall);
    }
  }

  /** What changes seldom is drawn once. */
  function drawGround(limits) {
    const { axis: a } = x;
    const { axis: b } = y;
    const now = [a.low, a.high, b.low, b.high, limits.x, limits.y, sheet.width, sheet.height, look].join(" ");
    if (now !== grounded) drawAxes(ground, limits);
    grounded = now;
    sheet.clear();
    sheet.paste(ground.canvas, 0);
  }

  function drawAxes(face, limits) {
    const { pen, palette } = face;
    const { width, height } = plot;
    face.clear();
    pen.fillStyle = palette.grid;
    for (const value of axisTicks(x.axis)) pen.fillRect(Math.round(left(value)), LEGEND, 1, height);
    for (const value of axisTicks(y.axis)) pen.fillRect(0, Math.round(top(value)), width, 1);
    pen.save();
    pen.beginPath();
    pen.rect(0, LEGEND, width, height);
    pen.clip();
    if (flights !== null) drawFlights(face);
    drawLimits(face, limits, width, height);
    pen.restore();
    drawNumbers(face, width, height);
    if (flights !== null) drawLegend(face, width);
  }

  function drawFlights({ pen, palette }) {
    for (const { look: ink, lines } of [looks(palette, "safe"), looks(palette, "unsafe")]) {
      Object.assign(pen, ink);
      pen.setLineDash(ink.dash);
      for (const line of lines) {
        let drawing = false;
        pen.beginPath();
        for (let k = 0; k < line.x.length; k++) {
          const isKnown = line.x[k] !== null && line.y[k] !== null;
          if (isKnown && drawing) pen.lineTo(left(line.x[k]), top(line.y[k]));
          else if (isKnown) pen.moveTo(left(line.x[k]), top(line.y[k]));
          drawing = isKnown;
        }
        pen.stroke();
      }
      pen.setLineDash([]);
      if (ink.hasEnds) for (const line of lines) cross(pen, left(line.x.at(-1) ?? NaN), top(line.y.at(-1) ?? NaN));
      pen.globalAlpha = 1;
    }
  }

  /** The unsafe ones are dashed, and end with a cross where they exceed a limit. */
  function looks(palette, outcome) {
    const isSafe = outcome === "safe";
    const look = { strokeStyle: isSafe ? palette.band : palette.alert, lineWidth: 1, globalAlpha: isSafe ? 0.45 : 0.5 };
    return { look: { ...look, dash: isSafe ? [] : [4, 3], hasEnds: !isSafe }, lines: flights[outcome] };
  }

  function drawLimits({ pen, palette }, limits, width, height) {
    const level = (at, isAcross, side) => {
      const start = isAcross ? LEGEND : 0;
      const end = isAcross ? LEGEND + height : width;
      const [from, to] = (side === 0) === isAcross ? [at, end] : [start, at];
      pen.fillStyle = palette.limit;
      pen.globalAlpha = 0.07;
      if (isAcross) pen.fillRect(0, from, width, to - from);
      else pen.fillRect(from, LEGEND, to - from, height);
      pen.globalAlpha = 1;
      if (isAcross) pen.fillRect(0, at - 1, width, 2);
      else pen.fillRect(at - 1, LEGEND, 2, height);
    };
    (limits.x ?? []).forEach((limit, side) => Number.isFinite(limit) && level(Math.round(left(limit)), false, side));
    (limits.y ?? []).forEach((limit, side) => Number.isFinite(limit) && level(Math.round(top(limit)), true, side));
  }

  function drawNumbers({ pen, palette }, width, height) {
    pen.fillStyle = palette.dim;
    pen.font = `12px ${palette.font}`;
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const value of axisTicks(y.axis)) pen.fillText(tickText(value, y.axis), -6, Math.min(LEGEND + height - 6, Math.max(LEGEND + 6, top(value))));
    pen.textAlign = "center";
    const foot = LEGEND + height + 12;
    const unit = nameOf(x);
    let taken = width - widthOf(pen, unit) - OVERLAP;
    for (const value of axisTicks(x.axis).reverse()) {
      const text = tickText(value, x.axis);
      const half = pen.measureText(text).width / 2;
      const at = Math.max(half, left(value));
      if (at + half > taken) continue;
      pen.fillText(text, at, foot);
      taken = at - half - OVERLAP;
    }
    pen.fillStyle = palette.text;
    pen.textAlign = "left";
    write(pen, unit, width - widthOf(pen, unit), foot);
    write(pen, nameOf(y), 0, LEGEND / 2);
  }

  function drawLegend({ pen, palette }, width) {
    pen.font = `12px ${palette.font}`;
    pen.textAlign = "left";
    let at = width;
    for (const outcome of ["unsafe", "safe"]) {
      const { look: ink, lines } = looks(palette, outcome);
      const text = `${lines.length} ${outcome}`;
      at -= pen.measureText(text).width + 34;
      pen.fillStyle = palette.dim;
      pen.fillText(text, at + 28, LEGEND / 2);
      Object.assign(pen, { ...ink, globalAlpha: 1 });
      pen.setLineDash(ink.dash);
      pen.beginPath();
      pen.moveTo(at, LEGEND / 2);
      pen.lineTo(at + 22, LEGEND / 2);
      pen.stroke();
      pen.setLineDash([]);
    }
    const title = "simulated:";
    at -= pen.measureText(title).width + 8;
    pen.fillStyle = palette.dim;
    if (at > widthOf(pen, nameOf(y)) + 8) pen.fillText(title, at, LEGEND / 2);
  }

  /** Older samples are fainter. A bin of several samples is the box of their values. */
  function drawTrail(from, to) {
    const { pen, palette } = sheet;
    const { width, height } = plot;
    const span = Math.max(dt, to - from);
    pen.save();
    pen.beginPath();
    pen.rect(0, LEGEND, width, height);
    pen.clip();
    pen.strokeStyle = pen.fillStyle = palette.trace;
    pen.lineWidth = 1.8;
    pen.lineJoin = "round";
    let step = -1;
    let drawing = false;
    pen.beginPath();
    const { t, cut, xLow, xHigh, yLow, yHigh } = points;
    for (let k = 0; k < points.n; k++) {
      const age = Math.min(STEPS - 1, Math.floor((STEPS * (t[k] - from)) / span));
      const px = left((xLow[k] + xHigh[k]) / 2);
      const py = top((yLow[k] + yHigh[k]) / 2);
      const joins = drawing && !cut[k];
      if (joins) pen.lineTo(px, py);
      if (age !== step) {
        pen.stroke();
        pen.beginPath();
        step = age;
        pen.globalAlpha = FAINTEST + ((1 - FAINTEST) * (age + 1)) / STEPS;
        pen.moveTo(px, py);
      } else if (!joins) pen.moveTo(px, py);
      drawing = xLow[k] <= xHigh[k] && yLow[k] <= yHigh[k];
      if (drawing && (xHigh[k] > xLow[k] || yHigh[k] > yLow[k])) box(pen, left(xLow[k]), top(yHigh[k]), left(xHigh[k]), top(yLow[k]));
    }
    pen.stroke();
    pen.restore();
  }

  const isCurrent = (k, to) => k >= 0 && to - points.t[k] <= 1.5 * dt + 1e-9 && Number.isFinite(points.xLow[k]) && Number.isFinite(points.yLow[k]);

  /** Where the trail ends: open while it is not current. */
  function drawHead(to, word, where, limits) {
    const { pen, palette } = sheet;
    const last = points.n - 1;
    const text = word || (isCurrent(last, to) ? "" : "NO DATA");
    const isOver = text === "" && [[limits.x, points.xLow[last], points.xHigh[last]], [limits.y, points.yLow[last], points.yHigh[last]]].some(([own, low, high]) => own !== null && isBeyond(own.map(Math.fround), low, high).includes(true));
    const known = lastKnown();
    if (known >= 0) {
      const at = [left((points.xLow[known] + points.xHigh[known]) / 2), top((points.yLow[known] + points.yHigh[known]) / 2)];
      pen.beginPath();
      pen.arc(...at, isOver ? 6 : 4.5, 0, 2 * Math.PI);
      pen.lineWidth = 2;
      pen.fillStyle = text ? palette.panel : palette[isOver ? "alert" : "trace"];
      pen.strokeStyle = palette[isOver ? "alert" : "text"];
      pen.fill();
      pen.stroke();
    }
    const note = [text || (isOver ? "▲ LIMIT" : ""), where].filter(Boolean).join("  ");
    if (note === "") return;
    pen.font = `700 14px ${palette.font}`;
    pen.textAlign = "left";
    pen.textBaseline = "middle";
    const wide = pen.measureText(note).width;
    pen.fillStyle = palette.panel;
    pen.fillRect(4, LEGEND + 4, wide + 8, 20);
    pen.fillStyle = text ? palette.caution : isOver ? palette.alert : palette.text;
    pen.fillText(note, 8, LEGEND + 14.5);
  }

  function lastKnown() {
    let k = points.n - 1;
    while (k >= 0 && !(points.xLow[k] <= points.xHigh[k] && points.yLow[k] <= points.yHigh[k])) k -= 1;
    return k;
  }

  return {
    canvas,
    resize: (...size) => {
      sheet.resize(...size);
      ground.resize(...size);
      Object.assign(plot, { width: Math.max(1, sheet.width - GUTTER - RIGHT), height: Math.max(1, sheet.height - LEGEND - FOOT) });
      look += 1;
    },
    setPalette: (palette) => {
      sheet.setPalette(palette);
      ground.setPalette(palette);
      look += 1;
    },
    setFlights: (given) => {
      flights = given && { ...given, ranges: { x: rangeOf(given, "x"), y: rangeOf(given, "y") } };
      look += 1;
    },
    draw,
    describe: () => {
      const k = lastKnown();
      const values = k < 0 ? "no value" : `${y.symbol} ${quantity(y, points.yHigh[k])}, ${x.symbol} ${quantity(x, points.xHigh[k])}`;
      const behind = flights === null ? "" : `, ${flights.safe.length} safe and ${flights.unsafe.length} unsafe simulated flights behind`;
      return `${y.label} ${y.symbol} against ${x.label} ${x.symbol}: ${values}${behind}`;
    },
  };
}

function rangeOf({ safe, unsafe }, name) {
  let [low, high] = [Infinity, -Infinity];
  for (const line of [...safe, ...unsafe])
    for (const value of line[name]) {
      if (value === null) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  return [low, high];
}

function box(pen, x0, y0, x1, y1) {
  pen.fillRect(x0, y0, Math.max(1.8, x1 - x0), Math.max(1.8, y1 - y0));
}

function cross(pen, x, y) {
  pen.beginPath();
  for (const side of [-3, 3]) {
    pen.moveTo(x - 3, y + side);
    pen.lineTo(x + 3, y - side);
  }
  pen.stroke();
}

function nameOf(strip) {
  const { unit } = shownIn(strip);
  return unit ? `${strip.symbol} [${unit}]` : strip.symbol;
}

/** A symbol with its index, as on the page. */
function write(pen, words, x, y) {
  const { font } = pen;
  for (const [text, index] of piecesOf(words)) {
    pen.fillText(text, x, y);
    x += pen.measureText(text).width;
    if (index === "") continue;
    pen.font = font.replace("12px", "9px");
    pen.fillText(index, x, y + 3);
    x += pen.measureText(index).width;
    pen.font = font;
  }
}

function widthOf(pen, words) {
  return piecesOf(words).reduce((wide, [text, index]) => wide + pen.measureText(text + index).width, 0);
}
