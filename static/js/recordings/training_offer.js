/**
 * The next step where no monitor fits a recording: train one for its manoeuvre.
 *
 * Exports
 *   createTrainingOffer({api, recording, title, text}) -> section     recording: its id
 *   proposalOf(api, recording) -> Promise<proposal>     what the server proposes to train:
 *     {recipe, reasons: [sentence], can_train, missing_channels: [key], aircraft: null}
 */

import { reason } from "../lib/api.js";
import { formatted, h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { sentences } from "../lib/lists.js";
import { needs } from "../lib/me.js";
import { panel } from "../lib/view_states.js";

export function proposalOf(api, recording) {
  return api.get(`/recordings/${encodeURIComponent(recording)}/training-proposal`);
}

export function createTrainingOffer({ api, recording, title, text }) {
  const detail = h("div", { class: "stack-tight", role: "status" });
  const train = h(
    "a",
    { class: "button button-primary", href: `#/monitors/new?recording=${recording}`, ...needs("POST /monitors") },
    "Train a monitor for this manoeuvre",
  );
  const row = h("div", { class: "row" }, train, guideLink("first-monitor", "how to train a monitor"));
  proposalOf(api, recording).then(
    ({ reasons, can_train: canTrain }) => {
      detail.replaceChildren(sentences(reasons.map(formatted)));
      if (!canTrain) train.replaceWith(h("strong", {}, "No method can score this recording yet."));
    },
    (error) => {
      detail.replaceChildren(h("p", { class: "error" }, reason(error)));
      train.remove();
    },
  );
  return panel(title, [h("p", {}, text), detail, row], { "aria-label": "Next step" });
}
