/** Two scorings overlaid, each aligned at its own time, such as the start of a manoeuvre. */

import { createRecordingChart } from "../../charts/recorded/recording_chart.js";
import { select } from "../../forms/controls.js";
import { secondsText } from "../../lib/clock.js";
import { h, panel } from "../../lib/dom.js";
import { limitsOf } from "../../lib/limits.js";
import { figure, followUnits } from "../../lib/numbers.js";
import { laneOf, manoeuvresOf } from "../scoring/events.js";
import { scoringSource } from "../scoring/source.js";

const OWN = "own"; // aligned by the times of the recordings
const NAMES = ["first", "second"];

export function createOverlay({ api, compared }) {
  const host = h("div.scored-chart");
  const key = h("div.figure-key.overlay-key");
  const isOne = new Set(compared.map(({ scoring }) => scoring.recording)).size === 1;
  let chart = null;
  let isFirst = true; // the window that the address names is shown once
  const sides = compared.slice(0, 2).map((_, k) => sideOf(k));
  const element = panel(
    compared.length > 1 ? "Overlay" : "Overlay: add another scoring",
    [h("div.row.overlay-choice", sides.map((side) => side.element)), key, host],
    { "aria-label": "Overlay", "data-keeps-input": true },
  );
  followUnits(element, () => draw(chart !== null));
  return { element, close: () => chart?.destroy() };

  function sideOf(k) {
    const which = select(
      compared.map(({ letter, scoring }, n) => [n, `${letter}: ${scoring.monitor_name}, ε ${figure(scoring.epsilon)}`]),
      { "aria-label": `${NAMES[k]} scoring`, onchange: turn, value: k },
    );
    const from = select([], { "aria-label": `start of the ${NAMES[k]} scoring`, onchange: () => draw() });
    const chosen = () => compared[Number(which.value)];
    const manoeuvre = () => (from.value === OWN ? null : chosen().scoring.manoeuvres[Number(from.value)]);
    fill();
    const element = h("span.row", h("div.field", which), h("span.dim", "from"), h("div.field", from));
    return { element, chosen, manoeuvre };

    function fill() {
      const { manoeuvres } = chosen().scoring;
      from.replaceChildren(
        h("option", { value: OWN }, "the recording's own time"),
        ...manoeuvres.map(({ name, start }, n) => h("option", { value: n }, `${name}, at ${secondsText(start)}`)),
      );
      from.value = isOne || !manoeuvres.length ? OWN : "0";
    }

    function turn() {
      fill();
      draw();
    }
  }

  /** again: only the units changed; window and cursors stay. */
  function draw(again = false) {
    chart?.destroy();
    const shown = sides.map((side) => ({ ...side.chosen(), offset: side.manoeuvre()?.start ?? 0 }));
    const [{ scoring: below }] = shown;
    chart = createRecordingChart(host, {
      channels: below.channels,
      alertAbove: below.alert_above,
      sources: shown.map(({ scoring, offset }) => ({
        ...scoringSource(api, scoring, offset),
        manoeuvres: manoeuvresOf(scoring, offset),
      })),
      label: "Overlaid scorings",
      chosen: ({ start, end }) => chart.show(start - 0.1 * (end - start), end + 0.1 * (end - start)),
    });
    const itemsOf = ({ letter, scoring, offset }, row) => laneOf(scoring.manoeuvres, { row, offset, letter });
    chart.setLane(shown.flatMap(itemsOf));
    chart.setEvents(below.manoeuvres.map(({ start }) => ({ t: start - shown[0].offset })));
    const aligned = sides.map((side) => side.manoeuvre()).filter(Boolean);
    const isLinked = isFirst && Number.isFinite(chart.window.held.start);
    isFirst = false;
    if (!again && !isLinked) chart.window.forget(); // times from another zero
    if (aligned.length && !again && !isLinked) {
      const longest = Math.max(...aligned.map(({ start, end }) => end - start));
      chart.show(-0.1 * longest, 1.1 * longest);
    }
    key.replaceChildren(...shown.map(keyOf), limitsDiffer(shown.map(({ scoring }) => scoring)));
  }

  function keyOf({ letter, recordingName, scoring, offset }, k) {
    const when = offset ? `, t = 0 at ${secondsText(offset)}` : "";
    const words = `${letter} ${k ? "(dashed)" : "(full line)"}: ${recordingName}, ${scoring.monitor_name} at ε ${figure(scoring.epsilon)}${when}`;
    return h("span", h("span", { class: `key-line key-line-${k}`, "aria-hidden": true }), h("span", words));
  }
}

function limitsDiffer(scorings) {
  const shownOf = ({ channels, alert_above: above }) => JSON.stringify([channels.map((channel) => [channel.key, limitsOf(channel)]), above]);
  const words = "The strips show channels, limits, ε, alerts and manoeuvres of the first scoring.";
  return h("span", new Set(scorings.map(shownOf)).size > 1 ? words : "");
}
