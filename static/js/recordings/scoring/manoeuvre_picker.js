/**
 * Choose the manoeuvres to score: detected, the entire recording as one, or marked by hand.
 *
 * createManoeuvrePicker(...) -> {element, read() -> "detected" | "entire" | [{start, end, name}], check() -> bool, close(),
 *     show(channels of a preview), refresh()}     refresh: detects them again, after the monitor changed
 */

import { previewTiles } from "../../charts/recorded/tiles.js";
import { createRecordingChart } from "../../charts/recorded/recording_chart.js";
import { radioGroup } from "../../forms/controls.js";
import { reason } from "../../lib/api.js";
import { button, h } from "../../lib/dom.js";
import { followUnits } from "../../lib/numbers.js";
import { createManoeuvreTable } from "./manoeuvre_table.js";

const WAYS = [
  ["detected", "Detected from control activity"],
  ["entire", "The entire recording as one"],
  ["marked", "Marked by hand"],
];
const SURFACES = ["delta_r", "delta_a"]; // drawn first: they show where a manoeuvre begins

export function createManoeuvrePicker({ api, catalog, recording, monitor }) {
  let way = "detected";
  let detected = [];
  let turn = 0;
  let refusal = ""; // why the chosen monitor cannot look for its manoeuvre
  let chart = null;
  let tiles = null;
  const place = h("div.picker-chart");
  const hint = h("p.hint", { role: "status" });
  const marked = createManoeuvreTable({ changed: () => showManoeuvres() });
  const isMarking = () => mark.getAttribute("aria-pressed") === "true";
  const mark = button("Mark by dragging", () => press(!isMarking()), { "aria-pressed": "false" });
  const add = button("Add the manoeuvre from A to B", addMarked);
  const copy = button("Copy the detected ones", () => marked.set(detected));
  const byHand = h("div.stack-tight", { hidden: true }, h("div.row", mark, add, copy), marked.element);
  const choice = radioGroup({ name: "manoeuvres", ways: WAYS, value: way, onchange: () => turnTo(choice.value()) });
  const element = h("fieldset.stack-tight", h("legend", "Manoeuvres"), choice.element, hint, place, byHand);
  followUnits(element, draw);
  return {
    element,
    show,
    refresh,
    read: () => (way === "marked" ? marked.read() : way),
    check: () => way !== "marked" || marked.check(),
    close: () => chart?.destroy(),
  };

  /** The same signals at the same times keep window and cursors. */
  function show(channels) {
    const preview = previewTiles(channels);
    if (preview === null) return;
    const signatureOf = ({ start, end, channels: drawn }) => JSON.stringify([start, end, Object.keys(drawn)]);
    const isSame = tiles && signatureOf(tiles) === signatureOf(preview);
    tiles = preview;
    if (!chart || !isSame) return draw();
    chart.reload();
    return showManoeuvres();
  }

  function draw() {
    chart?.destroy();
    chart = null;
    place.replaceChildren();
    const known = tiles ? catalog.channels.filter(({ key }) => key in tiles.channels) : [];
    if (known.length) chart = createChart(known);
    chart?.setMarking(isMarking());
    showManoeuvres();
  }

  function createChart(known) {
    const { start, end, step: dt, channels } = tiles;
    return createRecordingChart(place, {
      channels: known.map((channel) => ({ ...channel, limit: null })),
      order: [...new Set([...SURFACES.filter((key) => key in channels), ...known.map(({ key }) => key)])],
      sources: [{ load: async () => tiles, start, end, dt, manoeuvres: null }],
      label: "Recording with its manoeuvres",
      key: `${recording.id} ${start} ${end}`,
    });
  }

  function turnTo(value) {
    way = value;
    byHand.hidden = way !== "marked";
    press(way === "marked");
    showManoeuvres();
  }

  function press(active) {
    mark.setAttribute("aria-pressed", String(active));
    mark.textContent = active ? "Dragging marks A to B" : "Mark by dragging";
    chart?.setMarking(active);
  }

  async function refresh() {
    const mine = ++turn;
    const id = monitor();
    if (id === null) return;
    const refused = (error) => [[], reason(error)];
    const found = await api.get(`/recordings/${recording.id}/manoeuvres?monitor=${id}`).then((all) => [all, ""], refused);
    if (mine !== turn) return;
    [detected, refusal] = found;
    showManoeuvres();
  }

  function addMarked() {
    const { a, b } = chart?.window.marks ?? {};
    if (!Number.isFinite(a) || !Number.isFinite(b) || a === b) {
      hint.textContent = "Set the cursors A and B first: drag over the manoeuvre in the chart, or press A and B.";
      return;
    }
    marked.add({ start: Math.min(a, b), end: Math.max(a, b), name: "" });
    chart.window.clearMarks();
  }

  function showManoeuvres() {
    const shown = way === "detected" ? detected : way === "entire" ? entire() : marked.read();
    hint.textContent = wordsOf(shown);
    chart?.setEvents(shown.map(({ start }) => ({ t: start })));
    chart?.setLane(shown.map(laneItem));
  }

  function entire() {
    return tiles ? [{ start: tiles.start, end: tiles.end, name: "the entire recording" }] : [];
  }

  function wordsOf(shown) {
    if (way === "entire") return "One manoeuvre from the first sample to the last.";
    if (way === "marked")
      return "Drag over a manoeuvre in the chart, or set A and B, then add it. Begin in trim, a little before the first input.";
    if (monitor() === null) return "Choose a monitor: its manoeuvre is detected from aileron and rudder.";
    if (refusal) return refusal;
    if (!shown.length)
      return "No manoeuvre like the monitor's was detected. Mark one by hand, or score the entire recording.";
    return `${shown.length} detected from aileron and rudder; each begins a little before its first input.`;
  }
}

function laneItem({ start, end, name }, k) {
  const text = name || `manoeuvre ${k + 1}`;
  const title = `${text}, ${start.toFixed(2)} to ${end.toFixed(2)} s`;
  return { id: `marked-${k}`, row: 0, start, end, text, level: "plain", title, quiet: true };
}
