/** How a scoring was made: hashes, request, mapping, processing. Exports  scoringFacts(scoring). */

import { h } from "../../lib/dom.js";
import { recipeList, sentences } from "../../lib/lists.js";
import { figure, moment } from "../../lib/numbers.js";
import { magnitudeIn } from "../../lib/units.js";
import { TRIM_SEGMENT } from "./source.js";

const TRIMS = {
  [TRIM_SEGMENT]: "mean of each manoeuvre's trim segment",
  null: "not subtracted",
};
const WAYS = { detected: "detected from control activity", entire: "the entire recording as one" };

export function scoringFacts(scoring) {
  const { request, quality, notes, mapping, channels } = scoring;
  const rows = [
    ["Samples, SHA-256", scoring.digest, 1],
    ["Monitor, SHA-256", scoring.monitor_digest, 1],
    ["Scored", moment(scoring.created)],
    ["Samples", `${scoring.n_samples.toLocaleString("en")}, every ${figure(scoring.dt)} s`],
    ["Trim", TRIMS[request.trim] ?? `mean of ${request.trim} s before the first input`],
    ["Manoeuvres", WAYS[request.manoeuvres] ?? `${request.manoeuvres.length} marked by hand`],
  ];
  const sources = channels.map((channel) => [
    `${channel.label} ${channel.symbol}`,
    sourceText(mapping.channels[channel.key], channel),
  ]);
  const texts = [...notes, ...(quality?.sentences ?? [])];
  return h(
    "details",
    { class: "panel fold" },
    h("summary", {}, "how this scoring was made: hashes, mapping, processing"),
    h(
      "div",
      { class: "columns recipe-columns" },
      h(
        "div",
        { class: "stack-tight" },
        h("h3", {}, "Request (same request, same samples)"),
        recipeList(rows),
        h("h3", {}, "Mapping"),
        recipeList(sources),
      ),
      h(
        "div",
        { class: "stack-tight" },
        h("h3", {}, "Processing"),
        sentences(texts) ?? h("p", { class: "dim" }, "None."),
      ),
    ),
  );
}

function sourceText(source, channel) {
  if (!source) return "not recorded";
  if (source.derivation) return `derived (${source.derivation.replaceAll("_", " ")})`;
  const sign = source.sign === -1 ? "−" : "";
  const bias = source.bias ? `, bias of ${magnitudeIn(channel, source.bias)} removed` : "";
  return `${sign}${source.signal} in ${source.unit}${bias}`;
}
