/**
 * The monitor set of a flight: which of its monitors is in use, in words.
 *
 * alertLevel(hello)    risk above which the monitors alert; NaN where those of a set differ
 * inUse({monitor, monitor_set}) -> [text, level]    for the status strip
 * withoutLimits(hello) -> {why, widest}     why no limits or no monitor are in force, "" where they are; limits by key, beyond
 *     which a value exceeds while those in force are unknown, else null
 * createSetLine(element) -> {show(hello)}    the set, its condition and its monitor; hidden for a flight without one
 * useNote(message, t) -> event    of a `monitor` message
 * usedEvents(flight) -> [event]    of an ended flight
 */

import { h } from "../lib/dom.js";
import { limitsInWords } from "../lib/limits.js";
import { declared, whyUnknown } from "./flight_limits.js";

export function alertLevel({ monitors, monitor_set: set = null }) {
  const levels = new Set(set === null ? [monitors[0].alert_above] : set.conditions.map(({ alert_above: level }) => level));
  return levels.size === 1 ? [...levels][0] : NaN;
}

const whyOf = ({ reason }) => reason.replace(/^not applicable: /, "");

export function inUse({ monitor, monitor_set: set = null }) {
  if (set === null) return [monitor.name];
  return set.case === "" ? ["◆ none", "caution"] : [`${set.case}: ${monitor.name}`];
}

export function withoutLimits({ limits, channels, monitor_set: set = null }) {
  if (limits !== null && limits.limits === null) return { why: `LIMITS UNKNOWN: ${whyUnknown(limits)}`, widest: limits.widest };
  if (set === null || set.case !== "") return { why: "", widest: null };
  return { why: `NO MONITOR IN USE: ${whyOf(set)}`, widest: limitsInWords(channels) === "" ? set.widest : null };
}

export function createSetLine(element) {
  const words = h("span", { class: "flight-limits-words" });
  element.replaceChildren(words);
  return { show };

  function show({ monitor, monitor_set: set = null }) {
    element.hidden = set === null;
    if (set === null) return;
    const none = set.case === "";
    element.toggleAttribute("data-unknown", none);
    const now = none ? whyOf(set) : `${monitor.name}, for ${set.case}`;
    words.replaceChildren(
      h("strong", none ? "◆ NO MONITOR IN USE: " : "Monitor in use: "),
      now,
      h("span", { class: "dim" }, ` · monitor set ${set.name}${declared(set.fixed)}`),
    );
  }
}

export function useNote({ monitor, monitor_set: set = null }, t) {
  if (set.case === "") return { t, text: `no monitor in use: ${whyOf(set)} (monitor set ${set.name})`, level: "caution", seen: true };
  return { t, text: usedText(monitor.name, set.case, set) };
}

const usedText = (name, condition, set) => `monitor in use: ${name} (${condition}, monitor set ${set.name})`;

export function usedEvents({ monitor_set: set = null, limits_held: held }) {
  if (set === null) return [];
  return (held ?? []).slice(1).map(({ t, monitor }) => {
    const used = set.conditions.find((each) => each.monitor === monitor);
    if (used === undefined) return { t, text: `no monitor in use (monitor set ${set.name})`, level: "caution", seen: true };
    return { t, text: usedText(used.monitor_name, used.name, set), seen: true };
  });
}
