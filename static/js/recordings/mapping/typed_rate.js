/**
 * The sampling rate of a table without a time column, as people write it: "50 Hz from 12:31:05".
 *
 * Exports
 *   readRate(text) -> {signal: "", unit: "s", rate, start} | null     null: not a rate
 *   rateText({rate, start}) -> string     as readRate reads it
 */

const RATE =
  /^(\d+(?:[.,]\d*)?) *(?:hz|1\/s|samples\/s)?(?: +from +(?:(?:(\d{1,2}):)?([0-5]?\d):)?(\d+(?:[.,]\d*)?) *(?:s|z|utc)?)?$/i;
const MINUTE = 60;
const DAY = 86400;

export function readRate(text) {
  const match = RATE.exec(text.trim());
  if (!match) return null;
  const [rate, hours, minutes, seconds] = match.slice(1).map(number);
  const outOfDay = match[3] !== undefined && (hours > 23 || seconds >= MINUTE);
  if (outOfDay || rate <= 0) return null;
  return { signal: "", unit: "s", rate, start: 3600 * hours + MINUTE * minutes + seconds };
}

export function rateText({ rate, start }) {
  if (!start) return `${rate} Hz`;
  if (start < MINUTE || start >= DAY) return `${rate} Hz from ${start} s`;
  const clock = new Date(Math.round(1000 * start)).toISOString().slice(11, 23);
  return `${rate} Hz from ${clock.replace(/\.?0*$/, "")}`;
}

function number(text) {
  return text === undefined ? 0 : Number(text.replace(",", "."));
}
