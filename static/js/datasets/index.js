/**
 * The Datasets page: #/datasets lists; #/datasets/new simulates one; #/datasets/{id} is one dataset.
 *
 * Exports  show(element, {id, query, api, navigate}) -> {close()}
 */

import { createTestFields } from "../forms/planned_test.js";
import { reason } from "../lib/api.js";
import { aircraftName, kindName, limitWords, loadCatalog } from "../lib/catalog.js";
import { formatted, h } from "../lib/dom.js";
import { followInPlace, jobList } from "../lib/job_progress.js";
import { scrolledTable } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { moment, percent } from "../lib/numbers.js";
import { empty, errorLine, link, pageOf } from "../lib/view_states.js";
import { showDataset } from "./page.js";

export function show(element, context) {
  if (context.id === "new") return showSimulation(element, context);
  return context.id ? showDataset(element, context) : showDatasets(element, context);
}

function showDatasets(element, { api }) {
  return loadingView(element, { title: "Datasets", text: "Loading datasets", build });

  async function build({ keep, again }) {
    const [catalog, datasets, jobs] = await Promise.all([
      loadCatalog(api),
      api.get("/datasets"),
      jobList({ api, kinds: ["dataset"], done: again }),
    ]);
    keep(jobs);
    const content = datasets.length
      ? table(datasets, catalog)
      : empty(
          "No dataset yet",
          "Training a monitor simulates its dataset. You can also simulate one first, to look at the rollouts.",
          link("Simulate a dataset", "#/datasets/new", true),
          link("Train a monitor", "#/monitors/new"),
        );
    return pageOf(
      "Datasets",
      [link("Simulate a dataset", "#/datasets/new", true)],
      jobs.element,
      content,
    );
  }
}

function table(datasets, catalog) {
  const heads = [
    ["Name"],
    ["Aircraft"],
    ["Manoeuvre"],
    ["Limits"],
    ["Unsafe", 1],
    ["Safe", 1],
    ["Unsafe rate", 1],
    ["Created"],
  ];
  const rows = datasets.map(({ id, name, recipe, n_unsafe, n_safe_met, unsafe_rate, created }) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, h("a", { href: `#/datasets/${id}` }, name)),
      h("td", {}, aircraftName(catalog, recipe.aircraft)),
      h("td", {}, kindName(catalog, "maneuver", recipe.maneuver)),
      h("td", { class: "nowrap" }, formatted(limitWords(catalog, recipe.limits))),
      h("td", { class: "number" }, n_unsafe.toLocaleString("en")),
      h("td", { class: "number" }, n_safe_met.toLocaleString("en")),
      h("td", { class: "number" }, percent(unsafe_rate)),
      h("td", { class: "dim nowrap" }, moment(created)),
    ),
  );
  return scrolledTable({ heads, rows });
}

function showSimulation(element, { api, navigate }) {
  return loadingView(element, {
    title: "Simulate a dataset",
    text: "Loading aircraft and manoeuvres",
    build,
  });

  async function build({ keep }) {
    const catalog = await loadCatalog(api);
    const { fields, main, folded, size } = createTestFields({ api, catalog });
    folded.append(fields.element("groups"));
    const name = h("input", {
      type: "text",
      id: "dataset-name",
      maxlength: 200,
      placeholder: "optional",
    });
    const failure = errorLine();
    const form = h(
      "form",
      { class: "form", novalidate: true, onsubmit: send, "aria-label": "Simulate a dataset", "data-keeps-input": true },
      h(
        "fieldset",
        { class: "panel stack" },
        h("legend", {}, "The planned test"),
        main,
        h(
          "div",
          { class: "field-grid" },
          size,
          h("div", { class: "field" }, h("label", { for: "dataset-name" }, "name"), name),
        ),
        folded,
      ),
      failure.element,
      h(
        "div",
        { class: "row" },
        h("button", { class: "button button-primary", type: "submit", ...needs("POST /datasets") }, "Simulate"),
        link("Cancel", "#/datasets"),
      ),
    );
    const stage = h("div", { class: "stack" }, form);
    return pageOf("Simulate a dataset", [], stage);

    async function send(event) {
      event.preventDefault();
      failure.show("");
      if (!fields.check()) return;
      try {
        const job = await api.post("/datasets", {
          ...fields.read(),
          ...(name.value.trim() ? { name: name.value.trim() } : {}),
        });
        followInPlace({
          form,
          stage,
          keep,
          api,
          job,
          title: `Simulating “${job.request.name}”`,
          done: ({ dataset }) => navigate(`#/datasets/${dataset}`),
        });
      } catch (error) {
        fields.point(error.message);
        failure.show(reason(error));
      }
    }
  }
}
