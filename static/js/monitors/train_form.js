/**
 * Train a monitor: the form, then the job, then the monitor's page.
 *
 * Exports  showTraining(element, {query, api, navigate})
 *     query: dataset (train on it), like (begin with the recipe of that monitor),
 *            recording (begin with what the server proposes for it)
 */

import { createFields } from "../forms/form.js";
import { datasetChoice } from "../forms/planned_test.js";
import { reason } from "../lib/api.js";
import { loadCatalog, methodOf } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { followInPlace } from "../lib/job_progress.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { figure } from "../lib/numbers.js";
import { errorLine, link, pageOf } from "../lib/view_states.js";
import { leastFor, neededFor } from "./calibration_rule.js";
import { createRecordedOrigin, recordedTest } from "./recorded_origin.js";

const MAIN = ["t_early", "epsilon"];
const TEST = {
  title: "test flights",
  type: "integer",
  minimum: 0,
  maximum: 100000,
  default: 2000,
  description:
    "fresh flights that measure misses and false alarms; 0 for none.",
};

export function showTraining(element, { query, api, navigate }) {
  return loadingView(element, {
    title: "Train a monitor",
    text: "Loading aircraft and manoeuvres",
    build,
  });

  async function build({ keep }) {
    const [catalog, datasets, like, recorded] = await Promise.all([
      loadCatalog(api),
      api.get("/datasets"),
      query.get("like") ? api.get(`/monitors/${query.get("like")}`) : null,
      query.get("recording") ? recordedTest(api, query.get("recording")) : null,
    ]);
    const stage = h("div", { class: "stack" });
    const origin = recorded && createRecordedOrigin({ catalog, recorded, changed: fill });
    let form = null;
    fill();
    return pageOf("Train a monitor", [], origin?.element, stage);

    function fill() {
      const begun = like ?? origin?.recipe() ?? null;
      stage.replaceChildren();
      if (origin && begun === null) return;
      form = createTrainForm({ api, catalog, datasets, like: begun, chosen: query.get("dataset"), onsubmit: send });
      stage.append(form.element);
    }

    async function send(event) {
      event.preventDefault();
      form.refuse("");
      if (!form.check()) return;
      form.setUsable(false);
      try {
        const job = await api.post("/monitors", form.read());
        followInPlace({
          form: form.element,
          stage,
          keep,
          focus: form.go,
          api,
          job,
          title: `Training “${job.request.name}”`,
          done: ({ monitor }) => navigate(recorded ? `#/recordings/${recorded.recording.id}?monitor=${monitor}` : `#/monitors/${monitor}`),
        });
      } catch (error) {
        form.point(error.message);
        form.refuse(reason(error));
      } finally {
        form.setUsable(true);
      }
    }
  }
}

/** like: {recipe, dataset_recipe} to begin with, or null.   chosen: id of the dataset to begin with, or null. */
function createTrainForm({ api, catalog, datasets, like, chosen, onsubmit }) {
  const { schema } = catalog.recipes.monitor;
  const withTest = { ...schema, properties: { ...schema.properties, n_test: TEST } };
  const fields = createFields(
    withTest,
    { ...catalog.recipes.monitor[like ? "default" : "usual"], ...like?.recipe },
    { catalog, path: "monitor" },
  );
  const source = datasetChoice({
    api,
    catalog,
    datasets,
    chosen,
    initial: like?.dataset_recipe,
  });
  const method = h(
    "select",
    { id: "method", name: "method", oninput: choose },
    catalog.methods.map(({ kind, label }, k) => h("option", { value: kind }, k === 0 ? `${label} (recommended)` : label)),
    h("option", { value: "" }, "predictor and score chosen below"),
  );
  const name = h("input", {
    type: "text",
    id: "monitor-name",
    maxlength: 200,
    placeholder: "optional",
  });
  const failure = errorLine();
  const served = h("p", { class: "hint served" });
  const go = h("button", { class: "button button-primary", type: "submit", ...needs("POST /monitors") }, "Train");
  const advanced = fields.keys.filter((key) => !MAIN.includes(key));
  const families = advanced.filter((key) => schema.properties[key]?.["x-family"]);
  const element = h(
    "form",
    {
      class: "form",
      novalidate: true,
      onsubmit,
      oninput: follow,
      onchange: follow,
      "aria-label": "Train a monitor",
      "data-keeps-input": true,
    },
    source.element,
    h(
      "fieldset",
      { class: "panel" },
      h("legend", {}, "2  Warning lead time and miss rate"),
      h(
        "div",
        { class: "field-grid" },
        MAIN.map(fields.element),
        source.size,
        h("div", { class: "field" }, h("label", { for: "method" }, "method"), method),
        h(
          "div",
          { class: "field" },
          h("label", { for: "monitor-name" }, "name of the monitor"),
          name,
        ),
      ),
      served,
    ),
    h(
      "details",
      { class: "panel fold" },
      h("summary", {}, "Predictor, score, groups, promise, calibration, test flights"),
      h("div", { class: "columns" }, families.map(fields.element)),
      h(
        "div",
        { class: "field-grid" },
        advanced.filter((key) => !families.includes(key)).map(fields.element),
      ),
    ),
    failure.element,
    h(
      "div",
      { class: "row form-end" },
      go,
      link("Cancel", "#/monitors"),
      h(
        "span",
        { class: "hint" },
        "Simulates, trains and tests. You can leave the page meanwhile.",
      ),
    ),
  );
  follow();

  function choose() {
    const { predictor, score } = catalog.methods.find(({ kind }) => kind === method.value) ?? {};
    if (predictor) fields.put("predictor", predictor);
    if (score) fields.put("score", score);
  }

  function follow() {
    const recipe = fields.read();
    const { epsilon, guarantee } = recipe;
    method.value = methodOf(catalog, recipe)?.kind ?? "";
    const n = source.failures();
    const enough = n !== null && epsilon > 0 && n >= neededFor(epsilon, guarantee);
    served.textContent =
      !(epsilon > 0 && epsilon < 1) || n === null
        ? ""
        : enough
          ? `${n} failures: enough for ε ≥ ${figure(leastFor(n, guarantee))}.`
          : `ε = ${figure(epsilon)} needs at least ${neededFor(epsilon, guarantee)} unsafe rollouts, and ${n} are set: raise ε or the number of rollouts.`;
    served.classList.toggle("error", !enough && served.textContent !== "");
  }

  return {
    element,
    go,
    check: () => [source.check(), fields.check()].every(Boolean),
    read: () => ({
      ...fields.read(),
      dataset: source.read(),
      ...(name.value.trim() && { name: name.value.trim() }),
    }),
    point: (message) => {
      if (!source.point(message) && !fields.point(message))
        element.querySelector("[aria-invalid]")?.focus();
    },
    refuse: (words) => {
      failure.show(words);
      failure.element.scrollIntoView({ block: "nearest" });
    },
    setUsable: (usable) => {
      go.disabled = !usable;
    },
  };
}
