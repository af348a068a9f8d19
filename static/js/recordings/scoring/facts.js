/** How a scoring was made: hashes, order, mapping, what was done to the data. Exports  scoringFacts(scoring). */

import { h } from "../../lib/dom.js";
import { recipeList, sentences } from "../../lib/lists.js";
import { figure, moment } from "../../lib/numbers.js";

const TRIMS = { lead_in: "mean of each manoeuvre's own lead-in", null: "nothing was subtracted" };
const WAYS = { found: "found by control activity", whole: "the whole recording as one" };

export function scoringFacts(scoring) {
  const { order, quality, notes, mapping, channels } = scoring;
  const rows = [
    ["Samples, SHA-256", scoring.digest, 1],
    ["Monitor, SHA-256", scoring.monitor_digest, 1],
    ["Scored", moment(scoring.created)],
    ["Samples", `${scoring.n_samples.toLocaleString("en")}, every ${figure(scoring.dt)} s`],
    ["Trim", TRIMS[order.trim] ?? `mean of ${order.trim} s before the first input`],
    ["Manoeuvres", WAYS[order.manoeuvres] ?? `${order.manoeuvres.length} marked by hand`],
  ];
  const sources = channels.map(({ key, symbol, label, unit }) => [
    `${label} ${symbol}`,
    sourceText(mapping.channels[key], unit),
  ]);
  const texts = [...notes, ...(quality?.sentences ?? [])];
  return h(
    "details",
    { class: "panel fold" },
    h("summary", {}, "how it was made: hashes, mapping, what was done to the data"),
    h(
      "div",
      { class: "columns recipe-columns" },
      h(
        "div",
        { class: "stack-tight" },
        h("h3", {}, "The same order makes the same samples"),
        recipeList(rows),
        h("h3", {}, "Mapping"),
        recipeList(sources),
      ),
      h(
        "div",
        { class: "stack-tight" },
        h("h3", {}, "What was done to the data"),
        sentences(texts) ?? h("p", { class: "dim" }, "Nothing."),
      ),
    ),
  );
}

function sourceText(source, unit) {
  if (!source) return "absent";
  if (source.derivation) return `derived (${source.derivation.replaceAll("_", " ")})`;
  const sign = source.sign === -1 ? "−" : "";
  const offset = source.offset ? `, less ${source.offset} ${unit}` : "";
  return `${sign}${source.signal} in ${source.unit}${offset}`;
}
