/** One dataset: its recipe, its unsafe rate, and its rollouts to inspect and replay. */

import { rawRecipe, recipeTable } from "../forms/recipe_table.js";
import { channelsOf, isSimulated, limitsOfMonitor, loadCatalog, modelFacts, ownLimits, testNames, testRecipe } from "../lib/catalog.js";
import { deleteButton, factList, formatted, h, link, loadingView, pageOf, panel, recipeList } from "../lib/dom.js";
import { withLimits } from "../lib/limits.js";
import { warningLines } from "../lib/monitors.js";
import { count, counted, figure, moment, percent } from "../lib/numbers.js";
import { channelTable } from "./channel_table.js";
import { flownTable } from "./flown_flights.js";
import { peakFigure, rolloutFigure, sampleRollouts } from "./figures.js";
import { createRolloutViewer } from "./rollout_viewer.js";

export function showDataset(element, { id, api, navigate }) {
  const loads = [loadCatalog, `/datasets/${id}`, "/monitors", () => sampleRollouts(api, id), "/recordings"];
  return loadingView(element, { title: "Dataset", text: "Opening the dataset", loads, build });

  function build({ keep }, catalog, dataset, monitors, rollouts, recordings) {
    const users = monitors.filter((monitor) => monitor.dataset_id === id);
    const fitting = monitors.filter(({ dt }) => Math.abs(dt - dataset.dt) < 1e-9 * dataset.dt);
    const able = [...new Set([...users, ...fitting])];
    const channels = withLimits(channelsOf(catalog, dataset), ownLimits(dataset));
    const viewer = keep(createRolloutViewer({ api, channels, dataset, monitors: able, navigate }));
    const channelOf = (peaks) => channels.find(({ key }) => key === peaks.channel);
    const isKnown = isSimulated(dataset);
    const figures = [
      rolloutFigure({ ...dataset, channels, rollouts }),
      ...dataset.peaks.map((peaks) => peakFigure(peaks, channelOf(peaks))),
    ];
    return pageOf(
      dataset.name,
      [
        link("Train a monitor", `#/monitors/new?dataset=${id}`, true),
        isKnown && link("Lead-time study", `#/monitors/sweep?dataset=${id}`),
        h("a.button", { href: `/api/v1/datasets/${id}/arrays`, download: `dataset-${id}.npz` }, "Download arrays"),
        deleteButton({
          api,
          path: `/datasets/${id}`,
          what: `dataset “${dataset.name}”`,
          consequence: `Deletes the dataset and its rollouts permanently. ${isKnown ? "The same recipe and seed simulate it again." : "Keep its files or simulator to make it again."}`,
          done: () => navigate("#/datasets"),
        }),
      ],
      findings(dataset),
      facts(dataset, users, catalog),
      h("div.figures", figures.map((block) => h("section.panel", block))),
      viewer.element,
      flownTable(dataset, recordings),
      isKnown ? null : panel("Channels", channelTable(channels)),
      details(dataset, catalog),
    );
  }
}

function facts(dataset, users, catalog) {
  const { n_unsafe: unsafe, n_safe: stored, n_safe_met: met, n_samples: samples, dt } = dataset;
  const { flown = [] } = dataset.recipe;
  const [aircraft, maneuver] = testNames(catalog, dataset);
  const test = isSimulated(dataset) ? [["Aircraft", aircraft], ...modelFacts(catalog, dataset.recipe), ["Manoeuvre", maneuver]] : [["Source", aircraft]];
  const used = users.flatMap(({ id, name }, k) => [k ? ", " : "", h("a", { href: `#/monitors/${id}` }, name)]);
  const entries = [
    ...test,
    ["Limits", formatted(limitsOfMonitor(catalog, dataset))],
    ["Unsafe rate", percent(dataset.unsafe_rate)],
    ...(flown.length ? [["Flown", `${counted(flown.length, "manoeuvre")} of ${counted(new Set(flown.map(({ digest }) => digest)).size, "flight")}`]] : []),
    ["Unsafe rollouts", count(unsafe)],
    ["Safe rollouts", stored === met ? count(stored) : `${count(met)} simulated, ${count(stored)} stored`],
    ["Length", `${figure((samples - 1) * dt)} s, one sample every ${figure(dt)} s`],
    ["Used by", used.length ? used : "no monitor yet"],
  ];
  return factList(entries, "facts panel");
}

/** What was left out of the rollouts, or looks implausible. */
function findings({ findings: texts }) {
  if (texts === null) return null;
  if (!texts.length) return panel("Checked", h("p", "No duplicates, no flights that end early, no channel whose first sample tells the outcome."), { class: "panel stack-tight findings" });
  return panel("Findings", warningLines({ warnings: texts }), { class: "panel stack-tight findings" });
}

function details(dataset, catalog) {
  const { recipe } = dataset;
  const { schema } = testRecipe(catalog, recipe);
  const isKnown = isSimulated(dataset);
  const hasRecipe = Boolean(recipe.aircraft || recipe.simulator);
  const origin = [
    ["Seed", dataset.seed ?? "not recorded"],
    ["SHA-256", dataset.digest, true],
    ["Program", dataset.version],
    ["Created", moment(dataset.created)],
  ];
  return panel("Recipe", [
    h(
      "div.columns.recipe-columns",
      isKnown || recipe.aircraft ? recipeTable(schema, recipe, catalog) : h("p", recipe.simulator ? "Made on the command line by an own simulator." : "Own rollouts have no recipe."),
      recipeList(origin),
    ),
    hasRecipe && rawRecipe(recipe),
  ]);
}
