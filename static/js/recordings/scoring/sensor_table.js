/** Data compatibility: scale, bias and delay of each sensor against the others, by kinematics. */

import { formatted, h } from "../../lib/dom.js";
import { chip, guideLink, table } from "../../lib/elements.js";
import { figure, followUnits, formatValue, magnitude, shownIn } from "../../lib/numbers.js";

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
        scale ? interval(scale, figure) : h("span.dim", `not checked: ${unchecked}`),
    ],
    ["Bias", (check) => check.scale && biasOf(check.bias, channelOf(check))],
    ["Delay", ({ scale, delay }) => scale && (delay ? `${interval(delay, (t) => formatValue(t))} s` : "–")],
  ];
  const shown = table({ columns, items: checks, group: withRemarks, classes: "sensor-table", panel: false });
  return h(
    "section.panel.stack-tight",
    { "aria-label": "Data compatibility" },
    h(
      "div.row",
      h(
        "h2.panel-title",
        "Data compatibility ",
        guideLink("first-recording#what-is-checked", "what is checked"),
      ),
      h("span.dim", "Sensors compared by kinematics, with 95 % intervals. Changes no verdict."),
    ),
    h("p.hint", `${quality.compatibility_tolerances}.`),
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
      "tr.verdict-why",
      h("td", { colspan: row.children.length, class: "sensor-remark" }, "◆ ", formatted(words)),
    ),
  );
  return h("tbody", { "data-remarked": String(remarks.length > 0) }, row, lines);
}

function biasOf(bias, channel) {
  if (!bias || !channel) return "–";
  const place = h("span");
  const words = () => `${interval(bias, (value) => magnitude(channel, value, 3))} ${shownIn(channel).unit}`;
  return followUnits(place, () => place.replaceChildren(words()));
}

function interval({ value, low, high }, words) {
  return `${words(value)} (${words(low)} to ${words(high)})`;
}
