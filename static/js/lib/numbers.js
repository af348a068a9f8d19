/**
 * Numbers, times, sizes and units as people read them, in one of UNIT_SYSTEMS: degrees, deg/s and g; the same with knots
 * and feet; or SI. Values sent and received are always in a channel's own `unit`; only this module converts. A missing
 * value is a dash.
 *
 * counted(n, "row")    "1 row", "2,000 rows"; counted(n, "batch", "batches")
 * riskText(risk, alertAbove)    more digits where rounding would put the risk on the wrong side of the alert level
 * leadSeconds(lead)    [s], rounded down.   rounded(number): to as many digits as people write
 * trueMinus(text)      a sentence of the server with "−4.66" for "-4.66"
 * useUnits(name)    until another choice; chooseUnits(name)    also remembered
 * shownIn(channel) -> {unit, factor, decimals}     factor times the value in `unit`; a channel as the server publishes it
 * quantity(channel, value)     a reading with its unit;   magnitudeIn(channel, value)   a limit, without trailing zeros
 * decimal("0,05")    as people type it; NaN where it is none.   decimals("0,05 0.1") -> ["0.05", "0.1"], as Number reads them
 * followUnits(element, draw) -> element     draws now, and again when other units are chosen
 * redrawUnits(page)    draws the followers again
 * tellUnits(page) -> bool    redraws the followers on a page with input to keep ([data-keeps-input]);
 *     false on any other page, which must be opened again
 */

import { remember, remembered } from "./storage.js";

const UNITS = ["bytes", "kB", "MB", "GB", "TB"];

const READABLE = 1e9; // larger numbers are written with a power of ten

export const count = (n) => n.toLocaleString("en");

export const counted = (n, one, several = `${one}s`) => `${count(n)} ${n === 1 ? one : several}`;

export const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);

export function percent(share, digits = 1) {
  return share == null ? "–" : `${(100 * share).toFixed(digits)} %`;
}

export function interval([low, high], digits = 1) {
  return `${(100 * low).toFixed(digits)} to ${(100 * high).toFixed(digits)} %`;
}

export function figure(number, digits = 3) {
  if (number == null) return "–";
  const short = Number(number.toPrecision(digits));
  const text = Math.abs(short) < READABLE ? String(short) : short.toExponential();
  return text.replaceAll("-", "−").replace("e+", "e");
}

export function rounded(number) {
  return Number(number.toPrecision(6));
}

export function moment(iso) {
  if (!iso) return "–";
  const [date, time] = iso.split("T");
  return `${date} ${time.slice(0, 5)} UTC`;
}

export function timeZero(start) {
  if (!start) return "not recorded";
  const [date, time] = start.split("T");
  const lacks = /^\d{3}:/.test(start) ? "year" : "date"; // 234:15:35:10 begins with the day of its year
  if (!time) return `${start.replace("Z", " UTC")}, without a ${lacks}`;
  const inZone = /(Z|[+-]\d\d:?\d\d)$/.test(time) ? new Date(start).getTime() : NaN;
  if (!Number.isFinite(inZone)) return `${date} ${time}`;
  return `${new Date(inZone).toISOString().replace("T", " ").replace(/\.?0*Z$/, "")} UTC`;
}

export function formatValue(value, decimals = 3) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= READABLE) return figure(value);
  const text = size.toFixed(size < 100 ? decimals : Math.min(1, decimals));
  return value < 0 && Number(text) !== 0 ? `−${text}` : text;
}

export function riskText(risk, alertAbove) {
  for (let places = risk < 0.1 ? 3 : 2; places < 6; places++) {
    const text = risk.toFixed(places);
    if (!Number.isFinite(alertAbove) || risk > alertAbove === Number(text) > alertAbove) return text;
  }
  return String(risk);
}

export function leadSeconds(lead, decimals = 3) {
  const parts = 10 ** decimals;
  const down = Math.floor(parts * (lead + 1e-6)) / parts;
  return decimals === 3 ? String(down) : down.toFixed(decimals);
}

export function durationText(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  const total = Math.round(seconds);
  if (seconds < 120) return `${seconds.toFixed(1)} s`;
  if (total < 7200) return `${Math.floor(total / 60)} min ${total % 60} s`;
  return `${Math.floor(total / 3600)} h ${Math.floor((total % 3600) / 60)} min`;
}

export function bytesText(n) {
  const power = n > 0 ? Math.min(UNITS.length - 1, Math.floor(Math.log10(n) / 3)) : 0;
  return `${power === 0 ? n : (n / 1000 ** power).toPrecision(3)} ${UNITS[power]}`;
}

export function trueMinus(text) {
  return text.replace(/(?<![\p{L}\d.,\])_-])-(?=\.?\d)/gu, "−");
}

const KEY = "forewarn.units";
const SI_DECIMALS = 3;
export const UNIT_SYSTEMS = ["deg", "kn, ft", "SI"];
const KNOTS_AND_FEET = new Map([
  ["m/s", { unit: "kn", factor: 3600 / 1852, decimals: 1 }],
  ["m", { unit: "ft", factor: 1 / 0.3048, decimals: 0 }],
]);

let system = UNIT_SYSTEMS.find((name) => name === remembered(KEY)) ?? UNIT_SYSTEMS[0];

export const unitSystem = () => system;

export function useUnits(name) {
  if (UNIT_SYSTEMS.includes(name)) system = name;
}

export function chooseUnits(name) {
  useUnits(name);
  remember(KEY, name);
}

export function followUnits(element, draw) {
  element.dataset.units = "";
  element.addEventListener("units", draw);
  draw();
  return element;
}

export function redrawUnits(page) {
  for (const follower of page.querySelectorAll("[data-units]")) follower.dispatchEvent(new Event("units"));
}

export function tellUnits(page) {
  if (page.querySelector("[data-keeps-input]") === null) return false;
  redrawUnits(page);
  return true;
}

export function shownIn({ unit = "", display_unit, display_factor, display_decimals }) {
  if (system === "kn, ft" && KNOTS_AND_FEET.has(unit)) return KNOTS_AND_FEET.get(unit);
  return system === "SI" || display_factor === undefined
    ? { unit: unit === "1" ? "" : unit, factor: 1, decimals: SI_DECIMALS }
    : { unit: display_unit, factor: display_factor, decimals: display_decimals };
}

export function reading(channel, value) {
  const { factor, decimals } = shownIn(channel);
  return formatValue(value * factor, decimals);
}

export function quantity(channel, value) {
  return `${reading(channel, value)} ${shownIn(channel).unit}`.trim();
}

/** Beside a value from trim that is far from the one as recorded. */
export const sensorText = (channel, recorded) => `from trim, sensor ${quantity(channel, recorded)}`;

/** After the largest value of a latched exceedance: the sensor's, where it is further beyond. */
export const sensorPeak = (channel, { recorded = null }) => (recorded === null ? "" : ` ${sensorText(channel, recorded)}`);

export function magnitude(channel, value, digits = 4) {
  return figure(value * shownIn(channel).factor, digits);
}

export function magnitudeIn(channel, value) {
  return `${magnitude(channel, value)} ${shownIn(channel).unit}`.trim();
}

const COMMA = /^[+−-]?\d*,\d+$/;

export function decimal(text) {
  const [only, ...more] = decimals(text);
  return only === undefined || more.length ? NaN : Number(only.replace("−", "-"));
}

export function decimals(text) {
  return text
    .split(/[\s;]+/)
    .flatMap((word) => (COMMA.test(word) ? [word.replace(",", ".")] : word.split(",")))
    .filter(Boolean);
}
