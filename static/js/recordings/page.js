/** One recording: file, mapping, data quality, scorings, and the form that scores it. */

import { drawnFigure } from "../charts/figure.js";
import { previewTiles } from "../charts/recorded/tiles.js";
import { reason } from "../lib/api.js";
import { loadCatalog } from "../lib/catalog.js";
import { createKeepButton, deleteButton, errorLine, h, link, loadingView, pageOf, sentences, state } from "../lib/dom.js";
import { counted } from "../lib/numbers.js";
import { createSignalList, recordingFacts } from "./facts.js";
import { createMappingSection } from "./mapping/section.js";
import { createScoreForm } from "./scoring/form.js";
import { createScoringList } from "./scoring/list.js";

const ROW_BINS = 120; // of the small plots
const CHART_BINS = 1600; // of the chart to mark manoeuvres in

export function aircraftOf(recordings) {
  return [...new Set(recordings.map(({ aircraft }) => aircraft).filter(Boolean))].sort();
}

export function deletion({ id, name, n_scorings: n }) {
  const also = n ? `, ${counted(n, "scoring")}` : "";
  const consequence = `Deletes the file${also} and its notes permanently.`;
  return { path: `/recordings/${id}`, what: `recording “${name}”`, consequence };
}

export function showRecording(element, { id, query, api, navigate }) {
  const trained = query.get("monitor");
  let isNext = trained !== null; // or the mapping was just confirmed: scroll to the score form
  const path = `/recordings/${id}`;
  const loads = [loadCatalog, path, `${path}/scorings`, "/monitors", "/recordings", "/monitor-sets"];
  return loadingView(element, { title: "Recording", text: "Opening the recording", loads, build });

  function build({ keep, again }, catalog, recording, scorings, monitors, all, sets) {
    const isReady = recording.mapping_state === "confirmed" && !recording.problem;
    const quality = createQualityStrip();
    quality.show(recording.quality);
    const used = new Set(trained ? [trained] : scorings.filter(({ request }) => !request.monitor_set).map(({ monitor }) => monitor));
    const form = isReady ? keep(createScoreForm({ api, catalog, recording, monitors, sets, used, scored })) : null;
    const mapping = keep(
      createMappingSection({
        api,
        catalog,
        recording,
        known: aircraftOf(all),
        monitors,
        bins: isReady ? CHART_BINS : ROW_BINS,
        previewed,
        confirmed,
      }),
    );
    const list = h("div.scorings");
    fill(scorings);
    if (form && isNext) requestAnimationFrame(() => form.reveal());
    isNext = false;
    const failure = errorLine();
    const fail = (error) => failure.show(reason(error));
    return pageOf(
      recording.name,
      [
        link("All recordings", "#/recordings"),
        link("Add to a dataset", `#/datasets/rollouts?recording=${id}`),
        createKeepButton({ api, path, keep: recording.keep, fail }),
        deleteButton({ api, ...deletion(recording), done: () => navigate("#/recordings") }),
      ],
      failure.element,
      recordingFacts(recording, catalog),
      list,
      mapping.element,
      quality.element,
      form?.element ?? state("empty", "Score", "Confirm the mapping first."),
      createSignalList(recording),
    );

    function confirmed() {
      isNext = true;
      again();
    }

    function previewed({ channels, quality: measured, problem }, isEdited) {
      const range = previewTiles(channels);
      quality.show(problem ? null : measured);
      if (range) form?.show(channels);
      if (isEdited) form?.hold();
    }

    async function scored(made, someFailed) {
      if (made.length === 1 && !someFailed) navigate(`#/recordings/${id}?scoring=${made[0].id}`);
      else if (!someFailed) again();
      else fill(await api.get(`${path}/scorings`));
    }

    function fill(shown) {
      const table = createScoringList({ api, recording, scorings: shown, changed: again, navigate });
      list.replaceChildren(...(table ? [table] : []));
    }
  }
}

/** Faults of times and channels over time, and in sentences. */
function createQualityStrip() {
  const element = h("section.panel.stack-tight.quality", { "aria-label": "Data quality" });
  return { element, show };

  function show(quality) {
    const none = h("p.dim", quality ? "✓ No gaps, repeated times, missing or frozen values." : "Available once the mapping can be applied.");
    const drawn = quality?.figure ? drawnFigure(quality.figure, "Data quality") : [h("h2.panel-title", "Data quality"), none];
    element.replaceChildren(...[drawn, quality && sentences(quality.sentences)].flat().filter(Boolean));
  }
}
