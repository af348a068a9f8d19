/**
 * Further monitors of the same test, shown beside the one that raises the alarms.
 *
 * createDisplayChoice(monitors, more) -> {element, adapt(now), chosen() -> [id]}
 *     now: the monitor that raises the alarms.   more: further words about the choice
 */

import { h } from "../lib/dom.js";
import { warningMark } from "../lib/monitors.js";
import { leadSeconds } from "../lib/numbers.js";

export function createDisplayChoice(monitors, more = "") {
  const boxes = monitors.map((monitor) => ({ monitor, box: h("input", { type: "checkbox", value: monitor.id }) }));
  const lines = boxes.map(({ monitor, box }) => h("label", { class: "display-choice" }, box, `${leadSeconds(monitor.lead)} s ahead: ${monitor.name} `, warningMark(monitor)));
  const element = h("details", {}, h("summary", {}, "Further monitors, for display"),
    h("div", { class: "stack" }, h("p", { class: "hint" }, `For the same aircraft, manoeuvre and sample interval. They show their risk and raise no alarm.${more}`), ...lines));
  const test = ({ dt, dataset_recipe: { aircraft, maneuver } }) => JSON.stringify([dt, aircraft, maneuver]);

  function adapt(now) {
    boxes.forEach(({ monitor, box }, k) => {
      lines[k].hidden = box.disabled = monitor.id === now.id || test(monitor) !== test(now);
      if (box.disabled) box.checked = false;
    });
    element.hidden = boxes.every(({ box }) => box.disabled);
  }

  return { element, adapt, chosen: () => boxes.filter(({ box }) => box.checked).map(({ box }) => box.value) };
}
