/** A flight of an archive as one monitor scored it: strips, events, verdicts and notes, from the archive's own samples. */

import { setZero } from "../lib/clock.js";
import { empty, h, link, loadingView, pageOf, panel, recipeList, sentences } from "../lib/dom.js";
import { bytesText, count, figure, moment } from "../lib/numbers.js";
import { createScoredChart } from "./scoring/scored_chart.js";
import { tileSource } from "./scoring/source.js";
import { NO_CLOCK, scoredSummary, verdictPanel } from "./words.js";

export function showArchivedFlight(element, { id, query, api }) {
  const base = `/archives/${id}/flights/${encodeURIComponent(query.get("flight"))}`;
  const monitor = query.get("monitor") ? `monitor=${encodeURIComponent(query.get("monitor"))}` : "";
  return loadingView(element, { title: "Archived flight", text: "Opening the flight", loads: [`${base}?${monitor}`], build });

  function build({ keep }, flight) {
    setZero(flight.time_zero, NO_CLOCK);
    const host = h("div.scored-chart");
    const tiles = tileSource(api, `${base}/tiles?${monitor}&`, flight);
    const { chart, list, verdicts } = createScoredChart(flight, host, tiles, () => ({ label: `${flight.flight} as ${flight.monitor} assessed it` }));
    keep({ close: chart.destroy });
    const others = flight.monitors.filter((name) => name !== flight.monitor);
    return pageOf(
      flight.flight,
      [link("Archive", `#/archives/${id}`), ...others.map((name) => link(`By ${name}`, `#/archives/${id}?${new URLSearchParams({ flight: flight.id, monitor: name })}`))],
      scoredSummary(flight, h("span", h("span.dim", "Monitor "), flight.monitor)),
      h("div.scored", h("div.stack-tight", host, chart.cross), h("div.scored-side", list)),
      verdictPanel(flight, verdicts, empty("No manoeuvre", "No manoeuvre was detected.")),
      panel("How it was scored", [recipeList(factsOf(flight)), sentences([...flight.notes, ...(flight.quality?.sentences ?? [])])]),
    );
  }
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
