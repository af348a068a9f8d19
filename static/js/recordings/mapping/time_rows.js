/** The time of each group of signals that a mapping uses: a signal, or the sampling rate. */

import { select as selectOf, textInput } from "../../forms/controls.js";
import { h } from "../../lib/dom.js";
import { count, figure } from "../../lib/numbers.js";
import { cell, channelCell, confidence, setByYou } from "./cells.js";
import { createSignalSelect } from "./signal_select.js";

const BY_RATE = "derive:rate";

export function createTimeRows({ times, rates, contents, rationales, units, changed }) {
  const now = structuredClone(times);
  const rows = new Map(contents.groups.map((group, number) => [group.name, rowOf(group, number)]));
  const element = h("ul.map-rows.time-rows", [...rows.values()]);
  return { element, read: () => now, show };

  function show(used) {
    for (const [group, row] of rows) row.hidden = rows.size > 1 && !used.has(group);
  }

  function rowOf({ name: group, n_rows: n, rate }, number) {
    const words = group ? `time of ${group}` : "time";
    const rationale = rationales[`t:${group}`];
    const verdict = h("div.map-verdict", rationale && confidence(rationale));
    const select = createSignalSelect({
      id: `map-time-${number}`,
      label: `signal of ${words}`,
      signals: contents.signals.filter((signal) => signal.group === number),
      groups: [],
      likely: [],
      derivable: [{ key: "rate", title: "count rows at a fixed rate" }],
      none: "choose one",
      chosen: chosenOf(now[group]),
      changed: choose,
    });
    const rateInput = textInput({
      "aria-label": `rate of ${words}`,
      placeholder: "50 Hz from 12:31:05",
      value: rates[group] ?? (now[group]?.rate ? `${now[group].rate} Hz` : ""),
      oninput: () => set(rateInput.value.trim()),
    });
    const known = [...new Set([...units, now[group]?.unit].filter(Boolean))];
    const unit = selectOf(known.map((name) => [name, name]), {
      "aria-label": `unit of ${words}`,
      value: now[group]?.unit ?? "s",
      onchange: () => set(now[group] && { ...now[group], unit: unit.value }),
    });
    const unitCell = h("div.map-cell.map-unit");
    place(Boolean(now[group]?.rate));
    return h(
      "li.map-row.map-time",
      { "data-group": group },
      channelCell(h("span.symbol", "t"), words),
      cell("signal", "signal", select),
      unitCell,
      cell("confidence", "", verdict),
      cell("plot dim", "", `${count(n)} samples${rate ? ` at ${figure(rate, 4)} Hz` : ""}`),
    );

    function choose(value) {
      const isByRate = value === BY_RATE;
      place(isByRate);
      if (isByRate) set(rateInput.value.trim());
      else set(value && { signal: value.slice(7), unit: now[group]?.unit ?? "s" });
    }

    /** source: of the times, a rate as text, or nothing where none is known. */
    function set(source) {
      if (source) now[group] = source;
      else delete now[group];
      verdict.replaceChildren(setByYou());
      changed();
    }

    function place(isByRate) {
      const label = h("span.map-label", isByRate ? "rate" : "unit");
      unitCell.replaceChildren(label, isByRate ? rateInput : unit);
    }
  }
}

function chosenOf(source) {
  if (!source) return "";
  return source.rate ? BY_RATE : `signal:${source.signal}`;
}
