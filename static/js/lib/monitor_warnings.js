/**
 * Warnings about a monitor, as the server words them: the problem, a colon, the figures.
 *
 * Exports
 *   warningLines({warnings}) -> elements     each in full
 *   warningMark({warnings}) -> element | null    in short, beside the monitor's name; in full as its title
 *   warningWords({warnings}) -> string       in short: "◆ worse than its promise"; empty where there is none
 *   warningsAt(api, monitor, epsilons) -> Promise<{warnings}>     at these epsilons
 *   sentence(text) -> string                 one in full, as a sentence
 */

import { h } from "./dom.js";

const brief = (text) => text.split(":")[0].replace(/^the monitor (is|was) /, "");

export const sentence = (text) => `${text[0].toUpperCase()}${text.slice(1)}.`;

export function warningWords({ warnings }) {
  return warnings.length ? `◆ ${warnings.map(brief).join(", ")}` : "";
}

export async function warningsAt(api, monitor, epsilons) {
  const isOther = (epsilon) => epsilon !== monitor.epsilon && epsilon > 0 && epsilon < 1;
  const monitors = await Promise.all(
    epsilons.map((epsilon) => (isOther(epsilon) ? api.get(`/monitors/${monitor.id}?epsilon=${epsilon}`).catch(() => monitor) : monitor)),
  );
  return { warnings: [...new Set(monitors.flatMap(({ warnings }) => warnings))] };
}

export function warningMark({ warnings }) {
  if (!warnings.length) return null;
  return h("span", { class: "monitor-mark", title: warnings.map(sentence).join(" ") }, warningWords({ warnings }));
}

export function warningLines({ warnings }) {
  return warnings.map((text) => h("p", { class: "monitor-warning", role: "note" }, sentence(text)));
}
