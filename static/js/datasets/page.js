/** One dataset: its recipe, its unsafe rate, and its rollouts to inspect and replay. */

import { rawRecipe, recipeTable } from "../forms/recipe_table.js";
import { aircraftName, kindName, limitWords, loadCatalog } from "../lib/catalog.js";
import { formatted, h } from "../lib/dom.js";
import { factList, recipeList } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { figure, moment, percent } from "../lib/numbers.js";
import { askToConfirm, button, link, pageOf } from "../lib/view_states.js";
import { peakFigure, rolloutFigure, sampleRollouts } from "./figures.js";
import { createRolloutViewer } from "./rollout_viewer.js";

export function showDataset(element, { id, api, navigate }) {
  return loadingView(element, { title: "Dataset", text: "Opening the dataset", build });

  async function build({ keep }) {
    const [catalog, dataset, monitors] = await Promise.all([
      loadCatalog(api),
      api.get(`/datasets/${id}`),
      api.get("/monitors"),
    ]);
    const rollouts = await sampleRollouts(api, id);
    const users = monitors.filter((monitor) => monitor.dataset_id === id);
    const fitting = monitors.filter(({ dt }) => Math.abs(dt - dataset.dt) < 1e-9 * dataset.dt);
    const viewer = keep(
      createRolloutViewer({
        api,
        catalog,
        dataset,
        monitors: [...users, ...fitting.filter((monitor) => !users.includes(monitor))],
        navigate,
      }),
    );
    const actions = [
      link("Train a monitor", `#/monitors/new?dataset=${id}`, true),
      link("Compare five methods", `#/monitors/compare?dataset=${id}`),
      h(
        "a",
        { class: "button", href: `/api/v1/datasets/${id}/arrays`, download: `dataset-${id}.npz` },
        "Download arrays",
      ),
      button("Delete", () => remove(dataset), { class: "button button-danger", ...needs("DELETE /datasets/{}") }),
    ];
    const { limits } = dataset.recipe;
    const figures = [
      rolloutFigure({ catalog, limits, rollouts, ...dataset }),
      ...dataset.peaks.map((peaks) =>
        peakFigure(
          peaks,
          catalog.channels.find(({ key }) => key === peaks.channel),
        ),
      ),
    ];
    return pageOf(
      dataset.name,
      actions,
      facts(dataset, users, catalog),
      h(
        "div",
        { class: "figures" },
        figures.map((block) => h("section", { class: "panel" }, block)),
      ),
      viewer.element,
      details(dataset, catalog),
    );
  }

  function remove(dataset) {
    askToConfirm(
      `Delete the dataset “${dataset.name}”?`,
      "Deletes the dataset and its rollouts permanently. The same recipe and seed simulate it again.",
      "Delete permanently",
      async () => {
        await api.delete(`/datasets/${id}`);
        navigate("#/datasets");
      },
    );
  }
}

function facts(dataset, users, catalog) {
  const { aircraft, maneuver, limits } = dataset.recipe;
  const used = users.length
    ? users.flatMap(({ id, name }, k) => [
        k ? ", " : "",
        h("a", { href: `#/monitors/${id}` }, name),
      ])
    : "no monitor yet";
  const entries = [
    ["Aircraft", aircraftName(catalog, aircraft)],
    ["Manoeuvre", kindName(catalog, "maneuver", maneuver)],
    ["Limits", formatted(limitWords(catalog, limits))],
    ["Unsafe rate", percent(dataset.unsafe_rate)],
    ["Unsafe rollouts", dataset.n_unsafe.toLocaleString("en")],
    [
      "Safe rollouts",
      dataset.n_safe === dataset.n_safe_met
        ? dataset.n_safe.toLocaleString("en")
        : `${dataset.n_safe_met.toLocaleString("en")} met, ${dataset.n_safe.toLocaleString("en")} stored`,
    ],
    [
      "Length",
      `${figure((dataset.n_samples - 1) * dataset.dt)} s, a sample each ${figure(dataset.dt)} s`,
    ],
    ["Used by", used],
  ];
  return factList(entries, "facts panel");
}

function details(dataset, catalog) {
  const known = Object.keys(dataset.recipe).length > 0;
  const origin = [
    ["Seed", dataset.seed ?? "not recorded"],
    ["SHA-256", dataset.digest, true],
    ["Program", dataset.version],
    ["Created", moment(dataset.created)],
  ];
  return h(
    "section",
    { class: "panel stack" },
    h("h2", { class: "panel-title" }, "Recipe"),
    h(
      "div",
      { class: "columns recipe-columns" },
      known
        ? recipeTable(catalog.recipes.dataset.schema, dataset.recipe, catalog)
        : h("p", {}, "Not simulated here: the recipe is not recorded."),
      recipeList(origin),
    ),
    known ? rawRecipe("Recipe as JSON", dataset.recipe) : null,
  );
}
