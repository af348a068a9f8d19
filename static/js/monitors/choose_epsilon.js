/**
 * Choose an epsilon from fresh flights: to keep two targets, or by the cost of a miss.
 *
 * Exports
 *   createEpsilonChoice({api, id, catalog, navigate, keep}) -> element      id: of the monitor
 */

import { createFields } from "../forms/form.js";
import { reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { followInPlace } from "../lib/job_progress.js";
import { needs } from "../lib/me.js";
import { figure, percent } from "../lib/numbers.js";
import { button, errorLine } from "../lib/view_states.js";

const WAYS = [
  ["targets", "to keep two targets", ["most_missed", "most_false_alarms"]],
  ["cost", "by the cost of a miss", ["cost_of_miss"]],
];

export function createEpsilonChoice({ api, id, catalog, navigate, keep }) {
  const { schema, default: usual } = catalog.recipes.epsilon;
  const fields = createFields(schema, { ...usual, cost_of_miss: 10 }, { catalog, path: "epsilon" });
  const way = h(
    "select",
    { id: "epsilon-way", onchange: show },
    WAYS.map(([value, words]) => h("option", { value }, words)),
  );
  const failure = errorLine();
  const go = h("button", { class: "button", type: "submit", ...needs("POST /monitors/{}/epsilon") }, "Fly and choose");
  const form = h(
    "form",
    { class: "stack", novalidate: true, onsubmit: send, "aria-label": "Choose an epsilon", "data-keeps-input": true },
    h(
      "div",
      { class: "field-grid" },
      h("div", { class: "field" }, h("label", { for: "epsilon-way" }, "Choose"), way),
      fields.keys.map(fields.element),
    ),
    failure.element,
    h(
      "div",
      { class: "row" },
      go,
      guideLink("first-monitor#choose-an-epsilon", "how to choose an epsilon"),
      h("span", { class: "hint" }, "Half of the fresh flights choose epsilon, the other half certify it."),
    ),
  );
  const outcome = h("div", { class: "stack", role: "status" });
  const stage = h("div", { class: "stack" }, form, outcome);
  show();
  return h("details", { class: "panel fold" }, h("summary", {}, "Choose an epsilon from fresh flights"), stage);

  function show() {
    for (const [value, , keys] of WAYS)
      for (const key of keys) fields.element(key).hidden = value !== way.value;
  }

  async function send(event) {
    event.preventDefault();
    const asked = fields.read();
    const unasked = WAYS.filter(([value]) => value !== way.value).flatMap(([, , keys]) => keys);
    for (const key of unasked) delete asked[key];
    failure.show("");
    outcome.replaceChildren();
    go.disabled = true;
    try {
      const job = await api.post(`/monitors/${id}/epsilon`, asked);
      const progress = followInPlace({ form, stage, keep, focus: go, api, job, title: "Choosing an epsilon", done });

      function done(choice) {
        progress.back();
        showChoice(choice);
      }
    } catch (error) {
      if (!fields.point(`epsilon.${error.message}`)) failure.show(reason(error));
    } finally {
      go.disabled = false;
    }
  }

  function showChoice({ epsilon, alert_above: above, misses, n_unsafe, false_alerts, n_safe, withdrawn, safe_withdrawn, most_missed, most_false, cost }) {
    outcome.replaceChildren(
      h("p", {}, h("strong", {}, `ε = ${figure(epsilon)}`), `: the monitor alerts at risk above ${figure(above)}.`),
      h(
        "p",
        {},
        `Missed: ${percent(misses / n_unsafe)} of ${n_unsafe.toLocaleString("en")} failing fresh flights. False alarms: ${percent(false_alerts / n_safe)} of ${n_safe.toLocaleString("en")} safe ones. With 95 % confidence, at most ${percent(most_missed)} and ${percent(most_false)}. ${calledInvalid(withdrawn, safe_withdrawn)}`,
        cost === null ? "" : ` Mean cost of a flight: ${figure(cost)} false alarms.`,
      ),
      h(
        "div",
        { class: "row" },
        button("Fly it with this epsilon", () => navigate(`#/fly?monitor=${id}&epsilon=${epsilon}`)),
      ),
    );
  }
}

/** withdrawn: undefined if an older version stored the result. */
function calledInvalid(withdrawn, safe) {
  if (withdrawn === undefined) return "Flights called INVALID were not counted.";
  return `Called INVALID, in neither share: ${withdrawn.toLocaleString("en")} failing flights before an alert and ${safe.toLocaleString("en")} safe flights without one.`;
}
