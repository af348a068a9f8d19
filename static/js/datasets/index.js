/**
 * The Datasets page: #/datasets lists; #/datasets/new simulates one, #/datasets/rollouts adds rollouts of any simulator;
 * #/datasets/{id} is one dataset.
 */

import { createForm, fieldset, group, optionalName } from "../forms/controls.js";
import { createTestFields } from "../forms/planned_test.js";
import { limitsOfMonitor, loadCatalog, testNames } from "../lib/catalog.js";
import { empty, formatted, h, link, loadingView, pageOf, table } from "../lib/dom.js";
import { jobList } from "../lib/job_progress.js";
import { count, moment, percent } from "../lib/numbers.js";
import { showRollouts } from "./add_rollouts.js";
import { showDataset } from "./page.js";

const VIEWS = { new: showSimulation, rollouts: showRollouts };

export function show(element, context) {
  const view = context.id ? (VIEWS[context.id] ?? showDataset) : showDatasets;
  return view(element, context);
}

function showDatasets(element, { api }) {
  return loadingView(element, { title: "Datasets", text: "Loading datasets", loads: [loadCatalog, "/datasets"], build });

  async function build({ keep, again }, catalog, datasets) {
    const jobs = keep(await jobList({ api, kind: "dataset", done: again }));
    const simulating = () => link("Simulate a dataset", "#/datasets/new", true);
    const adding = () => link("Add rollouts", "#/datasets/rollouts");
    const content = datasets.length
      ? listOf(datasets, catalog)
      : empty(
          "No dataset yet",
          "Training a monitor simulates its dataset. You can also simulate one first, to look at the rollouts, or add those of your own simulator.",
          simulating(),
          adding(),
          link("Train a monitor", "#/monitors/new"),
        );
    return pageOf("Datasets", [simulating(), adding()], jobs.element, content);
  }
}

function listOf(datasets, catalog) {
  const columns = [
    ["Name", ({ id, name }) => h("a", { href: `#/datasets/${id}` }, name), "name"],
    ["Aircraft", (dataset) => testNames(catalog, dataset)[0]],
    ["Manoeuvre", (dataset) => testNames(catalog, dataset)[1]],
    ["Limits", (dataset) => formatted(limitsOfMonitor(catalog, dataset))],
    ["Unsafe", ({ n_unsafe: n }) => count(n), "number"],
    ["Safe", ({ n_safe_met: n }) => count(n), "number"],
    ["Unsafe rate", ({ unsafe_rate: rate }) => percent(rate), "number"],
    ["Created", ({ created }) => moment(created), "date"],
  ];
  return table({ columns, items: datasets });
}

function showSimulation(element, { api, navigate }) {
  const title = "Simulate a dataset";
  return loadingView(element, { title, text: "Loading aircraft and manoeuvres", loads: [loadCatalog], build });

  function build({ keep }, catalog) {
    const { fields, main, folded, size } = createTestFields({ api, catalog, withGroups: true });
    const named = optionalName("name", "dataset-name");
    const { element: form } = createForm({
      title,
      word: "Simulate",
      route: "POST /datasets",
      fields: [fields, group({ name: named })],
      content: fieldset("The planned test", main, h("div.field-grid", size, named.element), folded),
      beside: link("Cancel", "#/datasets"),
      send: () => api.post("/datasets", { ...fields.read(), ...named.read() }),
      follow: {
        api,
        keep,
        title: ({ request }) => `Simulating “${request.name}”`,
        done: ({ dataset }) => navigate(`#/datasets/${dataset}`),
      },
    });
    return pageOf(title, [], form);
  }
}
