/**
 * Score a recording: choose monitors, epsilons, manoeuvres and trim.
 *
 * used: Set of ids of monitors that scored it before.   scored([scoring], someFailed)
 * reveal(): scrolls the form into view.   hold(): disables scoring while the mapping is being changed
 */

import { createForm, radioGroup, sharedField, textInput } from "../../forms/controls.js";
import { reason } from "../../lib/api.js";
import { guideLink, h } from "../../lib/dom.js";
import { decimal } from "../../lib/numbers.js";
import { createTrainingOffer } from "../training_offer.js";
import { createManoeuvrePicker } from "./manoeuvre_picker.js";
import { createMonitorChoice } from "./monitor_choice.js";
import { TRIM_SEGMENT } from "./source.js";

export function createScoreForm({ api, catalog, recording, monitors, sets = [], used, scored }) {
  const offer = h("div");
  const refresh = () => picker.refresh();
  const choice = createMonitorChoice({ api, recording, monitors, sets, used, catalog, changed: refresh, none: offerTraining });
  const picker = createManoeuvrePicker({ api, recording, monitor: () => choice.first() });
  const trim = trimChoice();
  const progress = h("p", { role: "status", class: "dim" });
  const noEditors = (part) => ({ check: part.check, editors: new Map() });
  const { element, go, refuse } = createForm({
    title: "Score",
    word: "Score",
    route: "POST /recordings/{}/scorings",
    classes: "panel form score-form",
    fields: [choice, picker, trim].map(noEditors),
    content: [
      h("h2.panel-title", "Score ", guideLink("first-recording#manoeuvres-and-trim", "manoeuvres and trim")),
      choice.element,
      offer,
      picker.element,
      trim.element,
    ],
    beside: progress,
    send,
  });
  picker.refresh();
  return { element, show: picker.show, reveal, hold, close };

  async function send() {
    const requests = choice.requests();
    const recipe = { trim: trim.read(), manoeuvres: picker.read() };
    const made = [];
    const failures = [];
    for (const [k, { words, body }] of requests.entries()) {
      progress.textContent = `Scoring ${k + 1} of ${requests.length}: ${words}`;
      try {
        made.push(await api.post(`/recordings/${recording.id}/scorings`, { ...body, ...recipe }));
      } catch (error) {
        failures.push(`${words}: ${reason(error)}`);
        if (error.status === 0) break;
      }
    }
    progress.textContent = made.length ? `${made.length} scored.` : "";
    refuse(failures.join(" "));
    if (made.length) scored(made, failures.length > 0);
    else if (failures.length && requests.every(({ body }) => body.monitor)) offerTraining();
  }

  function offerTraining() {
    const title = monitors.length ? "No monitor fits this recording" : "No monitor yet";
    const text = "A monitor scores the manoeuvre and the aircraft that it was trained for. Train one for this recording, then score it here.";
    offer.replaceChildren(createTrainingOffer({ api, recording: recording.id, title, text }));
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
}

function trimChoice() {
  const seconds = textInput({ inputmode: "decimal", value: 2, class: "narrow", "aria-label": "seconds before the first input" });
  const ways = [
    [TRIM_SEGMENT, "mean of each manoeuvre's trim segment"],
    ["seconds", "mean over the seconds before the first input:", { beside: h("span.field", seconds) }],
    ["none", "none: the channels are already deviations from trim"],
  ];
  const choice = radioGroup({ name: "trim", ways, value: TRIM_SEGMENT });
  const { element, say, focus } = sharedField("fieldset", seconds, [h("legend", "Trim"), choice.element]);
  return { element, read, check };

  function read() {
    const value = choice.value();
    if (value === "none") return null;
    return value === "seconds" ? decimal(seconds.value) : TRIM_SEGMENT;
  }

  function check() {
    const trim = read();
    const fits = typeof trim !== "number" || trim > 0;
    seconds.toggleAttribute("aria-invalid", !fits);
    say(fits ? "" : `“${seconds.value}” was given: enter the seconds before the first input, a number above 0.`);
    if (!fits) focus();
    return fits;
  }
}
