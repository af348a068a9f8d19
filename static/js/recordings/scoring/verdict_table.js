/**
 * Table of manoeuvres: outcome, warning lead time against the promised one, applicability.
 *
 * Exports
 *   createVerdictTable(scoring, {show}) -> {element, choose(k)}     show(k): called when a manoeuvre is chosen
 */

import { formatted, h } from "../../lib/dom.js";
import { sentences, tableHead } from "../../lib/lists.js";
import { figure, percent, riskText, secondsText } from "../../lib/numbers.js";
import { quantity } from "../../lib/units.js";
import {
  firstAlertText,
  isWithdrawn,
  leadText,
  outcomeChip,
  outcomeOf,
  outsideText,
  validityWords,
} from "../words.js";

const OPEN = 3; // up to this many manoeuvres, all reasons are unfolded
const MANY = 8; // above this many, a filter by outcome is offered
const HEADS = [
  ["Manoeuvre"],
  ["Outcome"],
  ["Peak risk", 1],
  ["First alert", 1],
  ["First exceedance", 1],
  ["Warning lead time"],
  ["Applicability"],
];

export function createVerdictTable(scoring, { show }) {
  const { manoeuvres } = scoring;
  const bodies = manoeuvres.map(bodyOf);
  const element = h(
    "div",
    { class: "stack-tight" },
    outsideLine(scoring),
    manoeuvres.length > MANY ? filter() : null,
    h(
      "div",
      { class: manoeuvres.length > MANY ? "table-scroll verdict-many" : "table-scroll" },
      h("table", { class: "table table-cards verdict-table" }, tableHead(HEADS), bodies),
    ),
  );

  /** Filter by outcome. */
  function filter() {
    const outcomes = [...new Set(manoeuvres.map(({ outcome }) => outcome))];
    const count = (key) => manoeuvres.filter(({ outcome }) => outcome === key).length;
    const select = h(
      "select",
      { id: "verdict-filter", onchange: () => showOutcome(select.value) },
      h("option", { value: "" }, `all ${manoeuvres.length}`),
      outcomes.map((key) =>
        h("option", { value: key }, `${outcomeOf(key).word.toLowerCase()} (${count(key)})`),
      ),
    );
    return h(
      "div",
      { class: "row" },
      h("label", { for: "verdict-filter" }, "Show"),
      h("div", { class: "field" }, select),
    );
  }

  function showOutcome(outcome) {
    bodies.forEach(
      (body, k) => (body.hidden = outcome !== "" && manoeuvres[k].outcome !== outcome),
    );
  }

  function bodyOf(manoeuvre, k) {
    const {
      name,
      start,
      end,
      outcome,
      peak_risk: risk,
      peak_t: peak,
      exceedance,
      validity,
    } = manoeuvre;
    const { word, level, mark } = validityWords(manoeuvre);
    const withdrawn = isWithdrawn(manoeuvre);
    return h(
      "tbody",
      { class: "verdict", "data-outcome": outcome },
      h(
        "tr",
        {},
        h(
          "th",
          { scope: "row" },
          h("button", { type: "button", class: "link-button", onclick: () => show(k) }, name),
          h("span", { class: "hint hint-line" }, `${secondsText(start)} to ${secondsText(end)}`),
        ),
        cell(1, outcomeChip(manoeuvre)),
        cell(2, riskWords(risk, peak, withdrawn, scoring.alert_above)),
        cell(3, firstAlertText(manoeuvre)),
        cell(4, exceedance ? exceedanceWords(exceedance, scoring.channels) : noExceedance(manoeuvre, scoring.channels)),
        cell(5, leadText(manoeuvre, scoring.lead)),
        cell(
          6,
          h("span", { class: "chip", "data-level": level }, `${mark} ${word}`),
          pWords(validity),
        ),
      ),
      h(
        "tr",
        { class: "verdict-why" },
        h("td", { colspan: HEADS.length }, why(manoeuvre, manoeuvres.length <= OPEN)),
      ),
    );
  }

  function choose(chosen) {
    bodies.forEach((body, k) => body.toggleAttribute("data-chosen", k === chosen));
  }

  return { element, choose };
}

function cell(k, ...content) {
  const [label, number] = HEADS[k];
  return h("td", { class: number ? "number" : null, "data-label": label }, h("span", {}, content));
}

function why(manoeuvre, isShort) {
  const { validity } = manoeuvre;
  const isGuaranteed = validity.valid && !["unseen", "unknown"].includes(manoeuvre.outcome);
  return h(
    "details",
    { open: isShort || validity.valid === false },
    h("summary", {}, isGuaranteed ? h("strong", {}, "Guarantee: ") : null, manoeuvre.guarantee),
    validity.reasons.length > 1 ? sentences(validity.reasons) : null, // a single one is in the guarantee
    h(
      "ul",
      { class: "checks" },
      validity.checks.map(({ name, ok, text }) =>
        h(
          "li",
          { "data-ok": String(ok) },
          h("span", { class: "check-mark" }, ok === true ? "✓ " : ok === false ? "✕ " : "◆ "),
          h("strong", {}, `${name}: `),
          formatted(text),
        ),
      ),
    ),
    (manoeuvre.remarks ?? []).map((words) => h("p", { class: "hint" }, words)),
  );
}

function riskWords(risk, t, withdrawn, alertAbove) {
  if (withdrawn) return h("span", { class: "dim" }, "withdrawn");
  if (risk === null || risk === undefined) return "–";
  return `${riskText(risk, alertAbove)} at ${secondsText(t)}`;
}

function noExceedance({ outcome, amplitude, recorded_exceedance: raw }, channels) {
  if (outcome === "unknown") return "unknown";
  if (raw) return h("span", {}, "none relative to trim; as recorded ", exceedanceWords(raw, channels));
  if (outcome === "unseen") return "unknown";
  return amplitude ? `none, at ${percent(amplitude, 0)} of the planned amplitude` : "none";
}

/** Exceedances outside every manoeuvre must not be lost. */
function outsideLine(scoring) {
  const words = outsideText(scoring);
  return words ? h("p", { class: "outside-line", role: "note" }, "◆ ", formatted(words)) : null;
}

function exceedanceWords({ t, channel, value }, channels) {
  const measured = channels.find(({ key }) => key === channel) ?? { symbol: channel };
  return h("span", {}, formatted(measured.symbol), ` ${quantity(measured, value)} at ${secondsText(t)}`);
}

function pWords({ p_value: p }) {
  return p === null || p === undefined ? null : h("span", { class: "dim" }, ` p-value ${figure(p, 2)}`);
}
