/**
 * An uploaded file: its facts, what reading it left out, its signals.
 *
 * Exports
 *   recordingFacts(recording, catalog) -> element
 *   createSignalList({api, recording}) -> element     every signal, with a plot on request
 */

import { createMiniPlot } from "../charts/mini_plot.js";
import { reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { factList, sentences, tableHead } from "../lib/lists.js";
import { bytesText, durationText, figure, moment, timeZero } from "../lib/numbers.js";
import { button } from "../lib/view_states.js";
import { badRows } from "./bad_rows.js";
import { formatTitle } from "./list.js";
import { nameParts } from "./mapping/signal_select.js";

const SHOWN = 100; // signals listed without a filter

export function recordingFacts(recording, catalog) {
  const { contents } = recording;
  const rows = contents.groups.reduce((sum, group) => sum + group.n_rows, 0);
  const entries = [
    ["Aircraft", recording.aircraft ?? "not recorded"],
    ["Format", formatTitle(catalog, recording.format)],
    ["Size", bytesText(recording.size)],
    ["Length", durationText(recording.duration ?? NaN)],
    ["Samples", rows.toLocaleString("en")],
    ["Rate", ratesOf(contents.groups)],
    ["Signals", contents.signals.length.toLocaleString("en")],
    ["Begins", timeZero(contents.start)],
    ["Uploaded", moment(recording.created)],
  ];
  const twin = recording.same_as
    ? h(
        "p",
        {},
        "Same file as ",
        h("a", { href: `#/recordings/${recording.same_as}` }, "an earlier recording"),
        ".",
      )
    : null;
  const flown = recording.flight_id
    ? h("p", {}, "Recorded from a live flight: ", h("a", { href: `#/fly/${recording.flight_id}` }, "open its record"), ".")
    : null;
  const remarks = [...contents.notes, ...contents.ignored.map((words) => `Skipped: ${words}`)];
  return h(
    "section",
    { class: "panel stack-tight", "aria-label": "File" },
    factList(entries),
    h("p", { class: "dim" }, "SHA-256 ", h("span", { class: "hash" }, recording.digest)),
    flown,
    twin,
    sentences(remarks),
    badRows(recording.bad_rows),
  );
}

function ratesOf(groups) {
  const rates = groups.map(({ rate }) => rate).filter(Number.isFinite);
  if (!rates.length) return "–";
  const [least, most] = [Math.min(...rates), Math.max(...rates)].map((rate) => figure(rate));
  return least === most ? `${least} Hz` : `${least} to ${most} Hz`;
}

export function createSignalList({ api, recording }) {
  const { signals, groups } = recording.contents;
  const body = h("tbody", {});
  const filter = h("input", {
    type: "search",
    "aria-label": "find a signal",
    placeholder: "find a signal",
    oninput: list,
  });
  const more = h("p", { class: "hint" });
  list();
  const heads = ["Signal", "Unit", "Values", "Missing", "Minimum", "Maximum", "Mean", "Plot"];
  return h(
    "details",
    { class: "panel fold signal-list" },
    h("summary", {}, `all ${signals.length} signals in the file`),
    signals.length > 12 ? h("div", { class: "field" }, filter) : null,
    h(
      "div",
      { class: "table-scroll" },
      h(
        "table",
        { class: "table" },
        tableHead(heads.map((words, k) => [words, k > 1 && k < 7])),
        body,
      ),
    ),
    more,
  );

  function list() {
    const wanted = filter.value.trim().toLowerCase();
    const fits = signals
      .map((signal, number) => ({ ...signal, number }))
      .filter(({ name, description }) => `${name} ${description}`.toLowerCase().includes(wanted));
    body.replaceChildren(...fits.slice(0, SHOWN).map(row));
    more.textContent =
      fits.length > SHOWN
        ? `First ${SHOWN} of ${fits.length}. Type part of a name to find others.`
        : "";
  }

  function row({ name, unit, group, description, n, missing, min, max, mean, number }) {
    const place = h(
      "td",
      {},
      button("Show", () => draw(place, name, number), {
        class: "button button-small",
        "aria-label": `Show ${name}`,
      }),
    );
    const [label, groupName] = nameParts(name, groups.length > 1 ? groups[group].name : "");
    return h(
      "tr",
      {},
      h(
        "th",
        { scope: "row" },
        label,
        h(
          "span",
          { class: "hint" },
          [groupName, description]
            .filter(Boolean)
            .map((words) => ` ${words}`)
            .join(","),
        ),
      ),
      h("td", {}, unit),
      h("td", { class: "number" }, n.toLocaleString("en")),
      h("td", { class: "number" }, missing ? missing.toLocaleString("en") : "none"),
      [min, max, mean].map((value) => h("td", { class: "number" }, figure(value, 4))),
      place,
    );
  }

  async function draw(place, name, number) {
    const plot = createMiniPlot(name);
    try {
      const { low, high, unit, rows } = await api.get(
        `/recordings/${recording.id}/signals/${number}/preview`,
      );
      const { min, max } = signals[number];
      plot.show({ t: low.map((_, k) => k * rows), low, high, unit, min, max });
      place.replaceChildren(plot.element);
    } catch (error) {
      place.replaceChildren(h("span", { class: "error" }, reason(error)));
    }
  }
}
