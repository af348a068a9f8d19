/**
 * The scorings of a recording: open, compare, delete.
 *
 * Exports
 *   createScoringList({api, recording, scorings, changed}) -> element | null
 */

import { h } from "../../lib/dom.js";
import { hiddenHead, tableHead } from "../../lib/lists.js";
import { needs } from "../../lib/me.js";
import { warningMark } from "../../lib/monitor_warnings.js";
import { figure, moment, riskText } from "../../lib/numbers.js";
import { askToConfirm, button } from "../../lib/view_states.js";
import { earlierMapping } from "../mapping/changes.js";
import { outcomeChip, outcomeOf, outsideText, requestWords, verdictOf } from "../words.js";

const MOST_CHIPS = 4;

export function createScoringList({ api, recording, scorings, changed, navigate }) {
  if (!scorings.length) return null;
  const ticked = new Set();
  const compare = button(
    "Compare",
    () => navigate(`#/recordings/${recording.id}?compare=${[...ticked].join(",")}`),
    { disabled: true },
  );
  const heads = [
    ["Compare"],
    ["Monitor"],
    ["ε", 1],
    ["Manoeuvres"],
    ["Peak risk", 1],
    ["Scored"],
    ["Report"],
    hiddenHead("Delete"),
  ];
  return h(
    "section",
    { class: "panel stack-tight", "aria-label": "Scorings" },
    h(
      "div",
      { class: "row" },
      h("h2", { class: "panel-title" }, "Scorings"),
      h(
        "span",
        { class: "spread row" },
        h(
          "span",
          { class: "hint" },
          "Tick two or more to compare, or one to overlay another recording.",
        ),
        compare,
      ),
    ),
    h(
      "div",
      { class: "table-scroll" },
      h(
        "table",
        { class: "table table-cards scoring-table" },
        tableHead(heads),
        h("tbody", {}, scorings.map(row)),
      ),
    ),
  );

  function row(scoring) {
    const { id, monitor_name: name, epsilon, manoeuvres, created } = scoring;
    const words = `${name} at epsilon ${epsilon}`;
    const tick = h("input", {
      type: "checkbox",
      class: "tick",
      "aria-label": `compare ${words}`,
      onchange: () => {
        if (tick.checked) ticked.add(id);
        else ticked.delete(id);
        compare.disabled = ticked.size === 0;
      },
    });
    const path = `/api/v1/recordings/${recording.id}/scorings/${id}`;
    return h(
      "tr",
      {},
      h("td", { "data-label": "Compare" }, tick),
      h(
        "th",
        { scope: "row" },
        h("a", { href: `#/recordings/${recording.id}?scoring=${id}` }, name),
        warningMark(scoring),
        h("span", { class: "hint hint-line" }, requestWords(scoring.request)),
        earlierMapping(scoring, recording.mapping),
      ),
      h("td", { class: "number", "data-label": "ε" }, figure(epsilon)),
      h(
        "td",
        { "data-label": "Manoeuvres" },
        damageChip(scoring) ?? outcomes(manoeuvres),
        outsideChip(scoring),
      ),
      h("td", { class: "number", "data-label": "Peak risk" }, peakOf(scoring)),
      h("td", { class: "dim nowrap", "data-label": "Scored" }, moment(created)),
      h(
        "td",
        {},
        h(
          "a",
          {
            class: "button button-small",
            href: `${path}/report`,
            target: "_blank",
            "aria-label": `Report of ${words}`,
          },
          "Report",
        ),
      ),
      h(
        "td",
        {},
        button("Delete", () => remove(scoring, words), {
          class: "button button-small",
          "aria-label": `Delete ${words}`,
          ...needs("DELETE /recordings/{}/scorings/{}"),
        }),
      ),
    );
  }

  function remove({ id }, words) {
    askToConfirm(
      `Delete the scoring by ${words}?`,
      "Deletes the scoring and its samples. The same request makes it again, bit for bit.",
      "Delete permanently",
      async () => {
        await api.delete(`/recordings/${recording.id}/scorings/${id}`);
        changed();
      },
    );
  }
}

function peakOf({ manoeuvres, alert_above: alertAbove }) {
  const risks = manoeuvres.map(({ peak_risk: risk }) => risk).filter((risk) => risk !== null);
  if (risks.length) return riskText(Math.max(...risks), alertAbove);
  return manoeuvres.length ? h("span", { class: "dim" }, "withdrawn") : "–";
}

/** A damaged scoring shows no verdicts. */
function damageChip({ damage }) {
  return damage
    ? h("span", { class: "chip", "data-level": "caution", title: damage }, "◆ DAMAGED: DELETE IT")
    : null;
}

function outsideChip(scoring) {
  const title = outsideText(scoring);
  return title
    ? h("span", { class: "chip", "data-level": "caution", title }, "◆ EXCEEDANCE OUTSIDE")
    : null;
}

/** A chip for each manoeuvre; for many, the count of each outcome. */
function outcomes(manoeuvres) {
  if (!manoeuvres.length) return h("span", { class: "dim" }, "none detected");
  if (manoeuvres.length <= MOST_CHIPS) {
    return h(
      "span",
      { class: "row outcome-chips" },
      manoeuvres.map(outcomeChip),
    );
  }
  const exceeded = (manoeuvre) => manoeuvre.exceedance ?? manoeuvre.recorded_exceedance;
  const alike = Map.groupBy(manoeuvres, (manoeuvre) => `${manoeuvre.outcome} ${Boolean(exceeded(manoeuvre))}`);
  return h(
    "span",
    { class: "row outcome-chips" },
    [...alike.values()].map(({ length: n, 0: first }) => {
      const { level, mark, word: verdict } = verdictOf(first);
      const word = first.lead === null ? verdict : outcomeOf(first.outcome).word; // their lead times differ
      return h("span", { class: "chip", "data-level": level }, `${mark} ${n} × ${word}`);
    }),
  );
}
