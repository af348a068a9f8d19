/** The channels of own rollouts: keys, units, roles, limits, and the formulas of those that are computed. */

import { channelName } from "../lib/catalog.js";
import { formatted, h, table } from "../lib/dom.js";
import { limitsOf, limitText } from "../lib/limits.js";
import { shownIn } from "../lib/numbers.js";

export function channelTable(channels) {
  const limits = (channel) => (limitsOf(channel) === null ? h("span.dim", "none") : limitText(channel, limitsOf(channel)));
  const columns = [
    ["Channel", (channel) => [formatted(channelName(channel)), channel.formula ? h("div.dim", `= ${channel.formula}`) : null], "name"],
    ["Key", ({ key }) => h("code", key)],
    ["Unit", (channel) => shownIn(channel).unit || "none", "nowrap"],
    ["Role", ({ role }) => role, "nowrap"],
    ["Values", ({ reference }) => (reference === "trim" ? "from trim" : "absolute"), "nowrap"],
    ["Limits", limits],
  ];
  return table({ columns, items: channels, panel: false });
}
