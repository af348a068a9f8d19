/**
 * Data compatibility: scale, bias and delay of each sensor against the others, by kinematics.
 *
 * Exports
 *   createSensorTable(scoring) -> element | null     null if the scoring has no checks
 *   sensorChip(scoring) -> element | null            null without remarks
 */

import { formatted, h } from "../../lib/dom.js";
import { guideLink } from "../../lib/guide_link.js";
import { tableHead } from "../../lib/lists.js";
import { figure, formatValue } from "../../lib/numbers.js";
import { followUnits, magnitude, shownIn } from "../../lib/units.js";

const HEADS = [["Compared"], ["Scale"], ["Bias"], ["Delay"]];

export function createSensorTable({ quality, channels }) {
  const checks = checksOf(quality);
  if (!checks.length) return null;
  return h(
    "section",
    { class: "panel stack-tight", "aria-label": "Data compatibility" },
    h(
      "div",
      { class: "row" },
      h("h2", { class: "panel-title" }, "Data compatibility ", guideLink("first-recording#what-is-checked", "what is checked")),
      h(
        "span",
        { class: "dim" },
        "Sensors compared by kinematics, with 95 % intervals. Changes no verdict.",
      ),
    ),
    h("p", { class: "hint" }, `${quality.compatibility_tolerances}.`),
    h(
      "div",
      { class: "table-scroll" },
      h(
        "table",
        { class: "table table-cards sensor-table" },
        tableHead(HEADS),
        checks.map((check) => bodyOf(check, channels)),
      ),
    ),
  );
}

export function sensorChip({ quality }) {
  const remarks = checksOf(quality).flatMap((check) => check.remarks);
  if (!remarks.length) return null;
  const title = `${remarks.join("; ")}.`;
  return h("span", { class: "chip", "data-level": "caution", title }, "◆ DATA COMPATIBILITY: SEE REMARKS");
}

function checksOf(quality) {
  return quality?.compatibility ?? [];
}

function bodyOf({ channel, title, scale, bias, delay, unchecked, remarks }, channels) {
  const cells = scale
    ? [
        cell(1, interval(scale, figure)),
        cell(2, biasOf(bias, channels.find(({ key }) => key === channel))),
        cell(3, delay ? `${interval(delay, (t) => formatValue(t))} s` : "–"),
      ]
    : h("td", { colspan: HEADS.length - 1, class: "dim" }, `not checked: ${unchecked}`);
  return h(
    "tbody",
    { "data-remarked": String(remarks.length > 0) },
    h("tr", {}, h("th", { scope: "row" }, title), cells),
    remarks.map((words) =>
      h(
        "tr",
        { class: "verdict-why" },
        h("td", { colspan: HEADS.length, class: "sensor-remark" }, "◆ ", formatted(words)),
      ),
    ),
  );
}

function cell(k, content) {
  return h("td", { "data-label": HEADS[k][0] }, h("span", {}, content));
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
