/**
 * The time of each group of signals that a mapping uses: a signal, or the sampling rate.
 *
 * Exports
 *   createTimeRows({times, contents, rationales, units, changed}) -> {element, read(), show(used)}
 *     times: of the mapping.   units: of time.   used: Set of group names
 */

import { h } from "../../lib/dom.js";
import { confidence } from "./confidence.js";
import { createSignalSelect } from "./signal_select.js";
import { rateText, readRate } from "./typed_rate.js";

const BY_RATE = "derive:rate";

export function createTimeRows({ times, contents, rationales, units, changed }) {
  const now = structuredClone(times);
  const edited = new Set();
  const rows = new Map(contents.groups.map((group, number) => [group.name, rowOf(group, number)]));
  const element = h("ul", { class: "map-rows time-rows" }, [...rows.values()]);

  function rowOf({ name: group, n_rows: n, rate }, number) {
    const ofGroup = contents.signals.filter((signal) => signal.group === number);
    const words = group ? `time of ${group}` : "time";
    const rationale = rationales[`t:${group}`];
    const verdict = h("div", { class: "map-verdict" });
    const select = createSignalSelect({
      id: `map-time-${number}`,
      label: `signal of ${words}`,
      signals: ofGroup,
      groups: [],
      likely: [],
      derivable: [{ key: "rate", title: "count rows at a fixed rate" }],
      none: "choose one",
      chosen: chosenOf(now[group]),
      changed: (value) => {
        const byRate = value === BY_RATE;
        if (byRate) typed();
        else if (value) now[group] = { signal: value.slice(7), unit: now[group]?.unit ?? "s" };
        else delete now[group];
        show(byRate);
        change();
      },
    });
    const rateInput = h("input", {
      type: "text",
      "aria-label": `rate of ${words}`,
      placeholder: "50 Hz from 12:31:05",
      value: now[group]?.rate ? rateText(now[group]) : "",
      oninput: () => {
        typed();
        change();
      },
    });
    const unit = h(
      "select",
      {
        "aria-label": `unit of ${words}`,
        onchange: () => {
          if (now[group]) now[group].unit = unit.value;
          change();
        },
      },
      [...new Set([...units, now[group]?.unit].filter(Boolean))].map((name) =>
        h("option", { value: name }, name),
      ),
    );
    unit.value = now[group]?.unit ?? "s";
    const say = () => {
      if (edited.has(group)) verdict.replaceChildren(h("span", { class: "dim" }, "set by you"));
      else if (rationale) verdict.replaceChildren(confidence(rationale));
    };
    const change = () => {
      edited.add(group);
      say();
      changed();
    };
    const unitCell = h("div", { class: "map-cell map-unit" });
    const show = (byRate) =>
      unitCell.replaceChildren(
        h("span", { class: "map-label" }, byRate ? "rate" : "unit"),
        byRate ? rateInput : unit,
      );
    const typed = () => {
      const source = readRate(rateInput.value);
      if (source) now[group] = source;
      else delete now[group];
    };
    show(Boolean(now[group]?.rate));
    say();
    const rateWords = `${n.toLocaleString("en")} samples${rate ? ` at ${Number(rate.toPrecision(4))} Hz` : ""}`;
    return h(
      "li",
      { class: "map-row map-time", "data-group": group },
      h(
        "div",
        { class: "map-cell map-channel" },
        h("span", { class: "map-symbol" }, h("span", { class: "symbol" }, "t")),
        h("span", {}, words),
      ),
      h(
        "div",
        { class: "map-cell map-signal" },
        h("span", { class: "map-label" }, "signal"),
        select,
      ),
      unitCell,
      h("div", { class: "map-cell map-confidence" }, verdict),
      h("div", { class: "map-cell map-plot dim" }, rateWords),
    );
  }

  return {
    element,
    read: () => now,
    show: (used) => {
      for (const [group, row] of rows) row.hidden = rows.size > 1 && !used.has(group);
    },
  };
}

function chosenOf(source) {
  if (!source) return "";
  return source.rate ? BY_RATE : `signal:${source.signal}`;
}
