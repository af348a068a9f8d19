/** The next step where no monitor fits a recording: train one for its manoeuvre. */

import { needs, reason } from "../lib/api.js";
import { formatted, guideLink, h, panel, sentences } from "../lib/dom.js";

export function proposalOf(api, recording) {
  return api.get(`/recordings/${encodeURIComponent(recording)}/training-proposal`);
}

export function createTrainingOffer({ api, recording, title, text }) {
  const detail = h("div.stack-tight", { role: "status" });
  const target = { href: `#/monitors/new?recording=${recording}`, ...needs("POST /monitors") };
  const train = h("a.button.button-primary", target, "Train a monitor for this manoeuvre");
  const row = h("div.row", train, guideLink("first-monitor", "how to train a monitor"));
  proposalOf(api, recording).then(
    ({ reasons, can_train: canTrain }) => {
      detail.replaceChildren(sentences(reasons.map(formatted)));
      if (!canTrain) train.replaceWith(h("strong", "No method can score this recording yet."));
    },
    (error) => {
      detail.replaceChildren(h("p.error", reason(error)));
      train.remove();
    },
  );
  return panel(title, [h("p", text), detail, row], { "aria-label": "Next step" });
}
