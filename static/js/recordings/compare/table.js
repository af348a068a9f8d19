/**
 * Outcomes by manoeuvre, one column for each scoring.
 *
 * compared: [{letter, recordingName, planned, scoring, mapping}]   mapping: the recording's present one
 * rowsOf(scorings) -> [[number of a manoeuvre | -1 for each scoring]]
 *     manoeuvres of one recording are matched by time, those of different recordings by order
 */

import { secondsText } from "../../lib/clock.js";
import { button, h, panel, recipeList, table } from "../../lib/dom.js";
import { warningMark } from "../../lib/monitors.js";
import { figure } from "../../lib/numbers.js";
import { earlierMapping } from "../mapping/changes.js";
import { firstAlertText, leadText, outcomeChip, outsideLine, peakText, validityWords } from "../words.js";

const hintLine = (...content) => h("span.hint.hint-line", content);

export function compareTable(compared, { remove }) {
  const scorings = compared.map(({ scoring }) => scoring);
  const isOne = new Set(scorings.map(({ recording }) => recording)).size === 1;
  const columnOf = (each, k) => [headOf(each, isOne, remove && (() => remove(k))), (row) => outcome(scorings[k], row[k])];
  const shown = table({
    columns: [["Manoeuvre", (row) => manoeuvreOf(row, scorings, isOne), "name"], ...compared.map(columnOf)],
    items: rowsOf(scorings),
    classes: "compare-table",
    panel: false,
  });
  return panel("Side by side", shown, { "aria-label": "Outcomes" });
}

function headOf({ letter, recordingName, planned, scoring, mapping }, isOne, remove) {
  const name = h("a", { href: `#/recordings/${scoring.recording}?scoring=${scoring.id}` }, scoring.monitor_name);
  const words = [
    name,
    ` at ε ${figure(scoring.epsilon)}`,
    warningMark(scoring),
    hintLine(planned),
    hintLine(`${isOne ? "" : `${recordingName}, `}warning lead time ${figure(scoring.lead)} s`),
    earlierMapping(scoring, mapping),
    outsideLine(scoring, "span", "hint hint-line outside-line"),
  ];
  const look = { class: "button button-small", "aria-label": `Remove ${letter}`, title: "Remove" };
  return h("div.compare-head", h("span.compare-letter", letter), h("span", words), remove && button("✕", remove, look));
}

function manoeuvreOf(row, scorings, isOne) {
  const first = row.findIndex((n) => n >= 0);
  const { name, start, end } = scorings[first].manoeuvres[row[first]];
  return [name, isOne && hintLine(`${secondsText(start)} to ${secondsText(end)}`)];
}

function outcome(scoring, n) {
  if (n < 0) return h("span.dim", "not scored");
  const manoeuvre = scoring.manoeuvres[n];
  const { word, words } = validityWords(manoeuvre);
  const lines = [
    ["warning lead time", leadText(manoeuvre, scoring.lead)],
    ["first alert", firstAlertText(manoeuvre)],
    ["peak risk", peakText(manoeuvre, scoring.alert_above)],
    ["applicability", [word, words].filter(Boolean).join(", ")],
  ];
  return [outcomeChip(manoeuvre), recipeList(lines, "recipe compare-lines")];
}

export function rowsOf(scorings) {
  const rows = [];
  for (const [k, { recording, manoeuvres }] of scorings.entries())
    for (const [number, manoeuvre] of manoeuvres.entries()) {
      const isSame = (n, other) => n >= 0 && same(scorings[other], n, recording, manoeuvre, number);
      let row = rows.find((made) => made[k] === -1 && made.some(isSame));
      if (!row) rows.push((row = new Array(scorings.length).fill(-1)));
      row[k] = number;
    }
  return rows;
}

function same(other, n, recording, manoeuvre, number) {
  if (other.recording !== recording) return n === number;
  const { start, end } = other.manoeuvres[n];
  const overlap = Math.min(end, manoeuvre.end) - Math.max(start, manoeuvre.start);
  return overlap > 0.5 * Math.min(end - start, manoeuvre.end - manoeuvre.start);
}
