/**
 * Moments as people read them: in test time [s], or in the time of day where the zero of the test time is known.
 *
 * formatTime(t, step)    "12.50", "3:05" from two minutes on, "1:03:05" from an hour on; "15:35:50.70" in the time of day;
 *     as fine as `step` [s] needs
 * secondsText(t, step)   the same with its unit, a dash for null
 * TIMES -> ["test", "day"], timeChoice(), useTime(name), chooseTime(name)    what the user wants; a choice is remembered
 * intervalText(from, to, step)    "1.00 to 2.50"; in the time of day with date and zone
 * setZero(start, why)    of the view that is open; start: when t is 0, as the server publishes it, empty where it is not known
 *     why: then the reason.   clearZero(): no moments in view
 * watchZero(show)        show({why} | null) now and at each change; why is empty while the time of day is known
 * dayClock() -> {name, day, seconds} | null    while moments are shown in the time of day
 *     name: "UTC", or "clock" of a file that names no zone.   day: "2026-11-26", "day 234", or empty
 *     seconds: of the day when t is 0 [s]
 */

import { redrawUnits } from "./numbers.js";
import { remember, remembered } from "./storage.js";

const KEY = "forewarn.time";
const DAY = 86_400; // s
const START = /^(?:(\d{4}-\d\d-\d\d)T|(\d{3}):)?(\d\d):(\d\d):(\d\d(?:\.\d+)?)(Z|[+-]\d\d:?\d\d)?$/;
export const TIMES = ["test", "day"];

let choice = TIMES.find((name) => name === remembered(KEY)) ?? TIMES[0];
let zero = null; // {name, day, seconds}
let state = null; // {why}
let show = (_state) => {};

export const timeChoice = () => choice;

export function useTime(name) {
  if (TIMES.includes(name)) choice = name;
}

export function chooseTime(name) {
  useTime(name);
  remember(KEY, name);
}

export const dayClock = () => (choice === TIMES[1] ? zero : null);

export function setZero(start, why) {
  const now = parsed(start);
  const isSame = now?.seconds === zero?.seconds && now?.day === zero?.day;
  const words = now === null ? why : "";
  if (isSame && words === state?.why) return;
  zero = now;
  state = { why: words };
  show(state);
  if (!isSame && choice === TIMES[1]) redrawUnits(document);
}

export function clearZero() {
  zero = state = null;
  show(state);
}

export function watchZero(given) {
  show = given;
  show(state);
}

function parsed(start) {
  const [, date, ordinal, hour, minute, second, zone] = START.exec(start) ?? [];
  if (second === undefined) return null;
  const [, sign, hours, minutes] = /([+-])(\d\d):?(\d\d)/.exec(zone ?? "") ?? [null, "+", 0, 0];
  const offset = Number(`${sign}1`) * (3600 * Number(hours) + 60 * Number(minutes));
  const seconds = 3600 * Number(hour) + 60 * Number(minute) + Number(second) - offset;
  return { name: zone ? "UTC" : "clock", seconds, day: date ?? (ordinal ? `day ${Number(ordinal)}` : "") };
}

export function formatTime(t, step) {
  const places = step >= 1 ? 0 : Math.min(3, Math.ceil(-Math.log10(step) - 1e-9));
  const clock = dayClock();
  if (clock !== null) return dayText(clock.seconds + t, places);
  const sign = t < 0 ? "−" : "";
  const size = Math.abs(t);
  if (size < 120) return sign + size.toFixed(places);
  const { hours, minutes, rest } = parts(size, places);
  return sign + (hours > 0 ? `${hours}:${padded(minutes)}:${rest}` : `${minutes}:${rest}`);
}

function dayText(seconds, places) {
  const rounded = Number(seconds.toFixed(places));
  const { hours, minutes, rest } = parts(((rounded % DAY) + DAY) % DAY, places);
  return `${padded(hours % 24)}:${padded(minutes)}:${rest}`;
}

/** Rounded as a whole: no 60 seconds. */
function parts(seconds, places) {
  const total = Number(seconds.toFixed(places));
  const minutes = Math.floor(total / 60);
  const rest = (total - 60 * minutes).toFixed(places).padStart(places > 0 ? places + 3 : 2, "0");
  return { hours: Math.floor(minutes / 60), minutes: minutes % 60, rest };
}

const padded = (n) => String(n).padStart(2, "0");

export function secondsText(t, step = 0.01) {
  if (t == null) return "–";
  return dayClock() === null ? `${formatTime(t, step)} s` : formatTime(t, step);
}

export function intervalText(from, to, step) {
  const [first, last] = [from, to].map((t) => formatTime(t, step));
  const clock = dayClock();
  return clock === null ? `${first} to ${last}` : `${clock.day} ${first} to ${last} ${clock.name === "UTC" ? "UTC" : ""}`.trim();
}
