/**
 * The chart of a scoring with its events and verdicts: what is chosen in one is shown by the others.
 *
 * createScoredChart(scoring, host, tiles, given) -> {chart, list, verdicts, events, visit({t, manoeuvre})}
 *     tiles: of ./source.js.   given(list): more for createRecordingChart
 */

import { createRecordingChart } from "../../charts/recorded/recording_chart.js";
import { createScoredEvents, eventsOf, exceededIn, flagsOf, laneOf, limitsInForceOf, manoeuvresOf } from "./events.js";
import { createVerdictTable } from "./verdict_table.js";

const WIDE = 4; // windows longer than this many manoeuvres are too wide to show its events

export function createScoredChart(scoring, host, tiles, given) {
  const { manoeuvres } = scoring;
  const events = eventsOf(scoring);
  const list = createScoredEvents(events, visit);
  const verdicts = createVerdictTable(scoring, { show: visitManoeuvre });
  const chart = createRecordingChart(host, {
    exceeded: exceededIn(scoring),
    channels: scoring.channels,
    sources: [{ ...tiles, manoeuvres: manoeuvresOf(scoring) }],
    alertAbove: scoring.alert_above,
    held: limitsInForceOf(scoring),
    flags: flagsOf(scoring),
    chosen: ({ t, manoeuvre }) => (manoeuvre === undefined ? visit({ t }) : visitManoeuvre(manoeuvre)),
    went: visit,
    ...given(list),
  });
  chart.setEvents(events);
  chart.setLane(laneOf(manoeuvres));
  return { chart, list, verdicts, events, visit };

  /** Show an event, in the window of its manoeuvre unless the present window shows it well. */
  function visit({ t, manoeuvre: number = null }) {
    const view = chart.window.view();
    const manoeuvre = manoeuvres[number] ?? manoeuvres.find(({ start, end }) => t >= start && t <= end);
    const isVisible = t >= view.start && t <= view.end;
    const isWide = manoeuvre && view.end - view.start > WIDE * (manoeuvre.end - manoeuvre.start);
    if (manoeuvre && (isWide || !isVisible)) visitManoeuvre(manoeuvres.indexOf(manoeuvre));
    chart.setCursor(t);
  }

  function visitManoeuvre(k) {
    const { start, end } = manoeuvres[k];
    const margin = 0.08 * (end - start);
    chart.show(start - margin, end + margin);
    verdicts.choose(k);
  }
}
