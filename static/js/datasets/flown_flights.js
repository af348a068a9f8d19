/**
 * Flown flights as rollouts: recordings to choose, what is known of their outcome, and the dataset that they join.
 *
 * createFlownFlights({api, datasets, chosen, changed, use}) -> Promise of {element, count(), fields(), dataset()}
 *     chosen: recordings to begin with, by id or id/scoring.   changed(): another choice was made.   use(): read the chosen
 * flownTable(dataset, recordings)     the flown rollouts of a stored dataset; null without any
 */

import { checkbox, fold, labelled, select, textInput } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { button, h, panel, put, table } from "../lib/dom.js";
import { createLongList } from "../lib/long_list.js";
import { count, counted, durationText, figure, moment } from "../lib/numbers.js";

const LISTED = 20;

export async function createFlownFlights({ api, datasets, chosen, changed, use }) {
  const rows = new Map(); // by id, or id/scoring; kept while others are searched
  const columns = [
    ["Use", ({ tick }) => tick],
    ["Name", ({ recording, suffix }) => [h("a", { href: `#/recordings/${recording.id}` }, recording.name), suffix], "name"],
    ["Uploaded", ({ recording }) => moment(recording.created), "date"],
    ["Aircraft", ({ recording }) => recording.aircraft ?? h("span.dim", "not recorded"), "nowrap"],
    ["Length", ({ recording }) => durationText(recording.duration), "number"],
    ["Outcome", ({ outcome }) => h("div.field", outcome)],
  ];
  const beside = select([["", "none: recordings and files make a new dataset"], ...datasets.map(({ id, name, created }) => [id, `${name} (${moment(created)})`])], {
    onchange: changed,
  });
  const listed = h("div");
  const list = createLongList({ api, path: "/recordings", search: "Search recordings", step: LISTED, show });
  const read = button("Read the recordings", use, needs("POST /datasets"));
  const words = h("span.hint");
  const used = () => [...rows.values()].filter(({ tick }) => tick.checked);
  await Promise.all(chosen.map(begin));
  await list.load();
  showCount();
  const element = fold(
    "Flown flights: recordings",
    h("p.hint", "Each manoeuvre of a recording is a rollout."),
    labelled("dataset that they join", beside, { hint: "Its channels, limits and length then hold for the flown flights too." }).element,
    list.box,
    listed,
    list.more,
    h("p.hint", "Outcome: safe, or the times of failure [s], such as 12.3, 40.1; empty: by the limits."),
    h("div.row", read, words),
  );
  element.open = chosen.length > 0;
  return {
    element,
    count: () => used().length,
    dataset: () => beside.value,
    fields: () => [
      ...used().map(({ id }) => ["recording", id]),
      ...used().filter(({ outcome }) => outcome.value.trim()).map(({ id, outcome }) => ["label", `${id}=${outcome.value.trim()}`]),
      ...(beside.value ? [["dataset", beside.value]] : []),
    ],
  };

  async function begin(id) {
    const [recording] = id.split("/");
    const info = await api.get(`/recordings/${recording}`).catch(() => null); // it may have been deleted
    if (info) rows.set(id, rowOf(id, info, id.includes("/") ? " (as scored)" : ""));
  }

  /** The chosen ones stay in the list. */
  function show(recordings, text) {
    for (const recording of recordings) if (!rows.has(recording.id)) rows.set(recording.id, rowOf(recording.id, recording, ""));
    const found = recordings.map(({ id }) => rows.get(id));
    const items = [...used().filter((row) => !found.includes(row)), ...found];
    const none = text ? `No recording has “${text}” in its name.` : "There is no recording yet: upload one on the page Recordings.";
    listed.replaceChildren(items.length ? table({ columns, items, panel: false }) : h("p.dim", none));
  }

  function showCount() {
    const n = used().length;
    read.disabled = n === 0;
    put(words, n ? `${counted(n, "recording")} chosen` : "None chosen: tick the recordings to use.");
  }

  function rowOf(id, recording, suffix) {
    const { name } = recording;
    const tick = checkbox({ class: "tick", "aria-label": `use ${name}${suffix}`, checked: chosen.includes(id), onchange: change });
    const outcome = textInput({ size: 12, placeholder: "by the limits", "aria-label": `outcome of ${name}${suffix}` });
    return { id, recording, suffix, tick, outcome };
  }

  function change() {
    showCount();
    changed();
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
