/** Table of manoeuvres: outcome, warning lead time against the promised one, applicability.   show(k): one was chosen */

import { secondsText } from "../../lib/clock.js";
import { chip, formatted, h, sentences, table } from "../../lib/dom.js";
import { percent, quantity } from "../../lib/numbers.js";
import { firstAlertText, leadText, measuredBy, outcomeChip, outsideLine, peakText, validityWords } from "../words.js";

const OPEN = 3; // up to this many manoeuvres, all reasons are unfolded

export function createVerdictTable(scoring, { show }) {
  const { manoeuvres, channels, alert_above: alertAbove, lead } = scoring;
  const bodies = [];
  const columns = [
    ["Manoeuvre", nameOf, "name"],
    ["Outcome", (manoeuvre) => [outcomeChip(manoeuvre)]],
    ["Peak risk", (manoeuvre) => [peakText(manoeuvre, alertAbove, true)], "number"],
    ["First alert", (manoeuvre) => [firstAlertText(manoeuvre)], "number"],
    ["First exceedance", (manoeuvre) => [exceedanceOf(manoeuvre, channels)], "number"],
    ["Warning lead time", (manoeuvre) => [leadText(manoeuvre, lead)]],
    ["Applicability", applicability],
  ];
  const shown = table({ columns, items: manoeuvres, group, classes: "verdict-table", panel: false });
  const element = h("div.stack-tight", outsideLine(scoring, "p", "outside-line"), shown);
  return { element, choose };

  function choose(chosen) {
    bodies.forEach((body, k) => body.toggleAttribute("data-chosen", k === chosen));
  }

  function nameOf({ name, start, end, begins }, k) {
    const times = h("span.hint.hint-line", `${secondsText(start)} to ${secondsText(end)}`, begins > start && `, begins ${secondsText(begins)}`);
    return [h("button", { type: "button", class: "link-button", onclick: () => show(k) }, name), times];
  }

  function group(manoeuvre, row) {
    const reasons = h("td", { colspan: columns.length }, why(manoeuvre, manoeuvres.length <= OPEN));
    const attributes = { class: "verdict", "data-outcome": manoeuvre.outcome };
    const body = h("tbody", attributes, row, h("tr.verdict-why", reasons));
    bodies.push(body);
    return body;
  }
}

function applicability(manoeuvre) {
  const { word, level, mark, words } = validityWords(manoeuvre);
  return [chip(`${mark} ${word}`, level), words && h("span.dim", ` ${words}`)];
}

function why({ validity, outcome, guarantee, remarks = [] }, isShort) {
  const isGuaranteed = validity.valid && !["unseen", "unknown"].includes(outcome);
  const checks = validity.checks.map(({ name, ok, text }) => {
    const mark = ok === true ? "✓ " : ok === false ? "✕ " : "◆ ";
    return h("li", { "data-ok": String(ok) }, h("span.check-mark", mark), h("strong", `${name}: `), formatted(text));
  });
  return h(
    "details",
    { open: isShort || validity.valid === false },
    h("summary", isGuaranteed ? h("strong", "Guarantee: ") : null, guarantee),
    validity.reasons.length > 1 ? sentences(validity.reasons) : null, // a single one is in the guarantee
    h("ul.checks", checks),
    remarks.map((words) => h("p.hint", words)),
  );
}

function exceedanceOf({ exceedance, outcome, amplitude, trim, recorded_exceedance: raw }, channels) {
  const doubt = raw?.doubt ? `, ${raw.doubt}` : "";
  if (exceedance) return [exceedanceWords(exceedance, channels), raw ? ["; as recorded ", exceedanceWords(raw, channels), doubt] : null];
  if (outcome === "unknown") return "unknown";
  if (doubt) return [exceedanceWords(raw, channels), doubt];
  if (raw) return ["none relative to trim; as recorded ", exceedanceWords(raw, channels)];
  if (channels.some(({ low, high }, k) => trim?.[k] === null && (low ?? high ?? null) !== null)) return "unknown, trim unknown";
  if (outcome === "unseen") return "unknown";
  return amplitude ? `none, at ${percent(amplitude, 0)} of the planned amplitude` : "none";
}

function exceedanceWords({ t, channel, value }, channels) {
  const measured = measuredBy(channels, channel);
  return h("span", formatted(measured.symbol), ` ${quantity(measured, value)} at ${secondsText(t)}`);
}
