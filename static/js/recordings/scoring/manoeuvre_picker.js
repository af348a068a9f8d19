/**
 * Choose the manoeuvres to score: detected, the entire recording as one, or marked by hand.
 *
 * createManoeuvrePicker(...) -> {element, read() -> "detected" | "entire" | [{start, end, name}], check() -> bool, close(),
 *     show(channels of a preview), refresh()}     refresh: detects them again, after the monitor changed
 */

import { previewTiles } from "../../charts/recorded/tiles.js";
import { createRecordingChart } from "../../charts/recorded/recording_chart.js";
import { radioGroup, textInput } from "../../forms/controls.js";
import { reason } from "../../lib/api.js";
import { button, errorLine, h, hiddenHead, table } from "../../lib/dom.js";
import { decimal, followUnits } from "../../lib/numbers.js";

const WAYS = [
  ["detected", "Detected from control activity"],
  ["entire", "The entire recording as one"],
  ["marked", "Marked by hand"],
];

export function createManoeuvrePicker({ api, recording, monitor }) {
  let way = "detected";
  let detected = [];
  let turn = 0;
  let refusal = ""; // why the chosen monitor cannot look for its manoeuvre
  let chart = null;
  let tiles = null;
  const place = h("div.picker-chart");
  const hint = h("p.hint", { role: "status" });
  const measured = recording.targets.filter(({ key }) => recording.channels.includes(key));
  const controls = measured.filter(isControl).map(({ label }) => label).join(" and ");
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

  function show(channels) {
    const preview = previewTiles(channels);
    if (preview === null) return;
    tiles = preview;
    draw();
  }

  function draw() {
    chart?.destroy();
    chart = null;
    place.replaceChildren();
    const known = tiles ? measured.filter(({ key }) => key in tiles.channels) : [];
    if (known.length) chart = createChart(known);
    chart?.setMarking(isMarking());
    showManoeuvres();
  }

  function createChart(known) {
    const { start, end, step: dt } = tiles;
    return createRecordingChart(place, {
      channels: known,
      // controls come first: they show where a manoeuvre begins
      order: [...known.filter(isControl).reverse(), ...known.filter((channel) => !isControl(channel))].map(({ key }) => key),
      sources: [{ load: async () => tiles, start, end, dt, manoeuvres: null }],
      label: "Recording with its manoeuvres",
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
    if (monitor() === null) return `Choose a monitor: its manoeuvre is detected from ${controls}.`;
    if (refusal) return refusal;
    if (!shown.length)
      return "No manoeuvre like the monitor's was detected. Mark one by hand, or score the entire recording.";
    return `${shown.length} detected from ${controls}; each begins a little before its first input.`;
  }
}

const isControl = ({ role }) => role === "control";

function laneItem({ start, end, name }, k) {
  const text = name || `manoeuvre ${k + 1}`;
  const title = `${text}, ${start.toFixed(2)} to ${end.toFixed(2)} s`;
  return { id: `marked-${k}`, row: 0, start, end, text, level: "plain", title, quiet: true };
}

/** Manoeuvres marked by hand, with editable times. */
function createManoeuvreTable({ changed }) {
  let manoeuvres = [];
  const failure = errorLine();
  const shown = h("div");
  const element = h("div.stack-tight", shown, failure.element);
  const none = h("p.dim", "No manoeuvre marked yet: drag over one in the chart, then add it.");
  const field = (content) => h("div.field", content);
  const columns = [
    ["Name", (manoeuvre, k) => field(nameInput(manoeuvre, k))],
    ["From [s]", (manoeuvre, k) => field(timeInput(manoeuvre, k, "start"))],
    ["To [s]", (manoeuvre, k) => field(timeInput(manoeuvre, k, "end"))],
    [hiddenHead("Remove"), removeButton],
  ];
  set([]);
  return {
    element,
    check,
    set,
    add: (manoeuvre) => set([...manoeuvres, manoeuvre]),
    read: () => manoeuvres.map(({ start, end, name }) => ({ start, end, ...(name && { name }) })),
  };

  function set(given) {
    manoeuvres = given.map((manoeuvre) => ({ ...manoeuvre })).sort((a, b) => a.start - b.start);
    const rows = table({ columns, items: manoeuvres, classes: "manoeuvre-rows", panel: false });
    shown.replaceChildren(manoeuvres.length ? rows : none);
    failure.show("");
    changed();
  }

  function nameInput(manoeuvre, k) {
    return textInput({
      value: manoeuvre.name,
      maxlength: 200,
      placeholder: `manoeuvre ${k + 1}`,
      "aria-label": `name of manoeuvre ${k + 1}`,
      onchange: (event) => {
        manoeuvre.name = event.target.value.trim();
        changed();
      },
    });
  }

  function timeInput(manoeuvre, k, key) {
    return textInput({
      inputmode: "decimal",
      value: Number(manoeuvre[key].toFixed(3)),
      "aria-label": `${key} of manoeuvre ${k + 1} in seconds`,
      onchange: ({ target: { value } }) => {
        const given = decimal(value);
        if (Number.isFinite(given)) manoeuvre[key] = given;
        set(manoeuvres);
        if (!Number.isFinite(given)) failure.show(`“${value}” was given: the ${key} is a number of seconds.`);
      },
    });
  }

  function removeButton(manoeuvre, k) {
    const remove = () => set(manoeuvres.filter((other) => other !== manoeuvre));
    return button("Remove", remove, { class: "button button-small", "aria-label": `Remove manoeuvre ${k + 1}` });
  }

  function check() {
    const wrong = wrongOf(manoeuvres);
    failure.show(wrong);
    return wrong === "";
  }
}

function wrongOf(manoeuvres) {
  const overlaps = ({ start }, k) => k > 0 && start < manoeuvres[k - 1].end;
  if (manoeuvres.length === 0) return "Mark at least one manoeuvre, or choose another option.";
  if (manoeuvres.some(({ start, end }) => end <= start)) return "A manoeuvre must end after it begins.";
  return manoeuvres.some(overlaps) ? "Two manoeuvres overlap: end the first before the second begins." : "";
}
