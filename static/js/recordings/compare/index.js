/** Several scorings side by side, and two of them overlaid.   query: compare=sid,rid:sid,...   of recording `id`, or of others */

import { select } from "../../forms/controls.js";
import { loadCatalog, testWords } from "../../lib/catalog.js";
import { setZero } from "../../lib/clock.js";
import { comparisonTable } from "../../lib/comparison.js";
import { button, errorLine, h, link, loadingView, pageOf, panel } from "../../lib/dom.js";
import { warningWords } from "../../lib/monitors.js";
import { counted, figure, followUnits, leadSeconds } from "../../lib/numbers.js";
import { readScoring } from "../scoring/source.js";
import { createOverlay } from "./overlay.js";
import { compareTable } from "./table.js";

const OFFERED = 200; // newest recordings

export function showComparedScorings(element, { id, query, api, navigate }) {
  const given = query.get("compare").split(",").filter(Boolean);
  const references = given.map((text) => referenceOf(text, id));
  return loadingView(element, { title: "Compare", text: "Loading scorings", loads: [loadCatalog, `/recordings?limit=${OFFERED}`, "/monitors"], build });

  async function build({ keep }, catalog, recordings, monitors) {
    const planned = new Map(monitors.map((monitor) => [monitor.id, testWords(catalog, monitor)]));
    const compared = await Promise.all(references.map(read));
    setZero("", "several recordings have several times of day");
    const overlay = keep(createOverlay({ api, compared }));
    const table = h("div");
    const tabulate = () => table.replaceChildren(compareTable(compared, { remove: compared.length > 1 ? remove : null }));
    const bySample = await comparedScorings(api, compared);
    return pageOf(
      "Compare",
      [link("Recording", `#/recordings/${id}`)],
      followUnits(table, tabulate),
      scoringPicker({ api, recordings, taken: references, add: (reference) => go([...references, reference]) }),
      bySample,
      overlay.element,
    );

    async function read({ recording, scoring: number }, k) {
      const { mapping, name } = await api.get(`/recordings/${recording}`);
      const scoring = await readScoring(api, recording, number);
      return {
        letter: String.fromCharCode(65 + k),
        recordingName: name,
        planned: planned.get(scoring.monitor) ?? "planned test not recorded",
        scoring,
        mapping,
      };
    }
  }

  function remove(k) {
    go(references.filter((_, place) => place !== k));
  }

  function go(wanted) {
    const wordsOf = ({ recording, scoring }) => (recording === id ? scoring : `${recording}:${scoring}`);
    navigate(`#/recordings/${id}?compare=${wanted.map(wordsOf).join(",")}`);
  }
}

/** Scorings of one recording on the same samples, the first against each other one; null for several recordings. */
async function comparedScorings(api, compared) {
  if (compared.length < 2 || new Set(compared.map(({ scoring }) => scoring.recording)).size > 1) return null;
  const first = compared[0].scoring;
  const path = `/recordings/${first.recording}/scorings/${first.id}/comparison?scoring=`;
  const found = await Promise.all(compared.map(({ scoring }) => api.get(path + scoring.id)));
  const items = compared.map(({ letter, scoring }, k) => comparedScoring(letter, scoring, k, found[k]));
  return panel("Sample by sample", comparisonTable(items), { "aria-label": "Sample by sample", beside: h("span.dim", "Differences are from the first scoring.") });
}

function comparedScoring(letter, { monitor_name: name, epsilon, manoeuvres }, k, found) {
  const exceeding = manoeuvres.filter(({ exceedance }) => exceedance !== null);
  const warned = exceeding.filter(({ lead }) => lead !== null);
  const missed = exceeding.filter(({ outcome }) => outcome === "missed").length;
  return {
    name: `${letter}: ${name} at ε ${figure(epsilon)}`,
    k: k < 2 ? k : null,
    assessed: found.n_second,
    alerts: manoeuvres.filter(({ outcome }) => outcome !== "invalid").flatMap(({ alerts }) => alerts.map(([start]) => start)),
    lead: warned.map(({ name: manoeuvre, lead }) => `${manoeuvre}: ${leadSeconds(lead, 2)} s`).join(", ") || "–",
    missed: exceeding.length ? `${missed ? "▲ " : ""}${missed} of ${counted(exceeding.length, "exceedance")}` : "–",
    differences: k === 0 ? null : found,
  };
}

function referenceOf(text, recording) {
  const [first, second] = text.split(":");
  return second ? { recording: first, scoring: second } : { recording, scoring: first };
}

/** Choose a scoring of any recording.   taken: [{recording, scoring}] not offered */
function scoringPicker({ api, recordings, taken, add }) {
  const scored = recordings.filter(({ n_scorings: n }) => n > 0);
  const recording = select(scored.map(({ id, name }) => [id, name]), { id: "pick-recording", onchange: fill });
  const scoring = select([], { id: "pick-scoring" });
  const go = button("Add", () => add({ recording: recording.value, scoring: scoring.value }));
  const failure = errorLine();
  if (taken.length) recording.value = taken[0].recording;
  fill();
  return h(
    "section.panel",
    { "aria-label": "Add a scoring" },
    h(
      "div.row.picker-row",
      h("label", { for: "pick-recording" }, "Add a scoring of"),
      h("div.field", recording),
      h("label", { for: "pick-scoring" }, "by"),
      h("div.field", scoring),
      go,
    ),
    failure.element,
  );

  async function fill() {
    go.disabled = true;
    scoring.replaceChildren();
    const id = recording.value;
    if (id) await failure.attempt(async () => offer(id, await api.get(`/recordings/${id}/scorings`)));
  }

  function offer(id, all) {
    if (recording.value !== id) return;
    const isTaken = (number) => taken.some((pair) => pair.recording === id && pair.scoring === number);
    const left = all.filter((one) => !isTaken(one.id));
    const wordsOf = (one) => `${one.monitor_name} at ε ${figure(one.epsilon)} ${warningWords(one)}`;
    const options = left.map((one) => h("option", { value: one.id }, wordsOf(one)));
    scoring.replaceChildren(...(left.length ? options : [h("option", { value: "" }, "all are shown already")]));
    go.disabled = left.length === 0;
  }
}
