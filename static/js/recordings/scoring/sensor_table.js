/** Data compatibility: scale, bias and delay of each sensor against the others, by kinematics. */

import { chip, formatted, guideLink, h, panel, table } from "../../lib/dom.js";
import { figure, followUnits, formatValue, magnitude, shownIn } from "../../lib/numbers.js";

const checksOf = (quality) => quality?.compatibility ?? [];

export function createSensorTable({ quality, channels }) {
  const checks = checksOf(quality);
  if (!checks.length) return null;
  const channelOf = ({ channel }) => channels.find(({ key }) => key === channel);
  const scaleOf = ({ scale, unchecked }) => (scale ? interval(scale, figure) : h("span.dim", `not checked: ${unchecked}`));
  const columns = [
    ["Compared", ({ title }) => title, "name"],
    ["Scale", scaleOf],
    ["Bias", (check) => check.scale && biasOf(check.bias, channelOf(check))],
    ["Delay", ({ scale, delay }) => scale && (delay ? `${interval(delay, (t) => formatValue(t))} s` : "–")],
  ];
  const shown = table({ columns, items: checks, group: withRemarks, classes: "sensor-table", panel: false });
  const title = ["Data compatibility ", guideLink("first-recording#what-is-checked", "what is checked")];
  const beside = h("span.dim", "Sensors compared by kinematics, with 95 % intervals. Changes no verdict.");
  const content = [h("p.hint", `${quality.compatibility_tolerances}.`), shown];
  return panel(title, content, { beside, "aria-label": "Data compatibility" });
}

export function sensorChip({ quality }) {
  const remarks = checksOf(quality).flatMap((check) => check.remarks);
  return remarks.length ? chip("◆ DATA COMPATIBILITY: SEE REMARKS", "caution", `${remarks.join("; ")}.`) : null;
}

function withRemarks({ remarks }, row) {
  const cell = (words) => h("td.sensor-remark", { colspan: row.children.length }, "◆ ", formatted(words));
  const lines = remarks.map((words) => h("tr.verdict-why", cell(words)));
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
