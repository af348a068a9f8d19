/**
 * What came of each manoeuvre: outcome, lead against the promise, and whether the monitor had any right to speak.
 *
 * Exports
 *   createVerdictTable(scoring, {show}) -> {element, choose(k)}     show(k): a manoeuvre was pressed
 */

import { formatted, h } from "../../lib/dom.js";
import { sentences, tableHead } from "../../lib/lists.js";
import { figure, formatValue, riskText, secondsText } from "../../lib/numbers.js";
import {
  firstAlertText,
  isWithdrawn,
  leadText,
  outcomeChip,
  outcomeOf,
  outsideText,
  validityWords,
} from "../words.js";

const OPEN = 3; // manoeuvres up to which all reasons are shown at once
const MANY = 8; // from which on they are sorted out by their outcome
const HEADS = [
  ["Manoeuvre"],
  ["Outcome"],
  ["Peak risk", 1],
  ["First alert", 1],
  ["Limit reached", 1],
  ["Lead"],
  ["Right to speak"],
];

export function createVerdictTable(scoring, { show }) {
  const { stretches } = scoring;
  const bodies = stretches.map((stretch, k) => bodyOf(stretch, k));
  const element = h(
    "div",
    { class: "stack-tight" },
    outsideLine(scoring),
    stretches.length > MANY ? filter() : null,
    h(
      "div",
      { class: stretches.length > MANY ? "table-scroll verdict-many" : "table-scroll" },
      h("table", { class: "table table-cards verdict-table" }, tableHead(HEADS), bodies),
    ),
  );

  /** Which of many manoeuvres are shown, by their outcome. */
  function filter() {
    const found = [...new Set(stretches.map(({ outcome }) => outcome))];
    const count = (key) => stretches.filter(({ outcome }) => outcome === key).length;
    const select = h(
      "select",
      { id: "verdict-filter", onchange: () => keep(select.value) },
      h("option", { value: "" }, `all ${stretches.length}`),
      found.map((key) =>
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

  function keep(outcome) {
    bodies.forEach((body, k) => (body.hidden = outcome !== "" && stretches[k].outcome !== outcome));
  }

  function bodyOf(stretch, k) {
    const {
      name,
      start,
      end,
      outcome,
      peak_risk: risk,
      peak_t: peak,
      crossing,
      validity,
    } = stretch;
    const { word, level, mark } = validityWords(stretch);
    const withdrawn = isWithdrawn(stretch);
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
        cell(1, outcomeChip(outcome)),
        cell(2, riskWords(risk, peak, withdrawn, scoring.epsilon)),
        cell(3, firstAlertText(stretch)),
        cell(4, crossing ? crossingWords(crossing, scoring.channels) : neverCrossed(outcome)),
        cell(5, leadText(stretch, scoring.lead)),
        cell(
          6,
          h("span", { class: "chip", "data-level": level }, `${mark} ${word}`),
          pWords(validity),
        ),
      ),
      h("tr", { class: "verdict-why" }, h("td", { colspan: HEADS.length }, why(stretch))),
    );
  }

  function cell(k, ...content) {
    const [label, number] = HEADS[k];
    return h(
      "td",
      { class: number ? "number" : null, "data-label": label },
      h("span", {}, content),
    );
  }

  function why(stretch) {
    const { validity } = stretch;
    const promised = validity.valid && stretch.outcome !== "unseen";
    return h(
      "details",
      { open: stretches.length <= OPEN || validity.valid === false },
      h("summary", {}, promised ? h("strong", {}, "Guarantee: ") : null, stretch.guarantee),
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
      (stretch.remarks ?? []).map((words) => h("p", { class: "hint" }, words)),
    );
  }

  function choose(chosen) {
    bodies.forEach((body, k) => body.toggleAttribute("data-chosen", k === chosen));
  }

  return { element, choose };
}

function riskWords(risk, t, withdrawn, epsilon) {
  if (withdrawn) return h("span", { class: "dim" }, "withdrawn");
  if (risk === null || risk === undefined) return "–";
  return `${riskText(risk, epsilon)} at ${secondsText(t)}`;
}

function neverCrossed(outcome) {
  return outcome === "unseen" ? "unknown" : "no";
}

/** What happened where nothing was assessed must not be lost. */
function outsideLine(scoring) {
  const words = outsideText(scoring);
  return words ? h("p", { class: "outside-line", role: "note" }, "◆ ", formatted(words)) : null;
}

function crossingWords({ t, channel, value }, channels) {
  const { symbol, unit } = channels.find(({ key }) => key === channel) ?? {
    symbol: channel,
    unit: "",
  };
  return h("span", {}, formatted(symbol), ` ${formatValue(value)} ${unit} at ${secondsText(t)}`);
}

function pWords({ p_value: p }) {
  return p === null || p === undefined ? null : h("span", { class: "dim" }, ` p = ${figure(p, 2)}`);
}
