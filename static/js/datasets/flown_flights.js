/**
 * Flown flights as rollouts: recordings to choose, what is known of their outcome, and the dataset that they join.
 *
 * createFlownFlights({recordings, datasets, chosen, changed, use}) -> {element, count(), fields(), labels(), dataset()}
 *     chosen: recordings to begin with, by id or id/scoring.   changed(): another choice was made.   use(): read the chosen
 * flownTable(dataset, recordings)     the flown rollouts of a stored dataset; null without any
 */

import { checkbox, fold, labelled, select, textInput } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { button, h, panel, table } from "../lib/dom.js";
import { count, durationText, figure, moment } from "../lib/numbers.js";

export function createFlownFlights({ recordings, datasets, chosen, changed, use }) {
  const scored = chosen.filter((id) => id.includes("/")).map((id) => rowOf(id, recordings.find((each) => each.id === id.split("/")[0]), " (as scored)"));
  const rows = [...scored, ...recordings.map((recording) => rowOf(recording.id, recording, ""))].filter(({ recording }) => recording);
  const columns = [
    ["Use", ({ tick }) => tick],
    ["Name", ({ recording, suffix }) => [h("a", { href: `#/recordings/${recording.id}` }, recording.name), suffix], "name"],
    ["Aircraft", ({ recording }) => recording.aircraft ?? h("span.dim", "not recorded"), "nowrap"],
    ["Length", ({ recording }) => durationText(recording.duration), "number"],
    ["Outcome", ({ outcome }) => h("div.field", outcome)],
  ];
  const beside = select([["", "none: recordings and files make a new dataset"], ...datasets.map(({ id, name, created }) => [id, `${name} (${moment(created)})`])], {
    onchange: changed,
  });
  const list = rows.length
    ? table({ columns, items: rows, panel: false })
    : h("p.dim", "There is no recording yet: upload one on the page Recordings.");
  const element = fold(
    "Flown flights: recordings",
    h("p.hint", "Each manoeuvre of a recording is a rollout."),
    labelled("dataset that they join", beside, { hint: "Its channels, limits and length then hold for the flown flights too." }).element,
    list,
    h("p.hint", "Outcome: safe, or the times of failure [s], such as 12.3, 40.1; empty: by the limits."),
    h("div.row", button("Read the recordings", use, { ...needs("POST /datasets"), disabled: !rows.length })),
  );
  element.open = chosen.length > 0;
  const used = () => rows.filter(({ tick }) => tick.checked);
  return {
    element,
    count: () => used().length,
    dataset: () => beside.value,
    fields: () => [...used().map(({ id }) => ["recording", id]), ...(beside.value ? [["dataset", beside.value]] : [])],
    labels: () => used().filter(({ outcome }) => outcome.value.trim()).map(({ id, outcome }) => ["label", `${id}=${outcome.value.trim()}`]),
  };

  function rowOf(id, recording, suffix) {
    const name = recording?.name ?? id;
    const tick = checkbox({ class: "tick", "aria-label": `use ${name}${suffix}`, checked: chosen.includes(id), onchange: changed });
    const outcome = textInput({ size: 12, placeholder: "by the limits", "aria-label": `outcome of ${name}${suffix}` });
    return { id, recording, suffix, tick, outcome };
  }
}

export function flownTable({ recipe, n_unsafe: unsafe }, recordings) {
  const { flown } = recipe;
  if (!flown?.length) return null;
  const stored = new Set(recordings.map(({ id }) => id));
  const nameOf = ({ flight, recording }) => (stored.has(recording) ? h("a", { href: `#/recordings/${recording}` }, flight) : flight);
  const columns = [
    ["Flight", nameOf, "name"],
    ["Manoeuvre", ({ manoeuvre }) => manoeuvre],
    ["From", ({ start }) => `${figure(start)} s`, "number"],
    ["To", ({ end }) => `${figure(end)} s`, "number"],
    ["Outcome", ({ rollout }) => (rollout < unsafe ? "unsafe" : "safe")],
    ["Rollout", ({ rollout }) => count(rollout), "number"],
    ["File, SHA-256", ({ digest }) => h("code", { title: digest }, digest.slice(0, 12))],
  ];
  return panel("Flown flights", table({ columns, items: flown, panel: false }));
}
