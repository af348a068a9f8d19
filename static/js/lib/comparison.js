/**
 * Monitors on one flight, side by side: alerts, lead, misses, and where they differ from the first.
 *
 * comparisonTable([Compared]) -> element
 *     Compared: {name, k, assessed, alerts: [s], lead, missed, differences}
 *     k: of the line that shows its risk, 0 full, 1 dashed, null for none.   lead, missed: in words
 *     differences: {n_both, largest: {t, first, second} | null, only_first, only_second: [{start, end}]} | null
 * createComparison(api, path) -> element     a button that shows those of a flight, as they are then
 */

import { secondsText } from "./clock.js";
import { button, errorLine, h, hiddenHead, table } from "./dom.js";
import { count, figure, followUnits, leadSeconds } from "./numbers.js";

const MOST = 6; // times in a cell
const OUTCOMES = { timely_alert: "no", late_alert: "no, but warned too late", missed: "▲ missed", unseen: "not assessed in time" };
const FIRST = "–";

const ROWS = [
  ["Samples assessed", ({ assessed }) => count(assessed)],
  ["Alerts at", ({ alerts }) => listText(alerts.map((t) => secondsText(t)), "none")],
  ["Lead to the exceedance", ({ lead }) => lead],
  ["Missed", ({ missed }) => missed],
  ["Largest difference in risk from the first", ({ differences }) => (differences ? largestText(differences) : FIRST)],
  ["Alerts, the first does not", ({ differences }) => (differences ? intervalsText(differences.only_second) : FIRST)],
  ["The first alerts, it does not", ({ differences }) => (differences ? intervalsText(differences.only_first) : FIRST)],
];

export function comparisonTable(compared) {
  const place = h("div");
  return followUnits(place, () => place.replaceChildren(tableOf(compared)));
}

function tableOf(compared) {
  const columns = compared.map((monitor) => [headOf(monitor), ([, cell]) => cell(monitor)]);
  return table({ columns: [[hiddenHead("Compared"), ([name]) => name, "name"], ...columns], items: ROWS, classes: "comparison", panel: false });
}

function headOf({ name, k }) {
  return h("span", k !== null && h("span", { class: `key-line key-line-${k}`, role: "img", "aria-label": k ? "dashed line" : "full line" }), h("span", name));
}

function listText(words, none) {
  if (words.length === 0) return none;
  return words.slice(0, MOST).join(", ") + (words.length > MOST ? ` and ${words.length - MOST} more` : "");
}

function intervalsText(intervals) {
  const wordsOf = ({ start, end }) => (end > start ? `${secondsText(start)} to ${secondsText(end)}` : secondsText(start));
  return listText(intervals.map(wordsOf), "never");
}

function largestText({ largest, n_both: n }) {
  if (largest === null) return "no sample that both assessed";
  const { t, first, second } = largest;
  return `${figure(Math.abs(second - first), 2)} at ${secondsText(t)}: ${figure(second, 2)}, the first ${figure(first, 2)}; in ${count(n)} samples`;
}

export function createComparison(api, path) {
  const failure = errorLine();
  const content = h("div.stack-tight");
  const ask = button("Compare the monitors", () => failure.attempt(show), { class: "button button-small" });
  return h("div.stack-tight.compared", h("div", ask), failure.element, content);

  async function show() {
    const { start, end, exceeded_t: exceeded, monitors } = await api.get(`${path}/comparison`);
    ask.textContent = "Compare again";
    const about = start === null ? "No sample yet." : `Samples from ${secondsText(start)} to ${secondsText(end)}. ${exceeded === null ? "No exceedance." : `First exceedance at ${secondsText(exceeded)}.`}`;
    content.replaceChildren(h("p.dim", about), start === null ? "" : comparisonTable(monitors.map((monitor, k) => comparedMonitor(monitor, k, exceeded))));
  }
}

function comparedMonitor({ name, epsilon, n_assessed: assessed, alerts, outcome, reached, differences }, k, exceeded) {
  return {
    name: `${name}, ε ${figure(epsilon)}`,
    k: k < 2 ? k : null,
    assessed,
    alerts: alerts.map((each) => each.start),
    lead: reached === null ? (exceeded === null ? FIRST : "no alert before it") : `${leadSeconds(reached, 2)} s`,
    missed: outcome === null ? FIRST : OUTCOMES[outcome],
    differences,
  };
}
