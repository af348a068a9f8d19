/** One scoring: strips, events, verdicts and notes, with replay, report and export. */

import { arrangePanels, showAlone } from "../../charts/arranging/side_panels.js";
import { createSimulated } from "../../charts/simulated.js";
import { foldedPanel } from "../../forms/controls.js";
import { createAddress } from "../../lib/address.js";
import { needs } from "../../lib/api.js";
import { setZero } from "../../lib/clock.js";
import {
  button,
  chip,
  empty,
  errorLine,
  formatted,
  guideLink,
  h,
  link,
  loadingView,
  pageOf,
  panel,
  recipeList,
  sentences,
  table,
} from "../../lib/dom.js";
import { createDisplayChoice, startFlight, warningMark } from "../../lib/monitors.js";
import { count, figure, followUnits, formatValue, magnitude, magnitudeIn, moment, shownIn } from "../../lib/numbers.js";
import { scaledWords } from "../mapping/changes.js";
import { isWithUnit } from "../mapping/signal_select.js";
import { createNotesPanel, laneOfMarkers } from "../notes_panel.js";
import { createTrainingOffer } from "../training_offer.js";
import { NO_CLOCK, scoredSummary, verdictPanel } from "../words.js";
import { laneOf, scoringStarts } from "./events.js";
import { createScoredChart } from "./scored_chart.js";
import { scoringSource, TRIM_SEGMENT } from "./source.js";

const EXPORTS = { csv: "CSV", parquet: "Parquet", mat: "MAT" };
const TRIMS = { [TRIM_SEGMENT]: "mean of each manoeuvre's trim segment", null: "not subtracted" };
const WAYS = { detected: "detected from control activity", entire: "the entire recording as one" };
const OF_DATA = ["rate", "coverage", "channels", "trim"]; // checks that another monitor fails too
const LISTED = " Listed: monitors that scored this recording with the same manoeuvres and their own ε.";

export function showScoring(element, { id, query, api, navigate }) {
  const path = `/recordings/${id}`;
  const loads = [path, `${path}/scorings/${query.get("scoring")}`, "/monitors", `${path}/scorings`];
  return loadingView(element, { title: "Scored recording", text: "Opening the scoring", loads, build });

  function build({ keep }, recording, scoring, monitors, scorings) {
    setZero(scoring.time_zero, NO_CLOCK);
    const display = displayOf(scoring, monitors, scorings);
    const { manoeuvres } = scoring;
    const host = h("div.scored-chart");
    const address = createAddress();
    const noted = h("div.scored-notes");
    const side = h("div.scored-side");
    let panels = null;
    const { chart, verdicts, events, visit } = createScoredChart(scoring, host, scoringSource(api, scoring), more);
    keep({ close: chart.destroy });
    const scored = h("div.scored", h("div.stack-tight", host, chart.editor, chart.cross), side);
    showAlone(scored, address, panels);
    const notes = createNotesPanel({ api, recording: id, place, go: (t) => visit({ t }), changed: showMarkers });
    keep({ close: chart.window.subscribe(notes.moved) });
    host.addEventListener("keydown", (event) => {
      const isPlain = !event.ctrlKey && !event.metaKey && event.target === host;
      if (isPlain && event.key.toLowerCase() === "m") notes.quick();
    });
    noted.append(notes.element);
    notes.load();
    const none = empty(
      "No manoeuvre",
      "No manoeuvre was detected. Mark one by hand, or score the entire recording.",
      link("Score again", `#/recordings/${id}`, true),
    );
    const isUsed = ({ alert_above: above }) => !scoring.request.monitor_set || above !== null;
    const isOther = (each) => !each.validity.checks.some(({ name, ok }) => ok === false && OF_DATA.includes(name));
    const isInvalid = manoeuvres.some((each) => each.validity.valid === false && isUsed(each) && isOther(each));
    return pageOf(
      recording.name,
      actions({ api, navigate }, scoring, display),
      scoredSummary(scoring, monitorFact(scoring), sensorChip(scoring)),
      display.element,
      scored,
      verdictPanel(scoring, verdicts, none),
      isInvalid &&
        createTrainingOffer({
          api,
          recording: id,
          title: "INVALID: the monitor was trained for another test",
          text: "Its guarantee does not cover this manoeuvre. Train a monitor for the manoeuvre that was flown, then score the recording again.",
        }),
      createSensorTable(scoring),
      scoringFacts(scoring),
    );

    function showMarkers(markers) {
      chart.setLane([...laneOf(manoeuvres), ...laneOfMarkers(markers, 1)]);
      chart.setEvents([...events, ...markers.map(({ t }) => ({ t }))]);
    }

    /** From A to B if both cursors are set, else the pinned cursor. */
    function place() {
      const { a, b } = chart.window.marks;
      if (Number.isFinite(a) && Number.isFinite(b) && a !== b) return { t: Math.min(a, b), end: Math.max(a, b) };
      const t = chart.window.pinned;
      return Number.isFinite(t) ? { t, end: null } : null;
    }

    function more(list) {
      side.append(list, noted);
      panels = arrangePanels(address, side, { events: { label: "Events", element: list }, notes: { label: "Notes and markers", element: noted } });
      const label = `${recording.name} as ${scoring.monitor_name} assessed it`;
      return { address, panels, label, simulated: createSimulated(api, scoring.monitor), starts: () => scoringStarts(scoring) };
    }
  }
}

/** Monitors to replay beside the scoring's: those that scored the recording at their own epsilon. */
function displayOf({ monitor, epsilon }, monitors, scorings) {
  const scorer = monitors.find(({ id }) => id === monitor);
  const alone = scorings.filter(({ request }) => !request.monitor_set);
  const hasScored = ({ id, epsilon: usual }) => alone.some((other) => other.monitor === id && other.epsilon === usual);
  const known = monitors.filter((other) => other.id === monitor || hasScored(other));
  const display = createDisplayChoice(scorer === undefined ? [] : known, LISTED);
  if (scorer === undefined) display.element.hidden = true;
  else display.adapt({ ...scorer, epsilon });
  return display;
}

function actions({ api, navigate }, scoring, display) {
  const { id: number, recording: id, monitor, epsilon } = scoring;
  const base = `/api/v1/recordings/${id}/scorings/${number}`;
  const failure = errorLine();
  const replay = button("Replay", fly, { class: "button button-primary", ...needs("POST /flights") });
  replay.hidden = Boolean(scoring.request.monitor_set); // the flight itself is replayed with its monitors in turn
  const exportOf = ([format, words]) => h("a.button", { href: `${base}/export?format=${format}`, download: true }, words);
  const exports = Object.entries(EXPORTS).map(exportOf);
  return [
    replay,
    h("a.button", { href: `${base}/report`, target: "_blank" }, "Report"),
    h("span.exports", { role: "group", "aria-label": "Export" }, h("span.dim", "Export"), exports),
    link("Compare", `#/recordings/${id}?compare=${number}`),
    link("Add to a dataset", `#/datasets/rollouts?recording=${id}/${number}`),
    link("Recording", `#/recordings/${id}`),
    failure.element,
  ];

  async function fly() {
    replay.disabled = true;
    const source = { kind: "recording", recording: id, scoring: number };
    const request = { source, monitor, monitors: display.chosen(), epsilon };
    replay.disabled = await failure.attempt(() => startFlight({ api, navigate }, request));
  }
}

function monitorFact(scoring) {
  const { monitor, monitor_name: name, request: { monitor_set: set } } = scoring;
  if (set) return h("span", h("a", { href: `#/sets/${set.id}` }, name));
  return h("span", h("span.dim", "Monitor "), h("a", { href: `#/monitors/${monitor}` }, name), warningMark(scoring));
}

function scoringFacts({ request, quality, notes, mapping, channels, ...scoring }) {
  const rows = [
    ["Samples, SHA-256", scoring.digest, true],
    ["Monitor, SHA-256", scoring.monitor_digest, true],
    ["Scored", moment(scoring.created)],
    ["Samples", `${count(scoring.n_samples)}, every ${figure(scoring.dt)} s`],
    ["Trim", TRIMS[request.trim] ?? `mean of ${request.trim} s before the first input`],
    ["Manoeuvres", WAYS[request.manoeuvres] ?? `${request.manoeuvres.length} marked by hand`],
  ];
  const sourceOf = (channel) => [`${channel.label} ${channel.symbol}`, sourceText(mapping.channels[channel.key], channel)];
  const texts = [...notes, ...(quality?.sentences ?? [])];
  const part = (title, content) => [h("h3", title), content];
  const asked = [part("Request (same request, same samples)", recipeList(rows)), part("Mapping", recipeList(channels.map(sourceOf)))];
  const processed = part("Processing", sentences(texts) ?? h("p.dim", "None."));
  return foldedPanel(
    "how this scoring was made: hashes, mapping, processing",
    h("div.columns.recipe-columns", h("div.stack-tight", asked), h("div.stack-tight", processed)),
  );
}

function sourceText(source, channel) {
  if (!source) return "not recorded";
  if (source.derivation) return `derived (${source.derivation.replaceAll("_", " ")})`;
  const sign = source.sign === -1 ? "−" : "";
  const bias = source.bias ? `, bias of ${magnitudeIn(channel, source.bias)} removed` : "";
  const unit = isWithUnit(source.signal, source.unit) ? "" : ` in ${source.unit}`;
  const scaled = scaledWords(source);
  return `${sign}${source.signal}${scaled && ` = ${scaled}`}${unit}${bias}`;
}

const checksOf = (quality) => quality?.compatibility ?? [];

/** Data compatibility: scale, bias and delay of each sensor against the others, by kinematics. */
function createSensorTable({ quality, channels }) {
  const checks = checksOf(quality);
  if (!checks.length) return null;
  const channelOf = ({ channel }) => channels.find(({ key }) => key === channel);
  const scaleOf = ({ scale, unchecked }) => (scale ? interval(scale, figure) : h("span.dim", `not checked: ${unchecked}`));
  const columns = [
    ["Compared", ({ title }) => title, "name"],
    ["Scale", scaleOf],
    ["Bias", (check) => check.scale && biasOf(check.bias, channelOf(check))],
    ["Delay", ({ scale, delay }) => scale && (delay ? `${interval(delay, (t) => formatValue(t))} s` : "–")],
  ];
  const shown = table({ columns, items: checks, group: withRemarks, classes: "sensor-table", panel: false });
  const title = ["Data compatibility ", guideLink("first-recording#what-is-checked", "what is checked")];
  const beside = h("span.dim", "Sensors compared by kinematics, with 95 % intervals. Changes no verdict.");
  const content = [h("p.hint", `${quality.compatibility_tolerances}.`), shown];
  return panel(title, content, { beside, "aria-label": "Data compatibility" });
}

function sensorChip({ quality }) {
  const remarks = checksOf(quality).flatMap((check) => check.remarks);
  return remarks.length ? chip("◆ DATA COMPATIBILITY: SEE REMARKS", "caution", `${remarks.join("; ")}.`) : null;
}

function withRemarks({ remarks }, row) {
  const cell = (words) => h("td.sensor-remark", { colspan: row.children.length }, "◆ ", formatted(words));
  const lines = remarks.map((words) => h("tr.verdict-why", cell(words)));
  return h("tbody", { "data-remarked": String(remarks.length > 0) }, row, lines);
}

function biasOf(bias, channel) {
  if (!bias || !channel) return "–";
  const place = h("span");
  const words = () => `${interval(bias, (value) => magnitude(channel, value, 3))} ${shownIn(channel).unit}`;
  return followUnits(place, () => place.replaceChildren(words()));
}

function interval({ value, low, high }, words) {
  return `${words(value)} (${words(low)} to ${words(high)})`;
}
