/**
 * Choose a scoring of any recording to compare.
 *
 * Exports
 *   createScoringPicker({api, recordings, taken, add}) -> {element}
 *     taken: [{recording, scoring}] not offered.   add({recording, scoring})
 */

import { reason } from "../../lib/api.js";
import { h } from "../../lib/dom.js";
import { warningWords } from "../../lib/monitor_warnings.js";
import { figure } from "../../lib/numbers.js";
import { button, errorLine } from "../../lib/view_states.js";

export function createScoringPicker({ api, recordings, taken, add }) {
  const scored = recordings.filter(({ n_scorings: n }) => n > 0);
  const recording = h(
    "select",
    { id: "pick-recording", onchange: fill },
    scored.map(({ id, name }) => h("option", { value: id }, name)),
  );
  const scoring = h("select", { id: "pick-scoring" });
  const go = button("Add", () => add({ recording: recording.value, scoring: scoring.value }));
  const failure = errorLine();
  if (taken.length) recording.value = taken[0].recording;
  fill();
  return {
    element: h(
      "section",
      { class: "panel", "aria-label": "Add a scoring" },
      h(
        "div",
        { class: "row picker-row" },
        h("label", { for: "pick-recording" }, "Add a scoring of"),
        h("div", { class: "field" }, recording),
        h("label", { for: "pick-scoring" }, "by"),
        h("div", { class: "field" }, scoring),
        go,
      ),
      failure.element,
    ),
  };

  async function fill() {
    go.disabled = true;
    failure.show("");
    scoring.replaceChildren();
    const id = recording.value;
    if (!id) return;
    try {
      const all = await api.get(`/recordings/${id}/scorings`);
      if (recording.value !== id) return;
      const known = new Set(
        taken.filter((pair) => pair.recording === id).map((pair) => pair.scoring),
      );
      const left = all.filter((scored) => !known.has(scored.id));
      scoring.replaceChildren(
        ...(left.length
          ? left.map((scored) =>
              h(
                "option",
                { value: scored.id },
                `${scored.monitor_name} at ε ${figure(scored.epsilon)} ${warningWords(scored)}`,
              ),
            )
          : [h("option", { value: "" }, "all are shown already")]),
      );
      go.disabled = left.length === 0;
    } catch (error) {
      failure.show(reason(error));
    }
  }
}
