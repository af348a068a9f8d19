/**
 * Units that people read: degrees, deg/s and g, or SI by choice. Values sent and received are always
 * in a channel's own `unit`; only this module converts.
 *
 * Exports
 *   shownIn(channel) -> {unit, factor, decimals}     of a reading; factor times the value in `unit`
 *     channel: as the server publishes it, {unit, display_unit, display_factor, display_decimals};
 *     one without the latter is shown in its unit
 *   reading(channel, value) -> string                a dash when missing
 *   quantity(channel, value) -> string               a reading with its unit
 *   magnitude(channel, value, digits 4) -> string    a limit, without trailing zeros
 *   magnitudeIn(channel, value) -> string            a limit with its unit
 *   isSI(), chooseSI(flag)                           remembered
 *   followUnits(element, draw) -> element            draws now, and again when other units are chosen
 *   tellUnits(page) -> bool    redraws the followers on a page with input to keep ([data-keeps-input]);
 *       false on any other page, which must be opened again
 */

import { figure, formatValue } from "./numbers.js";
import { remember, remembered } from "./storage.js";

const KEY = "forewarn.units";
const SI_DECIMALS = 3;

let si = remembered(KEY) === "SI";

export function isSI() {
  return si;
}

export function chooseSI(flag) {
  si = flag;
  remember(KEY, si ? "SI" : "degrees");
}

export function followUnits(element, draw) {
  element.dataset.units = "";
  element.addEventListener("units", draw);
  draw();
  return element;
}

export function tellUnits(page) {
  if (page.querySelector("[data-keeps-input]") === null) return false;
  for (const follower of page.querySelectorAll("[data-units]")) follower.dispatchEvent(new Event("units"));
  return true;
}

export function shownIn({ unit = "", display_unit, display_factor, display_decimals }) {
  return si || display_factor === undefined
    ? { unit, factor: 1, decimals: SI_DECIMALS }
    : { unit: display_unit, factor: display_factor, decimals: display_decimals };
}

export function reading(channel, value) {
  const { factor, decimals } = shownIn(channel);
  return formatValue(value * factor, decimals);
}

export function quantity(channel, value) {
  return `${reading(channel, value)} ${shownIn(channel).unit}`.trim();
}

export function magnitude(channel, value, digits = 4) {
  return figure(value * shownIn(channel).factor, digits);
}

export function magnitudeIn(channel, value) {
  return `${magnitude(channel, value)} ${shownIn(channel).unit}`.trim();
}
