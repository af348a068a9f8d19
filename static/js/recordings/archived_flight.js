/** A flight of an archive as one monitor scored it: strips, events, verdicts and notes, from the archive's own samples. */

import { setZero } from "../lib/clock.js";
import { empty, formatted, guideLink, h, link, loadingView, pageOf, panel, recipeList, sentences } from "../lib/dom.js";
import { bytesText, count, figure, moment } from "../lib/numbers.js";
import { createScoredChart } from "./scoring/scored_chart.js";
import { tileSource } from "./scoring/source.js";
import { alertRule, NO_CLOCK, outcomeChip, outsideChip, trimText } from "./words.js";

export function showArchivedFlight(element, { id, query, api }) {
  const base = `/archives/${id}/flights/${encodeURIComponent(query.get("flight"))}`;
  const monitor = query.get("monitor") ? `monitor=${encodeURIComponent(query.get("monitor"))}` : "";
  return loadingView(element, { title: "Archived flight", text: "Opening the flight", loads: [`${base}?${monitor}`], build });

  function build({ keep }, flight) {
    setZero(flight.time_zero, NO_CLOCK);
    const { manoeuvres } = flight;
    const host = h("div.scored-chart");
    const tiles = tileSource(api, `${base}/tiles?${monitor}&`, flight);
    const { chart, list, verdicts } = createScoredChart(flight, host, tiles, () => ({ label: `${flight.flight} as ${flight.monitor} assessed it` }));
    keep({ close: chart.destroy });
    const others = flight.monitors.filter((name) => name !== flight.monitor);
    return pageOf(
      flight.flight,
      [link("Archive", `#/archives/${id}`), ...others.map((name) => link(`By ${name}`, `#/archives/${id}?${new URLSearchParams({ flight: flight.id, monitor: name })}`))],
      summary(flight),
      h("div.scored", h("div.stack-tight", host, chart.cross), h("div.scored-side", list)),
      panel(
        ["Outcome of each manoeuvre ", guideLink("what-the-numbers-mean#after-the-flight", "outcomes after the flight")],
        manoeuvres.length ? verdicts.element : empty("No manoeuvre", "No manoeuvre was detected."),
        { beside: h("span.dim", formatted(`values are ${trimText(flight)}`)), "aria-label": "Verdicts" },
      ),
      panel("How it was scored", [recipeList(factsOf(flight)), sentences([...flight.notes, ...(flight.quality?.sentences ?? [])])]),
    );
  }
}

function summary(flight) {
  const counts = Map.groupBy(flight.manoeuvres, ({ verdict }) => verdict.word);
  const fact = (words, ...content) => h("span", h("span.dim", words), content);
  return h(
    "div.row.scored-summary",
    [...counts.values()].map(({ length: n, 0: first }) => outcomeChip(first, n)),
    outsideChip(flight),
    fact("Monitor ", flight.monitor),
    h("span", formatted(alertRule(flight))),
    fact("warning lead time ", `${figure(flight.lead)} s`),
    fact("channels are ", formatted(trimText(flight))),
  );
}

function factsOf(flight) {
  return [
    ["File, SHA-256", flight.digest, true],
    ["File size", bytesText(flight.size)],
    ["Monitor, SHA-256", flight.monitor_digest, true],
    ["Scored", `${moment(flight.created)} by Forewarn ${flight.version}`],
    ["Samples", `${count(flight.n_samples)}, every ${figure(flight.dt)} s`],
  ];
}
