/** One dataset: its recipe, its unsafe rate, and its rollouts to inspect and replay. */

import { isSimulated } from "../forms/planned_test.js";
import { rawRecipe, recipeTable } from "../forms/recipe_table.js";
import { aircraftName, kindName, limitWords, loadCatalog } from "../lib/catalog.js";
import { deleteButton, factList, formatted, h, link, loadingView, pageOf, panel, recipeList } from "../lib/dom.js";
import { count, figure, moment, percent } from "../lib/numbers.js";
import { peakFigure, rolloutFigure, sampleRollouts } from "./figures.js";
import { createRolloutViewer } from "./rollout_viewer.js";


export function showDataset(element, { id, api, navigate }) {
  const loads = [loadCatalog, `/datasets/${id}`, "/monitors", () => sampleRollouts(api, id)];
  return loadingView(element, { title: "Dataset", text: "Opening the dataset", loads, build });

  function build({ keep }, catalog, dataset, monitors, rollouts) {
    const users = monitors.filter((monitor) => monitor.dataset_id === id);
    const fitting = monitors.filter(({ dt }) => Math.abs(dt - dataset.dt) < 1e-9 * dataset.dt);
    const able = [...new Set([...users, ...fitting])];
    const viewer = keep(createRolloutViewer({ api, catalog, dataset, monitors: able, navigate }));
    const channelOf = (peaks) => catalog.channels.find(({ key }) => key === peaks.channel);
    const figures = [
      rolloutFigure({ catalog, limits: dataset.recipe.limits, rollouts, ...dataset }),
      ...dataset.peaks.map((peaks) => peakFigure(peaks, channelOf(peaks))),
    ];
    return pageOf(
      dataset.name,
      [
        link("Train a monitor", `#/monitors/new?dataset=${id}`, true),
        link("Compare five methods", `#/monitors/compare?dataset=${id}`),
        h("a.button", { href: `/api/v1/datasets/${id}/arrays`, download: `dataset-${id}.npz` }, "Download arrays"),
        deleteButton({
          api,
          path: `/datasets/${id}`,
          what: `dataset “${dataset.name}”`,
          consequence: "Deletes the dataset and its rollouts permanently. The same recipe and seed simulate it again.",
          done: () => navigate("#/datasets"),
        }),
      ],
      facts(dataset, users, catalog),
      h("div.figures", figures.map((block) => h("section.panel", block))),
      viewer.element,
      details(dataset, catalog),
    );
  }
}

function facts(dataset, users, catalog) {
  const { n_unsafe: unsafe, n_safe: stored, n_safe_met: met, n_samples: samples, dt } = dataset;
  const { aircraft, maneuver, limits } = dataset.recipe;
  const used = users.flatMap(({ id, name }, k) => [k ? ", " : "", h("a", { href: `#/monitors/${id}` }, name)]);
  const entries = [
    ["Aircraft", aircraftName(catalog, aircraft)],
    ["Manoeuvre", kindName(catalog, "maneuver", maneuver)],
    ["Limits", formatted(limitWords(catalog, limits))],
    ["Unsafe rate", percent(dataset.unsafe_rate)],
    ["Unsafe rollouts", count(unsafe)],
    ["Safe rollouts", stored === met ? count(stored) : `${count(met)} met, ${count(stored)} stored`],
    ["Length", `${figure((samples - 1) * dt)} s, a sample each ${figure(dt)} s`],
    ["Used by", used.length ? used : "no monitor yet"],
  ];
  return factList(entries, "facts panel");
}

function details(dataset, catalog) {
  const { recipe } = dataset;
  const { schema } = catalog.recipes.dataset;
  const isKnown = isSimulated(dataset);
  const origin = [
    ["Seed", dataset.seed ?? "not recorded"],
    ["SHA-256", dataset.digest, true],
    ["Program", dataset.version],
    ["Created", moment(dataset.created)],
  ];
  return panel("Recipe", [
    h(
      "div.columns.recipe-columns",
      isKnown ? recipeTable(schema, recipe, catalog) : h("p", "Not simulated here: the recipe is not recorded."),
      recipeList(origin),
    ),
    isKnown && rawRecipe(recipe),
  ]);
}
