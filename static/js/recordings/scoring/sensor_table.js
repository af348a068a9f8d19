/**
 * Data compatibility: scale, bias and delay of each sensor against the others, by kinematics.
 *
 * Exports
 *   createSensorTable(scoring) -> element | null     null if the scoring has no checks
 *   sensorChip(scoring) -> element | null            null without remarks
 */

import { formatted, h } from "../../lib/dom.js";
import { guideLink } from "../../lib/guide_link.js";
import { table } from "../../lib/lists.js";
import { figure, formatValue } from "../../lib/numbers.js";
import { followUnits, magnitude, shownIn } from "../../lib/units.js";
import { chip } from "../../lib/view_states.js";

const checksOf = (quality) => quality?.compatibility ?? [];

export function createSensorTable({ quality, channels }) {
  const checks = checksOf(quality);
  if (!checks.length) return null;
  const channelOf = ({ channel }) => channels.find(({ key }) => key === channel);
  const columns = [
    ["Compared", ({ title }) => title, "name"],
    [
      "Scale",
      ({ scale, unchecked }) =>
        scale ? interval(scale, figure) : h("span", { class: "dim" }, `not checked: ${unchecked}`),
    ],
    ["Bias", (check) => check.scale && biasOf(check.bias, channelOf(check))],
    ["Delay", ({ scale, delay }) => scale && (delay ? `${interval(delay, (t) => formatValue(t))} s` : "–")],
  ];
  const shown = table({ columns, items: checks, group: withRemarks, classes: "sensor-table", panel: false });
  return h(
    "section",
    { class: "panel stack-tight", "aria-label": "Data compatibility" },
    h(
      "div",
      { class: "row" },
      h(
        "h2",
        { class: "panel-title" },
        "Data compatibility ",
        guideLink("first-recording#what-is-checked", "what is checked"),
      ),
      h("span", { class: "dim" }, "Sensors compared by kinematics, with 95 % intervals. Changes no verdict."),
    ),
    h("p", { class: "hint" }, `${quality.compatibility_tolerances}.`),
    shown,
  );
}

export function sensorChip({ quality }) {
  const remarks = checksOf(quality).flatMap((check) => check.remarks);
  return remarks.length ? chip("◆ DATA COMPATIBILITY: SEE REMARKS", "caution", `${remarks.join("; ")}.`) : null;
}

function withRemarks({ remarks }, row) {
  const lines = remarks.map((words) =>
    h(
      "tr",
      { class: "verdict-why" },
      h("td", { colspan: row.children.length, class: "sensor-remark" }, "◆ ", formatted(words)),
    ),
  );
  return h("tbody", { "data-remarked": String(remarks.length > 0) }, row, lines);
}

function biasOf(bias, channel) {
  if (!bias || !channel) return "–";
  const place = h("span", {});
  const words = () => `${interval(bias, (value) => magnitude(channel, value, 3))} ${shownIn(channel).unit}`;
  return followUnits(place, () => place.replaceChildren(words()));
}

function interval({ value, low, high }, words) {
  return `${words(value)} (${words(low)} to ${words(high)})`;
}
