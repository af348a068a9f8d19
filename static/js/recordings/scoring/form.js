/**
 * Score a recording: through which monitors, at which epsilons, from which trim, which manoeuvres.
 *
 * Exports
 *   createScoreForm({api, catalog, recording, monitors, used, scored})
 *       -> {element, show(channels), begin(), hold(), close()}
 *     used: Set of ids of monitors that scored it before.   scored([scoring], someFailed)
 *     show: of a preview, see manoeuvre_picker.js.   begin(): brings it into view
 *     hold(): the mapping is being changed, so that nothing can be scored
 */

import { decimal } from "../../forms/decimals.js";
import { reason } from "../../lib/api.js";
import { h } from "../../lib/dom.js";
import { needs } from "../../lib/me.js";
import { errorLine } from "../../lib/view_states.js";
import { createManoeuvrePicker } from "./manoeuvre_picker.js";
import { createMonitorChoice } from "./monitor_choice.js";
import { TRIM_SEGMENT } from "./source.js";

const TRIMS = [
  [TRIM_SEGMENT, "mean of each manoeuvre's own trim segment"],
  ["seconds", "mean of the seconds before its first input:"],
  ["none", "nothing: the channels are deviations from trim already"],
];

export function createScoreForm({ api, catalog, recording, monitors, used, scored }) {
  const choice = createMonitorChoice({ api, monitors, used, catalog, changed: () => picker.refresh() });
  const picker = createManoeuvrePicker({ api, catalog, recording, monitor: () => choice.first() });
  const seconds = h("input", {
    type: "text",
    inputmode: "decimal",
    value: 2,
    class: "narrow",
    "aria-label": "seconds of trim",
  });
  const trims = TRIMS.map(([value, words]) =>
    h(
      "label",
      { class: "radio" },
      h("input", { type: "radio", name: "trim", value, checked: value === TRIM_SEGMENT }),
      words,
      value === "seconds" ? h("span", { class: "field" }, seconds) : null,
    ),
  );
  const failure = errorLine();
  const progress = h("p", { role: "status", class: "dim" });
  const go = h("button", { class: "button button-primary", type: "submit", ...needs("POST /recordings/{}/scorings") }, "Score");
  const element = h(
    "form",
    { class: "panel form score-form", novalidate: true, onsubmit: send, "aria-label": "Score" },
    h("h2", { class: "panel-title" }, "Score"),
    choice.element,
    picker.element,
    h(
      "fieldset",
      {},
      h("legend", {}, "Trim subtracted"),
      h("div", { class: "row", role: "radiogroup" }, trims),
    ),
    failure.element,
    h("div", { class: "row" }, go, progress),
  );
  picker.refresh();

  async function send(event) {
    event.preventDefault();
    failure.show("");
    const requests = choice.check();
    if (requests === null || !picker.check() || !checkTrim()) return;
    const recipe = { trim: trimOf(), manoeuvres: picker.read() };
    const made = [];
    const failures = [];
    go.disabled = true;
    for (const [k, { monitor, epsilon }] of requests.entries()) {
      progress.textContent = `Scoring ${k + 1} of ${requests.length}: ${monitor.name} at ε ${epsilon}`;
      try {
        made.push(
          await api.post(`/recordings/${recording.id}/scorings`, {
            monitor: monitor.id,
            epsilon,
            ...recipe,
          }),
        );
      } catch (error) {
        failures.push(`${monitor.name} at ε ${epsilon}: ${reason(error)}`);
        if (error.status === 0) break;
      }
    }
    go.disabled = false;
    progress.textContent = made.length ? `${made.length} scored.` : "";
    failure.show(failures.join(" "));
    if (made.length) scored(made, failures.length > 0);
  }

  function checkTrim() {
    const trim = trimOf();
    const fits = typeof trim !== "number" || trim > 0;
    seconds.toggleAttribute("aria-invalid", !fits);
    if (fits) return true;
    failure.show(
      `The trim is the mean of some seconds, a number above 0; “${seconds.value}” was given.`,
    );
    seconds.focus();
    return false;
  }

  function trimOf() {
    const chosen = element.querySelector('[name="trim"]:checked').value;
    if (chosen === "none") return null;
    return chosen === "seconds" ? decimal(seconds.value) : TRIM_SEGMENT;
  }

  function begin() {
    element.scrollIntoView({ block: "start" });
    (element.querySelector("input:not(:disabled)") ?? go).focus({ preventScroll: true });
  }

  function hold() {
    go.disabled = true;
    progress.textContent = "The mapping was changed: confirm it first.";
  }

  return { element, show: picker.show, begin, hold, close: picker.close };
}
