/**
 * What a chart shows, to save: as vectors, as pixels, or its values.
 *
 * createVectorCanvas(width, height) -> {getContext() -> pen, svg() -> elements as text}
 *     a stand-in for a canvas: strips draw with its pen what they draw on the page
 * pictureOf(title, sheets) -> svg text     sheets: [{canvas, name, height}] from top to bottom, of one width [units]
 * savePicture(svg, name), savePixels(svg, name) -> Promise, saveText(text, name, type)     as a download
 * valuesOf(strips, cells) -> CSV text     a row for each cell in view; least and greatest value where a cell has several samples
 */

import { dayClock, formatTime } from "../lib/clock.js";
import { h } from "../lib/dom.js";
import { shownIn } from "../lib/numbers.js";
import { GUTTER } from "./layout.js";

const DENSE = 2; // pixels a unit
const HEAD = 34; // units above the strips
const FONT = "system-ui, sans-serif";
const ENTITIES = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };
const ANCHORS = { left: "start", center: "middle", right: "end" };

const escaped = (text) => String(text).replace(/[&<>"]/g, (sign) => ENTITIES[sign]);
const short = (number) => String(Math.round(100 * number) / 100);

let ids = 0;

export function createVectorCanvas(width, height) {
  const parts = [];
  const ruler = document.createElement("canvas").getContext("2d");
  const kept = [];
  let path = [];
  let dash = [];
  let place = new DOMMatrix();
  let groups = 0; // of clips, to close
  const pen = {
    fillStyle: "#000", strokeStyle: "#000", lineWidth: 1, lineJoin: "miter", globalAlpha: 1,
    font: `12px ${FONT}`, textAlign: "left", textBaseline: "alphabetic",
    save, restore, clip, fill, stroke, fillRect, fillText, createPattern,
    setTransform: (...values) => {
      place = new DOMMatrix(values);
    },
    translate: (x, y) => {
      place = place.translate(x, y);
    },
    rotate: (angle) => {
      place = place.rotate((180 * angle) / Math.PI);
    },
    setLineDash: (given) => {
      dash = given;
    },
    beginPath: () => {
      path = [];
    },
    closePath: () => path.push("Z"),
    moveTo: (x, y) => path.push(`M${at(x, y)}`),
    lineTo: (x, y) => path.push(`L${at(x, y)}`),
    rect: (x, y, wide, high) => path.push(boxOf(x, y, wide, high)),
    measureText: (text) => {
      ruler.font = pen.font;
      return ruler.measureText(text);
    },
  };
  return { getContext: () => pen, width, height, svg: () => parts.join("") };

  function at(x, y) {
    const point = place.transformPoint({ x, y });
    return `${short(point.x)} ${short(point.y)}`;
  }

  function boxOf(x, y, wide, high) {
    return `M${at(x, y)}L${at(x + wide, y)}L${at(x + wide, y + high)}L${at(x, y + high)}Z`;
  }

  function draw(tag, attributes, content = "") {
    const opacity = pen.globalAlpha === 1 ? {} : { opacity: short(pen.globalAlpha) };
    const words = Object.entries({ ...attributes, ...opacity }).map(([name, value]) => ` ${name}="${escaped(value)}"`);
    parts.push(`<${tag}${words.join("")}>${content}</${tag}>`);
  }

  function fill() {
    draw("path", { d: path.join(""), fill: pen.fillStyle });
  }

  function fillRect(x, y, wide, high) {
    draw("path", { d: boxOf(x, y, wide, high), fill: pen.fillStyle });
  }

  function stroke() {
    const look = { stroke: pen.strokeStyle, "stroke-width": pen.lineWidth, "stroke-linejoin": pen.lineJoin };
    draw("path", { d: path.join(""), fill: "none", ...look, ...(dash.length > 0 && { "stroke-dasharray": dash.join(" ") }) });
  }

  function fillText(text, x, y) {
    const { a, b, c, d, e, f } = place.translate(x, y);
    const baseline = pen.textBaseline === "middle" ? "central" : "auto";
    const look = { style: `font: ${pen.font}`, fill: pen.fillStyle, "text-anchor": ANCHORS[pen.textAlign], "dominant-baseline": baseline };
    draw("text", { transform: `matrix(${[a, b, c, d, e, f].map(short).join(" ")})`, ...look }, escaped(text));
  }

  function clip(rule = "nonzero") {
    const id = `clip-${++ids}`;
    parts.push(`<clipPath id="${id}"><path d="${path.join("")}" clip-rule="${rule}"/></clipPath><g clip-path="url(#${id})">`);
    groups += 1;
  }

  function save() {
    const { fillStyle, strokeStyle, lineWidth, globalAlpha, font, textAlign, textBaseline } = pen;
    kept.push({ look: { fillStyle, strokeStyle, lineWidth, globalAlpha, font, textAlign, textBaseline }, place, dash, groups });
  }

  function restore() {
    const before = kept.pop();
    parts.push("</g>".repeat(groups - before.groups));
    Object.assign(pen, before.look);
    ({ place, dash, groups } = before);
  }

  function createPattern(tile) {
    const id = `hatch-${++ids}`;
    const { width: wide, height: high } = tile;
    parts.push(`<pattern id="${id}" width="${wide}" height="${high}" patternUnits="userSpaceOnUse"><image href="${tile.toDataURL()}" width="${wide}" height="${high}"/></pattern>`);
    return `url(#${id})`;
  }
}

export function pictureOf({ title, words, palette, sheets }) {
  const width = sheets[0].canvas.width;
  let top = HEAD;
  const rows = sheets.map(({ canvas, name }) => {
    const label = `<text x="${GUTTER + 8}" y="15" style="font: 700 12px ${escaped(palette.font)}; paint-order: stroke" stroke="${palette.panel}" stroke-width="4" fill="${palette.text}">${escaped(name)}</text>`;
    const row = `<g transform="translate(0 ${top})">${canvas.svg()}${label}</g>`;
    top += canvas.height;
    return row;
  });
  const line = (y, text, weight, colour) =>
    `<text x="8" y="${y}" style="font: ${weight} 12px ${escaped(palette.font)}" fill="${colour}">${escaped(text)}</text>`;
  const head = line(14, title, 700, palette.text) + line(28, words, 400, palette.dim);
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${top}" viewBox="0 0 ${width} ${top}"><rect width="100%" height="100%" fill="${palette.panel}"/>${head}${rows.join("")}</svg>`;
}

export function valuesOf(strips, { cells, from, to }) {
  const out = new Float64Array(2);
  const columns = strips.map((strip) => ({ read: cells.series(strip.key), ...shownIn(strip), key: strip.key }));
  const ends = cells.sparse ? [""] : [" least", " greatest"];
  const head = columns.flatMap(({ key, unit }) => ends.map((end) => `${key}${end}${unit && ` [${unit}]`}`));
  const clock = dayClock();
  const times = ["t [s]", ...(clock === null ? [] : [`time of day${clock.name === "UTC" ? " (UTC)" : ""}`])];
  const rows = [[...times, ...head].map(quoted).join(",")];
  for (let i = 0; i < cells.n; i++) {
    const t = cells.t(i);
    if (t < from || t > to) continue;
    const values = columns.flatMap(({ read, factor }) => (read(i, out) ? ends.map((_, k) => Number((out[k] * factor).toPrecision(7))) : ends.map(() => "")));
    rows.push([Number(t.toPrecision(9)), ...(clock === null ? [] : [formatTime(t, 0.001)]), ...values].join(","));
  }
  return `${rows.join("\r\n")}\r\n`;
}

const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);

function download(blob, name) {
  const address = URL.createObjectURL(blob);
  h("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

export const saveText = (text, name, type) => download(new Blob([text], { type }), name);

export const savePicture = (svg, name) => saveText(svg, name, "image/svg+xml");

export async function savePixels(svg, name) {
  const image = new Image();
  image.src = `data:image/svg+xml,${encodeURIComponent(svg)}`;
  await image.decode();
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width: DENSE * image.width, height: DENSE * image.height });
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  download(await new Promise((made) => canvas.toBlob(made, "image/png")), name);
}
