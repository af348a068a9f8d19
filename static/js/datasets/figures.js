/**
 * Figures of a dataset: a channel's rollouts coloured by outcome, and their peaks.
 *
 * rolloutFigure({channels, rollouts, n_unsafe, n_safe})     channels: with their limits, see ../lib/limits.js
 */

import { createFigure, SPARE } from "../charts/figure.js";
import { select } from "../forms/controls.js";
import { h } from "../lib/dom.js";
import { isLimited, limitsOf, limitText } from "../lib/limits.js";
import { figure as number, magnitudeIn, shownIn } from "../lib/numbers.js";

const MOST = 40;

export function rolloutFigure({ channels, rollouts, n_unsafe, n_safe }) {
  const holder = h("div");
  const choice = select(
    channels.map(({ key, symbol, label }) => [key, label === symbol ? symbol : `${symbol}, ${label}`]),
    { "aria-label": "channel", onchange: draw, value: (channels.find(isLimited) ?? channels[0]).key },
  );
  draw();
  return h("div.stack-tight", h("div.field.field-inline.figure-choice", choice), holder);

  function draw() {
    const channel = channels.find((entry) => entry.key === choice.value);
    const { unit, factor } = shownIn(channel);
    const inUnit = (value) => (value === null ? null : value * factor);
    const ends = (limitsOf(channel) ?? []).filter(Number.isFinite).map(inUnit);
    const pointsOf = (telemetry) => telemetry.t.map((time, k) => [time, inUnit(telemetry[channel.key][k])]);
    const seriesOf = (outcome) =>
      rollouts.filter((rollout) => rollout.outcome === outcome).map(({ telemetry }) => ({ look: `plot-${outcome}`, line: pointsOf(telemetry) }));
    const [safe, unsafe] = ["safe", "unsafe"].map(seriesOf);
    const lines = [...safe, ...unsafe];
    const values = [...ends, ...lines.flatMap(({ line }) => line.map(([, value]) => value))].filter((value) => value !== null);
    const failures = unsafe.map(({ line }) => line.at(-1));
    const figure = createFigure({
      title: "Rollouts by outcome",
      label: `${channel.label} of ${lines.length} rollouts; the unsafe ones end with a cross at the failure`,
      x: { label: "time [s]", domain: [0, Math.max(0.1, ...lines.map(({ line }) => line.at(-1)[0]))] },
      y: { label: `${channel.symbol} [${unit}]`, domain: domainOf(channel, values) },
      series: [
        ...lines,
        { look: "plot-unsafe", line: [], mark: "cross", marks: failures, words: `unsafe: ${unsafe.length} of ${n_unsafe}, each to its failure` },
        { look: "plot-safe", words: `safe: ${safe.length} of ${n_safe}` },
        ...(ends.length ? [{ look: "plot-limit", words: "limit" }] : []),
      ],
      rules: rulesOf(ends, unit),
    });
    holder.replaceChildren(figure);
  }
}

/** About zero for a channel from trim; the values themselves for an absolute one. */
function domainOf({ reference }, values) {
  const [least, greatest] = values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [Infinity, -Infinity]);
  if (reference !== "absolute" || !(least < greatest)) {
    const top = SPARE * Math.max(1e-6, Math.abs(least), Math.abs(greatest));
    return Number.isFinite(top) ? [-top, top] : [-1, 1];
  }
  const spare = ((SPARE - 1) * (greatest - least)) / 2;
  return [least - spare, greatest + spare];
}

function rulesOf(ends, unit) {
  if (ends.length === 2 && ends[0] === -ends[1])
    return [{ y: ends[1], look: "plot-limit", words: `limit ${number(ends[1])} ${unit}` }, { y: ends[0], look: "plot-limit" }];
  return ends.map((y) => ({ y, look: "plot-limit", words: `limit ${number(y)} ${unit}` }));
}

export function peakFigure({ limit, edges, unsafe, safe }, channel) {
  const highest = Math.max(1, ...unsafe.map((count, k) => count + safe[k]));
  const sum = (counts) => counts.reduce((a, b) => a + b, 0);
  const barsOf = (counts, below) => counts.map((count, k) => [edges[k], edges[k + 1], below(k), below(k) + count]);
  return createFigure({
    title: `Peak ${channel.label}`,
    label: `Rollouts by their peak ${channel.label}: ${sum(unsafe)} unsafe, ${sum(safe)} safe`,
    x: {
      label:
        limit === null
          ? `peak ${channel.symbol}: share of the way from ${magnitudeIn(channel, channel.rest)} to the limit (${limitText(channel, limitsOf(channel))})`
          : `peak |${channel.symbol}| / limit of ${magnitudeIn(channel, limit)}`,
      domain: [0, Math.max(edges.at(-1), 1.1)],
    },
    y: { label: "rollouts", domain: [0, SPARE * highest] },
    series: [
      { look: "plot-safe-bar", bars: barsOf(safe, () => 0), words: "safe" },
      { look: "plot-unsafe-bar", bars: barsOf(unsafe, (k) => safe[k]), words: "unsafe (cut at the failure)" },
    ],
    rules: [{ x: 1, look: "plot-limit", words: "limit" }],
  });
}

export async function sampleRollouts(api, id) {
  const first = (outcome) => api.get(`/datasets/${id}/rollouts?outcome=${outcome}&count=${MOST}`);
  return (await Promise.all(["unsafe", "safe"].map(first))).flat();
}
