/** The scorings of a recording: open, compare, delete. */

import { checkbox } from "../../forms/controls.js";
import { button, chip, deleteButton, h, hiddenHead, panel, table } from "../../lib/dom.js";
import { warningMark } from "../../lib/monitors.js";
import { figure, moment, riskText } from "../../lib/numbers.js";
import { earlierMapping } from "../mapping/changes.js";
import { outcomeChip, outsideChip, requestWords } from "../words.js";

const MOST_CHIPS = 4;

export function createScoringList({ api, recording, scorings, changed, navigate }) {
  if (!scorings.length) return null;
  const ticked = new Set();
  const base = `/recordings/${recording.id}`;
  const compare = button("Compare", () => navigate(`#${base}?compare=${[...ticked].join(",")}`), { disabled: true });
  const wordsOf = ({ monitor_name: name, epsilon }) => `${name} at epsilon ${epsilon}`;
  const columns = [
    ["Compare", tickOf],
    ["Monitor", monitorOf, "name"],
    ["ε", ({ epsilon }) => figure(epsilon), "number"],
    ["Manoeuvres", (scoring) => [damageChip(scoring) ?? outcomes(scoring.manoeuvres), outsideChip(scoring)]],
    ["Peak risk", peakOf, "number"],
    ["Scored", ({ created }) => moment(created), "date"],
    ["Report", reportOf],
    [hiddenHead("Delete"), deleteOf],
  ];
  const hint = "Tick two or more to compare, or one to overlay another recording.";
  const shown = table({ columns, items: scorings, classes: "scoring-table", panel: false });
  return panel("Scorings", shown, { beside: h("span.spread.row", h("span.hint", hint), compare), "aria-label": "Scorings" });

  function tickOf(scoring) {
    const tick = checkbox({ class: "tick", "aria-label": `compare ${wordsOf(scoring)}`, onchange: follow });
    return tick;

    function follow() {
      if (tick.checked) ticked.add(scoring.id);
      else ticked.delete(scoring.id);
      compare.disabled = ticked.size === 0;
    }
  }

  function monitorOf(scoring) {
    return [
      h("a", { href: `#${base}?scoring=${scoring.id}` }, scoring.monitor_name),
      warningMark(scoring),
      h("span.hint.hint-line", requestWords(scoring.request)),
      earlierMapping(scoring, recording.mapping),
    ];
  }

  function reportOf(scoring) {
    const href = `/api/v1${base}/scorings/${scoring.id}/report`;
    const label = `Report of ${wordsOf(scoring)}`;
    return h("a.button.button-small", { href, target: "_blank", "aria-label": label }, "Report");
  }

  function deleteOf(scoring) {
    const words = wordsOf(scoring);
    return deleteButton({
      api,
      path: `${base}/scorings/${scoring.id}`,
      what: `scoring by ${words}`,
      consequence: "Deletes the scoring and its samples. The same request makes it again, bit for bit.",
      done: changed,
      short: words,
    });
  }
}

function peakOf({ manoeuvres, alert_above: alertAbove }) {
  const risks = manoeuvres.map(({ peak_risk: risk }) => risk).filter((risk) => risk !== null);
  if (risks.length) return riskText(Math.max(...risks), alertAbove);
  return manoeuvres.length ? h("span.dim", "INVALID") : "–";
}

/** A damaged scoring shows no verdicts. */
function damageChip({ damage }) {
  return damage ? chip("◆ DAMAGED: DELETE IT", "caution", damage) : null;
}

function outcomes(manoeuvres) {
  if (!manoeuvres.length) return h("span.dim", "none detected");
  const isFew = manoeuvres.length <= MOST_CHIPS;
  const chips = isFew ? manoeuvres.map((manoeuvre) => outcomeChip(manoeuvre)) : countChips(manoeuvres);
  return h("span.row.outcome-chips", chips);
}

function countChips(manoeuvres) {
  const hasExceeded = (manoeuvre) => Boolean(manoeuvre.exceedance ?? manoeuvre.recorded_exceedance);
  const alike = Map.groupBy(manoeuvres, (manoeuvre) => `${manoeuvre.outcome} ${hasExceeded(manoeuvre)}`);
  return [...alike.values()].map(({ length: n, 0: first }) => {
    const { word } = first.lead === null ? first.verdict : first.outcome_words; // their lead times differ
    return outcomeChip({ verdict: { ...first.verdict, word } }, n);
  });
}
