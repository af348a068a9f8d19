/**
 * Score a recording: choose monitors, epsilons, manoeuvres and trim.
 *
 * Exports
 *   createScoreForm({api, catalog, recording, monitors, used, scored})
 *       -> {element, show(channels), reveal(), hold(), close()}
 *     used: Set of ids of monitors that scored it before.   scored([scoring], someFailed)
 *     show: a preview, see manoeuvre_picker.js.   reveal(): scrolls the form into view
 *     hold(): disables scoring while the mapping is being changed
 */

import { decimal } from "../../forms/decimals.js";
import { reason } from "../../lib/api.js";
import { h } from "../../lib/dom.js";
import { guideLink } from "../../lib/guide_link.js";
import { needs } from "../../lib/me.js";
import { errorLine } from "../../lib/view_states.js";
import { createTrainingOffer } from "../training_offer.js";
import { createManoeuvrePicker } from "./manoeuvre_picker.js";
import { createMonitorChoice } from "./monitor_choice.js";
import { TRIM_SEGMENT } from "./source.js";

const TRIMS = [
  [TRIM_SEGMENT, "mean of each manoeuvre's trim segment"],
  ["seconds", "mean over the seconds before the first input:"],
  ["none", "none: the channels are already deviations from trim"],
];

export function createScoreForm({ api, catalog, recording, monitors, used, scored }) {
  const offer = h("div", {});
  const choice = createMonitorChoice({ api, recording, monitors, used, catalog, changed: () => picker.refresh(), none: offerTraining });
  const picker = createManoeuvrePicker({ api, catalog, recording, monitor: () => choice.first() });
  const seconds = h("input", {
    type: "text",
    inputmode: "decimal",
    value: 2,
    class: "narrow",
    "aria-label": "seconds before the first input",
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
    h("h2", { class: "panel-title" }, "Score ", guideLink("first-recording#manoeuvres-and-trim", "manoeuvres and trim")),
    choice.element,
    offer,
    picker.element,
    h(
      "fieldset",
      {},
      h("legend", {}, "Trim"),
      h("div", { class: "row", role: "radiogroup" }, trims),
    ),
    failure.element,
    h("div", { class: "row" }, go, progress),
  );
  picker.refresh();

  async function send(event) {
    event.preventDefault();
    failure.show("");
    await choice.ready;
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
    else if (failures.length) offerTraining();
  }

  function offerTraining() {
    offer.replaceChildren(
      createTrainingOffer({
        api,
        recording: recording.id,
        title: monitors.length ? "No monitor fits this recording" : "No monitor yet",
        text: "A monitor scores the manoeuvre and the aircraft that it was trained for. Train one for this recording, then score it here.",
      }),
    );
  }

  function checkTrim() {
    const trim = trimOf();
    const fits = typeof trim !== "number" || trim > 0;
    seconds.toggleAttribute("aria-invalid", !fits);
    if (fits) return true;
    failure.show(
      `“${seconds.value}” was given: enter the seconds before the first input, a number above 0.`,
    );
    seconds.focus();
    return false;
  }

  function trimOf() {
    const chosen = element.querySelector('[name="trim"]:checked').value;
    if (chosen === "none") return null;
    return chosen === "seconds" ? decimal(seconds.value) : TRIM_SEGMENT;
  }

  function reveal() {
    element.scrollIntoView({ block: "start" });
    (element.querySelector("input:not(:disabled)") ?? go).focus({ preventScroll: true });
  }

  function hold() {
    go.disabled = true;
    progress.textContent = "Confirm the changed mapping first.";
  }

  function close() {
    choice.close();
    picker.close();
  }

  return { element, show: picker.show, reveal, hold, close };
}
