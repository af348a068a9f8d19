/**
 * Choose a signal of the file: the likely ones, derivations, and all others.
 *
 * Exports
 *   createSignalSelect({id, label, signals, groups, likely, derivable, none, chosen, changed}) -> select
 *     likely: [name].   derivable: [{key, title, needs}].   none: text for no signal.
 *     chosen, value: "" | "signal:NAME" | "derive:KEY"
 *   nameParts(name, group) -> [name within the group, group]
 */

import { h } from "../../lib/dom.js";

const MANY = 60; // above this many signals the full list is filled when it is opened

export function createSignalSelect({
  id,
  label,
  signals,
  groups,
  likely,
  derivable,
  none,
  chosen,
  changed,
}) {
  const named = new Map(signals.map((signal) => [signal.name, signal]));
  const first = likely.filter((name) => named.has(name));
  const current = chosen.startsWith("signal:") ? chosen.slice(7) : "";
  if (current && !first.includes(current)) first.unshift(current);
  const others = h("optgroup", { label: first.length ? "All signals" : "Signals" });
  const select = h(
    "select",
    {
      id,
      "aria-label": label,
      onchange: () => changed(select.value),
      onfocus: fill,
      onpointerdown: fill,
    },
    h("option", { value: "" }, none),
    first.length ? h("optgroup", { label: "Likely" }, first.map(optionOf)) : null,
    derivable.length
      ? h(
          "optgroup",
          { label: "Derive it" },
          derivable.map(({ key, title }) => h("option", { value: `derive:${key}` }, title)),
        )
      : null,
    others,
  );
  if (signals.length <= MANY) fill();
  select.value = chosen;
  if (chosen && select.value !== chosen) {
    select.append(
      h("option", { value: chosen }, `${chosen.replace(/^\w+:/, "")} (not in this file)`),
    );
    select.value = chosen;
  }
  return select;

  function fill() {
    if (others.childElementCount) return;
    others.append(
      ...signals.filter(({ name }) => !first.includes(name)).map(({ name }) => optionOf(name)),
    );
  }

  function optionOf(name) {
    const { unit, group } = named.get(name) ?? { unit: "", group: 0 };
    const [label, groupName] = nameParts(name, groups.length > 1 ? groups[group].name : "");
    const words = `${label}${unit ? ` [${unit}]` : ""}${groupName ? `, ${groupName}` : ""}`;
    return h("option", { value: `signal:${name}` }, words);
  }
}

/** Many formats write the group in front of the name. */
export function nameParts(name, group) {
  if (!group) return [name, ""];
  const starts = ["/", ".", ":"].some((joint) => name.startsWith(`${group}${joint}`));
  return [starts ? name.slice(group.length + 1) : name, group];
}
