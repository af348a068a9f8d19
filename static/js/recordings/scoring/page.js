/**
 * One scoring: strips, events, verdicts and notes, with replay, report and export.
 * Exports  showScoring(element, context).
 */

import { createRecordingChart } from "../../charts/recorded/recording_chart.js";
import { reason } from "../../lib/api.js";
import { formatted, h } from "../../lib/dom.js";
import { createEventList } from "../../lib/event_list.js";
import { guideLink } from "../../lib/guide_link.js";
import { loadingView } from "../../lib/loading_view.js";
import { needs } from "../../lib/me.js";
import { warningMark } from "../../lib/monitor_warnings.js";
import { figure } from "../../lib/numbers.js";
import { startFlight } from "../../lib/start_flight.js";
import { button, empty, errorLine, link, pageOf } from "../../lib/view_states.js";
import { createDisplayChoice } from "../../fly/display_choice.js";
import { createNotesPanel, laneOfMarkers } from "../notes_panel.js";
import { createTrainingOffer } from "../training_offer.js";
import { alertRule, outsideText, trimText, verdictOf } from "../words.js";
import { eventsOf, flagsOf, laneOf, limitsInForceOf, manoeuvresOf } from "./events.js";
import { scoringFacts } from "./facts.js";
import { createSensorTable, sensorChip } from "./sensor_table.js";
import { readScoring, scoringSource, stripOrder } from "./source.js";
import { createVerdictTable } from "./verdict_table.js";

const WIDE = 4; // windows longer than this many manoeuvres are too wide to show its events
const EXPORTS = [
  ["csv", "CSV"],
  ["parquet", "Parquet"],
  ["mat", "MAT"],
];

export function showScoring(element, { id, query, api, navigate }) {
  return loadingView(element, { title: "Scored recording", text: "Opening the scoring", build });

  async function build({ keep }) {
    const [recording, scoring, monitors, scorings] = await Promise.all([
      api.get(`/recordings/${id}`),
      readScoring(api, id, query.get("scoring")),
      api.get("/monitors"),
      api.get(`/recordings/${id}/scorings`),
    ]);
    const display = displayOf(scoring, monitors, scorings);
    const { manoeuvres } = scoring;
    const host = h("div", { class: "scored-chart" });
    const events = eventsOf(scoring);
    const list = h("section", { class: "event-panel", "aria-label": "Events" });
    const log = createEventList(list, {
      go: (t) => visit(events.find((event) => event.t === t) ?? { t }),
      label: "Events in order of time",
      most: Infinity,
    });
    for (const event of [...events].reverse()) log.add(event);
    const verdicts = createVerdictTable(scoring, { show: visitManoeuvre });
    const chart = keepChart();
    const notes = createNotesPanel({
      api,
      recording: id,
      place,
      go: (t) => visit({ t }),
      changed: showMarkers,
    });
    const stop = chart.window.subscribe(notes.moved);
    keep({ close: stop });
    host.addEventListener("keydown", (event) => {
      if (
        event.key.toLowerCase() === "m" &&
        event.target === host &&
        !event.ctrlKey &&
        !event.metaKey
      )
        notes.quick();
    });
    notes.load();
    chart.setEvents(events);
    return pageOf(
      recording.name,
      actions({ api, navigate }, scoring, display),
      summary(scoring),
      display.element,
      h("div", { class: "scored" }, host, h("div", { class: "scored-side" }, list, notes.element)),
      h(
        "section",
        { class: "panel stack-tight", "aria-label": "Verdicts" },
        h(
          "div",
          { class: "row" },
          h("h2", { class: "panel-title" }, "Outcome of each manoeuvre ", guideLink("what-the-numbers-mean#after-the-flight", "outcomes after the flight")),
          h("span", { class: "dim" }, `values are ${trimText(scoring.request)}`),
        ),
        manoeuvres.length
          ? verdicts.element
          : empty(
              "No manoeuvre",
              "No manoeuvre was detected. Mark one by hand, or score the entire recording.",
              link("Score again", `#/recordings/${id}`, true),
            ),
      ),
      manoeuvres.some(({ validity }) => validity.valid === false)
        ? createTrainingOffer({
            api,
            recording: id,
            title: "INVALID: the monitor was trained for another test",
            text: "Its guarantee does not cover this manoeuvre. Train a monitor for the manoeuvre that was flown, then score the recording again.",
          })
        : null,
      createSensorTable(scoring),
      scoringFacts(scoring),
    );

    function keepChart() {
      const made = createRecordingChart(host, {
        channels: scoring.channels,
        order: stripOrder(scoring.channels),
        sources: [{ ...scoringSource(api, scoring), manoeuvres: manoeuvresOf(scoring) }],
        alertAbove: scoring.alert_above,
        held: limitsInForceOf(scoring),
        flags: flagsOf(scoring),
        label: `${recording.name} as ${scoring.monitor_name} assessed it`,
        key: scoring.id,
        chosen: (item) =>
          item.manoeuvre === undefined ? visit({ t: item.t }) : visitManoeuvre(item.manoeuvre),
        went: visit,
      });
      keep({ close: made.destroy });
      return made;
    }

    function showMarkers(markers) {
      const more = laneOfMarkers(markers, 1);
      chart.setLane([...laneOf(manoeuvres), ...more]);
      chart.setEvents([...events, ...markers.map(({ t }) => ({ t }))]);
    }

    /** From A to B if both cursors are set, else the pinned cursor. */
    function place() {
      const { a, b } = chart.window.marks;
      if (Number.isFinite(a) && Number.isFinite(b) && a !== b)
        return { t: Math.min(a, b), end: Math.max(a, b) };
      const t = chart.window.pinned;
      return Number.isFinite(t) ? { t, end: null } : null;
    }

    /** Show an event, in the window of its manoeuvre unless the present window shows it well. */
    function visit({ t, manoeuvre: number }) {
      const view = chart.window.view();
      const manoeuvre =
        manoeuvres[number] ?? manoeuvres.find(({ start, end }) => t >= start && t <= end);
      const isVisible = t >= view.start && t <= view.end;
      const wide = manoeuvre && view.end - view.start > WIDE * (manoeuvre.end - manoeuvre.start);
      if (manoeuvre && (wide || !isVisible)) visitManoeuvre(manoeuvres.indexOf(manoeuvre));
      chart.setCursor(t);
    }

    function visitManoeuvre(k) {
      const { start, end } = manoeuvres[k];
      const margin = 0.08 * (end - start);
      chart.show(start - margin, end + margin);
      verdicts.choose(k);
    }
  }
}

/** Monitors to replay beside the scoring's: those that scored the recording at their own epsilon. */
function displayOf({ monitor, epsilon }, monitors, scorings) {
  const scorer = monitors.find(({ id }) => id === monitor);
  const known = monitors.filter(({ id, epsilon: usual }) => id === monitor || scorings.some((other) => other.monitor === id && other.epsilon === usual));
  const display = createDisplayChoice(scorer === undefined ? [] : known, " Listed: monitors that scored this recording with the same manoeuvres and their own ε.");
  if (scorer === undefined) display.element.hidden = true;
  else display.adapt({ ...scorer, epsilon });
  return display;
}

function actions({ api, navigate }, scoring, display) {
  const { id: number, recording: id } = scoring;
  const base = `/api/v1/recordings/${id}/scorings/${number}`;
  const failure = errorLine();
  const replay = button("Replay", fly, { class: "button button-primary", ...needs("POST /flights") });
  return [
    replay,
    h("a", { class: "button", href: `${base}/report`, target: "_blank" }, "Report"),
    h(
      "span",
      { class: "exports", role: "group", "aria-label": "Export" },
      h("span", { class: "dim" }, "Export"),
      EXPORTS.map(([format, words]) =>
        h("a", { class: "button", href: `${base}/export?format=${format}`, download: true }, words),
      ),
    ),
    link("Compare", `#/recordings/${id}?compare=${scoring.id}`),
    link("Recording", `#/recordings/${id}`),
    failure.element,
  ];

  async function fly() {
    replay.disabled = true;
    try {
      const source = { kind: "recording", recording: id, scoring: scoring.id };
      const { monitor, epsilon } = scoring;
      await startFlight({ api, navigate }, { source, monitor, monitors: display.chosen(), epsilon });
    } catch (error) {
      failure.show(reason(error));
      replay.disabled = false;
    }
  }
}

function summary(scoring) {
  const { monitor_name: name, monitor, lead, manoeuvres, request } = scoring;
  const counts = Map.groupBy(manoeuvres, (manoeuvre) => verdictOf(manoeuvre).word);
  const chips = [...counts.values()].map(({ length: n, 0: first }) => {
    const { word, level, mark, text } = verdictOf(first);
    return h(
      "span",
      { class: "chip", "data-level": level, title: text },
      `${mark} ${n > 1 ? `${n} × ` : ""}${word}`,
    );
  });
  const outside = outsideText(scoring);
  return h(
    "div",
    { class: "row scored-summary" },
    chips,
    outside
      ? h(
          "span",
          { class: "chip", "data-level": "caution", title: outside },
          "◆ EXCEEDANCE OUTSIDE",
        )
      : null,
    sensorChip(scoring),
    h(
      "span",
      {},
      h("span", { class: "dim" }, "Monitor "),
      h("a", { href: `#/monitors/${monitor}` }, name),
      warningMark(scoring),
    ),
    h("span", {}, formatted(alertRule(scoring))),
    h("span", {}, h("span", { class: "dim" }, "promised lead time "), `${figure(lead)} s`),
    h("span", {}, h("span", { class: "dim" }, "channels are "), trimText(request)),
  );
}
