/**
 * What happened in a scored recording, in the order of its time.
 *
 * Exports
 *   eventsOf(scoring) -> [{t, text, level, stretch}]     stretch: its number;
 *       none outside of every manoeuvre
 *   spansOf(scoring, offset) -> [{start, end, withdrawn}]    as a chart takes them
 *   laneOf(stretches, {row, offset, id}) -> [item]       for a chart's lane
 */

import { formatValue, riskText, secondsText } from "../../lib/numbers.js";
import { outcomeOf } from "../words.js";

export function eventsOf({ stretches, outside, channels, epsilon }) {
  return [
    ...stretches.flatMap((stretch, k) => ofStretch(stretch, k, channels, epsilon)),
    ...(outside ?? []).map((crossing) => ofLimit(crossing, channels, " outside every manoeuvre")),
  ].sort((a, b) => a.t - b.t);
}

function ofLimit({ t, channel, value }, channels, where = "") {
  const { symbol, unit } = channels.find(({ key }) => key === channel) ?? {
    symbol: channel,
    unit: "",
  };
  const words = `${formatValue(value)} ${unit}`.trim();
  return { t, text: `${symbol} reached its limit${where}: ${words}`, level: "caution" };
}

function ofStretch(
  { name, start, alerts, crossing, peak_t: t, peak_risk: risk, validity },
  stretch,
  channels,
  epsilon,
) {
  const events = [{ t: start, text: `${name} begins`, level: "", stretch }];
  if (validity.valid === false) {
    events.push({
      t: start,
      text: `${name} is INVALID: the risk is withdrawn`,
      level: "caution",
      stretch,
    });
  }
  for (const [from, to] of alerts) {
    events.push({
      t: from,
      text: to > from ? `alert, until ${secondsText(to)}` : "alert, a single sample",
      level: "alert",
      stretch,
    });
  }
  if (crossing) {
    events.push({ ...ofLimit(crossing, channels), stretch });
  }
  if (validity.valid !== false && Number.isFinite(t) && t > start) {
    events.push({
      t,
      text: `peak risk of ${name}: ${riskText(risk, epsilon)}`,
      level: "",
      stretch,
    });
  }
  return events;
}

export function spansOf({ stretches }, offset = 0) {
  return stretches.map(({ start, end, validity }) => ({
    start: start - offset,
    end: end - offset,
    withdrawn: validity.valid === false,
  }));
}

export function laneOf(stretches, { row = 0, offset = 0, id = "stretch" } = {}) {
  return stretches.map(({ name, start, end, outcome }, k) => {
    const { word, level, mark, text } = outcomeOf(outcome);
    return {
      id: `${id}-${k}`,
      stretch: k,
      row,
      start: start - offset,
      end: end - offset,
      text: `${name}: ${word}`,
      short: `${k + 1}`,
      mark,
      level,
      title: `${name}: ${word}, ${text}`,
    };
  });
}
