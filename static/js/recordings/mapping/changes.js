/** Whether a scoring used another mapping than the recording has now. */

import { chip } from "../../lib/dom.js";
import { figure } from "../../lib/numbers.js";

export const PLAIN = { signal: "", unit: "", sign: 1, bias: 0, derivation: "", scale: 1, offset: 0, bits: "" };
const PLAIN_TIME = { signal: "", unit: "s", rate: 0, start: 0 };

export function earlierMapping({ mapping, channels }, now) {
  const changed = changedChannels(mapping, now);
  if (!changed.length) return null;
  const names = changed.map((key) => channels.find((channel) => channel.key === key)?.label ?? key);
  const title = `The mapping of ${names.join(", ")} has changed since. Score the recording again to compare.`;
  return chip("◆ earlier mapping", "caution", title);
}

/** How raw counts become a value, "" if the numbers are taken as they are. */
export function scaledWords({ scale = 1, offset = 0, bits = "" }) {
  const raw = bits ? `bits ${bits}` : "raw";
  const scaled = scale === 1 ? raw : `${figure(scale, 6)} × ${raw}`;
  if (!offset) return scaled === "raw" ? "" : scaled;
  return `${scaled} ${offset < 0 ? "−" : "+"} ${figure(Math.abs(offset), 6)}`;
}

export function changedChannels(before, now) {
  if (!before || !now) return [];
  const clocks = differing(before.times, now.times, PLAIN_TIME);
  return [...differing(before.channels, now.channels, PLAIN), ...(clocks.length ? ["time"] : [])];
}

function differing(before = {}, now = {}, plain) {
  const keys = [...new Set([...Object.keys(before), ...Object.keys(now)])];
  const text = (source) => JSON.stringify(Object.entries(source ? { ...plain, ...source } : {}).sort());
  return keys.filter((key) => text(before[key]) !== text(now[key]));
}
