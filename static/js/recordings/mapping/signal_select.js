/**
 * Choose a signal of the file: the likely ones, derivations, and all others.
 *
 * chosen, value: "" | "signal:NAME" | "derive:KEY".   none: text for no signal
 */

import { select } from "../../forms/controls.js";
import { h } from "../../lib/dom.js";

const MANY = 60; // above this many signals the full list is filled when it is opened

export function createSignalSelect({ id, label, signals, groups, likely, derivable, none, chosen, changed }) {
  const named = new Map(signals.map((signal) => [signal.name, signal]));
  const first = likely.filter((name) => named.has(name));
  const current = chosen.startsWith("signal:") ? chosen.slice(7) : "";
  if (current && !first.includes(current)) first.unshift(current);
  const groupOf = (words, options) => (options.length ? h("optgroup", { label: words }, options) : null);
  const others = h("optgroup", { label: first.length ? "All signals" : "Signals" });
  const derivations = derivable.map(({ key, title }) => h("option", { value: `derive:${key}` }, title));
  const element = select([["", none], groupOf("Likely", first.map(optionOf)), groupOf("Derive it", derivations), others], {
    id,
    "aria-label": label,
    onchange: () => changed(element.value),
    onfocus: fill,
    onpointerdown: fill,
  });
  if (signals.length <= MANY) fill();
  element.value = chosen;
  if (chosen && element.value !== chosen) {
    element.append(h("option", { value: chosen }, `${chosen.replace(/^\w+:/, "")} (not in this file)`));
    element.value = chosen;
  }
  return element;

  function fill() {
    if (others.childElementCount) return;
    const rest = signals.filter(({ name }) => !first.includes(name));
    others.append(...rest.map(({ name }) => optionOf(name)));
  }

  function optionOf(name) {
    const { unit, group } = named.get(name) ?? { unit: "", group: 0 };
    const [words, groupName] = nameParts(name, groups.length > 1 ? groups[group].name : "");
    return h("option", { value: `signal:${name}` }, `${words}${unit && !isWithUnit(name, unit) ? ` [${unit}]` : ""}${groupName && `, ${groupName}`}`);
  }
}

export function isWithUnit(name, unit) {
  return ["[]", "()", "{}", "<>"].some(([left, right]) => name.endsWith(`${left}${unit}${right}`));
}

/** Many formats write the group in front of the name. */
export function nameParts(name, group) {
  if (!group) return [name, ""];
  const starts = ["/", ".", ":"].some((joint) => name.startsWith(`${group}${joint}`));
  return [starts ? name.slice(group.length + 1) : name, group];
}
