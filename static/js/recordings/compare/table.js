/**
 * Outcomes by manoeuvre, one column for each scoring.
 *
 * Exports
 *   compareTable(compared, {remove(k) | null}) -> element
 *     compared: [{letter, recordingName, planned, scoring, mapping}]   mapping: the recording's present one
 *   rowsOf(scorings) -> [[number of a manoeuvre | -1 for each scoring]]
 *       manoeuvres of one recording are matched by time, those of different recordings by order
 */

import { formatted, h } from "../../lib/dom.js";
import { recipeList } from "../../lib/lists.js";
import { warningMark } from "../../lib/monitor_warnings.js";
import { figure, riskText, secondsText } from "../../lib/numbers.js";
import { button } from "../../lib/view_states.js";
import { earlierMapping } from "../mapping/changes.js";
import {
  firstAlertText,
  isWithdrawn,
  leadText,
  outcomeChip,
  outsideText,
  validityWords,
} from "../words.js";

export function compareTable(compared, { remove }) {
  const scorings = compared.map(({ scoring }) => scoring);
  const rows = rowsOf(scorings);
  const several = new Set(scorings.map(({ recording }) => recording)).size > 1;
  const heads = compared.map(({ letter, recordingName, planned, scoring, mapping }, k) =>
    h(
      "th",
      { scope: "col" },
      h(
        "div",
        { class: "compare-head" },
        h("span", { class: "compare-letter" }, letter),
        h(
          "span",
          {},
          h(
            "a",
            { href: `#/recordings/${scoring.recording}?scoring=${scoring.id}` },
            scoring.monitor_name,
          ),
          ` at ε ${figure(scoring.epsilon)}`,
          warningMark(scoring),
          h("span", { class: "hint hint-line" }, planned),
          h(
            "span",
            { class: "hint hint-line" },
            `${several ? `${recordingName}, ` : ""}warning lead time ${figure(scoring.lead)} s`,
          ),
          earlierMapping(scoring, mapping),
          outside(scoring),
        ),
        remove
          ? button("✕", () => remove(k), {
              class: "button button-small",
              "aria-label": `Remove ${letter}`,
              title: "Remove",
            })
          : null,
      ),
    ),
  );
  return h(
    "section",
    { class: "panel stack-tight", "aria-label": "Outcomes" },
    h("h2", { class: "panel-title" }, "Side by side"),
    h(
      "div",
      { class: "table-scroll" },
      h(
        "table",
        { class: "table compare-table" },
        h("thead", {}, h("tr", {}, h("th", { scope: "col" }, "Manoeuvre"), heads)),
        h(
          "tbody",
          {},
          rows.map((row) => rowElement(row, scorings)),
        ),
      ),
    ),
  );
}

export function rowsOf(scorings) {
  const rows = [];
  scorings.forEach(({ recording, manoeuvres }, k) => {
    manoeuvres.forEach((manoeuvre, number) => {
      const fits = (row) =>
        row[k] === -1 &&
        row.some((n, other) => n >= 0 && same(scorings[other], n, recording, manoeuvre, number));
      let row = rows.find(fits);
      if (row === undefined) {
        row = new Array(scorings.length).fill(-1);
        rows.push(row);
      }
      row[k] = number;
    });
  });
  return rows;
}

function outside(scoring) {
  const words = outsideText(scoring);
  return words ? h("span", { class: "hint hint-line outside-line" }, "◆ ", formatted(words)) : null;
}

function peakText(manoeuvre, alertAbove) {
  if (isWithdrawn(manoeuvre)) return "withdrawn";
  const { peak_risk: risk } = manoeuvre;
  return risk === null ? "–" : riskText(risk, alertAbove);
}

function same(other, n, recording, manoeuvre, number) {
  if (other.recording !== recording) return n === number;
  const { start, end } = other.manoeuvres[n];
  const overlap = Math.min(end, manoeuvre.end) - Math.max(start, manoeuvre.start);
  return overlap > 0.5 * Math.min(end - start, manoeuvre.end - manoeuvre.start);
}

function rowElement(row, scorings) {
  const first = row.findIndex((n) => n >= 0);
  const { name, start, end } = scorings[first].manoeuvres[row[first]];
  const differ = new Set(scorings.map(({ recording }) => recording)).size > 1;
  return h(
    "tr",
    {},
    h(
      "th",
      { scope: "row" },
      name,
      differ
        ? null
        : h("span", { class: "hint hint-line" }, `${secondsText(start)} to ${secondsText(end)}`),
    ),
    row.map((n, k) => cell(scorings[k], n)),
  );
}

function cell(scoring, n) {
  if (n < 0) return h("td", { class: "dim" }, "not scored");
  const manoeuvre = scoring.manoeuvres[n];
  const { validity } = manoeuvre;
  const { word } = validityWords(manoeuvre);
  const p =
    validity.p_value === null || validity.p_value === undefined
      ? ""
      : `, p-value ${figure(validity.p_value, 2)}`;
  const lines = [
    ["warning lead time", leadText(manoeuvre, scoring.lead)],
    ["first alert", firstAlertText(manoeuvre)],
    ["peak risk", peakText(manoeuvre, scoring.alert_above)],
    ["applicability", `${word}${p}`],
  ];
  return h("td", {}, outcomeChip(manoeuvre), recipeList(lines, "recipe compare-lines"));
}
