/** Choose an epsilon from fresh flights: to keep two targets, or by the cost of a miss. */

import { createForm, foldedPanel, labelled, select } from "../forms/controls.js";
import { createFields } from "../forms/form.js";
import { button, guideLink, h } from "../lib/dom.js";
import { count, figure, percent } from "../lib/numbers.js";

const KEYS = { targets: ["most_missed", "most_false_alarms"], cost: ["cost_of_miss"] };

export function createEpsilonChoice({ api, id, catalog, navigate, keep }) {
  const { schema, default: usual } = catalog.recipes.epsilon;
  const fields = createFields(schema, { ...usual, cost_of_miss: 10 }, { catalog, path: "epsilon" });
  const ways = [["targets", "to keep two targets"], ["cost", "by the cost of a miss"]];
  const way = select(ways, { id: "epsilon-way", onchange: show });
  const unasked = () => KEYS[way.value === "cost" ? "targets" : "cost"];
  const outcome = h("div.stack", { role: "status" });
  const { element } = createForm({
    title: "Choose an epsilon",
    word: "Fly and choose",
    route: "POST /monitors/{}/epsilon",
    classes: "stack",
    fields: [fields],
    content: h("div.field-grid", labelled("Choose", way).element, fields.keys.map(fields.element)),
    beside: [
      guideLink("first-monitor#choose-an-epsilon", "how to choose an epsilon"),
      h("span.hint", "Half of the fresh flights choose epsilon, the other half certify it."),
    ],
    send: () => {
      outcome.replaceChildren();
      const asked = Object.entries(fields.read()).filter(([key]) => !unasked().includes(key));
      return api.post(`/monitors/${id}/epsilon`, Object.fromEntries(asked));
    },
    follow: {
      api,
      keep,
      title: () => "Choosing an epsilon",
      done: (choice, back) => {
        back();
        const fly = () => navigate(`#/fly?monitor=${id}&epsilon=${choice.epsilon}`);
        outcome.replaceChildren(...choiceWords(choice), h("div.row", button("Fly it with this epsilon", fly)));
      },
    },
  });
  element.append(outcome);
  show();
  return foldedPanel("Choose an epsilon from fresh flights", element);

  function show() {
    for (const keys of Object.values(KEYS)) for (const key of keys) fields.element(key).hidden = unasked().includes(key);
  }
}

function choiceWords(choice) {
  const { epsilon, misses, n_unsafe: unsafe, false_alerts: alerts, n_safe: safe, most_missed, most_false, cost } = choice;
  return [
    h("p", h("strong", `ε = ${figure(epsilon)}`), `: the monitor alerts at risk above ${figure(choice.alert_above)}.`),
    h(
      "p",
      `Missed: ${percent(misses / unsafe)} of ${count(unsafe)} failing fresh flights. False alarms: ${percent(alerts / safe)} of ${count(safe)} safe ones. With 95 % confidence, at most ${percent(most_missed)} and ${percent(most_false)}. ${calledInvalid(choice)}`,
      cost === null ? "" : ` Mean cost of a flight: ${figure(cost)} false alarms.`,
    ),
  ];
}

/** withdrawn: undefined if an older version stored the result. */
function calledInvalid({ withdrawn, safe_withdrawn: safe }) {
  if (withdrawn === undefined) return "Flights called INVALID were not counted.";
  return `Called INVALID, in neither share: ${count(withdrawn)} failing flights before an alert and ${count(safe)} safe flights without one.`;
}
