/** One monitor: its promise, its results on fresh flights, figures, recipe and file. Exports  showMonitor. */

import { rolloutFigure, sampleRollouts } from "../datasets/figures.js";
import { rawRecipe, recipeTable } from "../forms/recipe_table.js";
import { aircraftName, kindName, limitWords, loadCatalog, methodOf } from "../lib/catalog.js";
import { formatted, h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { factList, recipeList, tableHead } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { figure, moment, percent } from "../lib/numbers.js";
import { warningLines } from "../lib/monitor_warnings.js";
import { askToConfirm, button, empty, link, pageOf } from "../lib/view_states.js";
import { createEpsilonChoice } from "./choose_epsilon.js";
import { createEpsilonCost } from "./epsilon_cost.js";
import { calibrationFigure, curvesFigure, leadFigure, preventionFigure } from "./figures.js";

export function showMonitor(element, { id, api, navigate }) {
  return loadingView(element, { title: "Monitor", text: "Opening the monitor", build });

  async function build({ keep }) {
    const [catalog, monitor, calibration] = await Promise.all([
      loadCatalog(api),
      api.get(`/monitors/${id}`),
      api.get(`/monitors/${id}/calibration`),
    ]);
    const [evaluation, dataset, rollouts] = await Promise.all([
      evaluationOf(api, id),
      monitor.dataset_id && api.get(`/datasets/${monitor.dataset_id}`),
      monitor.dataset_id && sampleRollouts(api, monitor.dataset_id),
    ]);
    const calibrations = calibration.groups.length ? calibration.groups : [calibration];
    const calibrationCurves = calibrations.map(calibrationFigure);
    const curves = evaluation && curvesFigure(evaluation);
    const cost = createEpsilonCost({
      monitor,
      calibrations,
      evaluation,
      changed: (rule) => [...calibrationCurves, curves].forEach((drawn) => drawn?.mark(rule)),
    });
    const fly = button("Fly", () => navigate(`#/fly?monitor=${id}&epsilon=${cost.epsilon}`), {
      class: "button button-primary",
    });
    const actions = [
      fly,
      h(
        "a",
        { class: "button", href: `/api/v1/monitors/${id}/file`, download: true },
        "Download",
      ),
      evaluation &&
        h("a", { class: "button", href: `/api/v1/monitors/${id}/certificate`, target: "_blank" }, "Certificate"),
      monitor.recipe.predictor?.kind !== "combination" &&
        link("Train one like it", `#/monitors/new?like=${id}`),
      button("Delete", () => remove(monitor), { class: "button button-danger", ...needs("DELETE /monitors/{}") }),
    ];
    const figures = [
      rollouts
        ? rolloutFigure({
            catalog,
            limits: monitor.dataset_recipe.limits,
            rollouts,
            ...dataset,
          })
        : empty(
            "No rollouts",
            "The training dataset is not stored on this server. The monitor works without it.",
          ),
      curves ??
        empty(
          "No test flights",
          "The monitor was uploaded, or trained without test flights. Train one like it with test flights to measure misses and false alarms.",
          monitor.recipe.predictor && Object.keys(monitor.dataset_recipe).length ? link("Train one like it", `#/monitors/new?like=${id}`, true) : null,
        ),
      ...calibrationCurves,
      evaluation && leadFigure(evaluation),
      evaluation && preventionFigure(evaluation),
      groups(evaluation, calibration, catalog),
      robustness(evaluation),
    ];
    return pageOf(
      monitor.name,
      actions,
      ...warningLines(monitor),
      facts({ monitor, calibration, dataset, evaluation, catalog }),
      cost.element,
      Object.keys(monitor.dataset_recipe).length ? createEpsilonChoice({ api, id, catalog, navigate, keep }) : null,
      h(
        "div",
        { class: "figures" },
        figures.filter(Boolean).map((block) => h("section", { class: "panel" }, block)),
      ),
      guarantee(monitor, calibration),
      details(monitor, calibration, catalog),
    );
  }

  function remove(monitor) {
    askToConfirm(
      `Delete the monitor “${monitor.name}”?`,
      "Deletes the monitor with its calibration and evaluation permanently. Download its file first to keep a copy. The dataset stays.",
      "Delete permanently",
      async () => {
        await api.delete(`/monitors/${id}`);
        navigate("#/monitors");
      },
    );
  }
}

async function evaluationOf(api, id) {
  try {
    return await api.get(`/monitors/${id}/evaluation`);
  } catch (error) {
    if (error.status === 404) return null;
    throw error;
  }
}

function facts({ monitor, calibration, dataset, evaluation, catalog }) {
  const { aircraft, maneuver, limits } = monitor.dataset_recipe;
  const entries = [
    ["Aircraft", aircraftName(catalog, aircraft)],
    ...(aircraft?.sources ? [["Identified from", aircraft.sources.join(", ")]] : []),
    ["Manoeuvre", kindName(catalog, "maneuver", maneuver)],
    ["Limits", formatted(limitWords(catalog, limits))],
    ["Warning lead time", `${figure(monitor.lead)} s`],
    ["Calibrated on", `${monitor.n_unsafe} failures${calibration.groups.length ? ` of each of ${calibration.groups.length} groups` : ""}`],
    ["Smallest epsilon", figure(monitor.smallest_epsilon)],
    ["Unsafe rate", percent(dataset?.unsafe_rate ?? evaluation?.unsafe_rate)],
    ["Test flights", evaluation ? evaluation.n_test.toLocaleString("en") : "none"],
  ];
  return factList(entries, "facts panel");
}

function robustness(evaluation) {
  const entries = Object.values(evaluation?.robustness ?? {});
  if (!entries.length) return null;
  const row = ({ words, n_unsafe, n_safe, misses, withdrawn, false_alerts, safe_withdrawn }) =>
    h(
      "tr",
      {},
      h("td", {}, words),
      ...[
        n_unsafe.toLocaleString("en"),
        share(misses, n_unsafe),
        share(withdrawn, n_unsafe),
        n_safe.toLocaleString("en"),
        share(false_alerts, n_safe),
        share(safe_withdrawn, n_safe),
        share(safe_withdrawn === undefined ? undefined : n_safe - false_alerts - safe_withdrawn, n_safe),
      ].map((text) => h("td", { class: "number" }, text)),
    );
  return counted({
    title: `Flights that differ from the planned test, at ε = ${figure(evaluation.epsilon)}`,
    heads: [["Flights that differ by"], ["failed", 1], ["missed", 1], ["INVALID before an alert", 1], ["safe", 1], ["false alarm", 1], ["INVALID, no alert", 1], ["valid and quiet", 1]],
    rows: entries.map(row),
    hint: "The guarantee does not cover these flights. Missed: valid, without an alert. INVALID flights show no risk and are neither missed nor quiet.",
  });
}

const share = (count, total) => (count === undefined ? "not counted" : total ? percent(count / total) : "–");

/** A table of counts with its explanation; each row is a kind of flight. */
function counted({ title, heads, rows, hint }) {
  return h(
    "div",
    { class: "stack" },
    h("h2", { class: "panel-title" }, title),
    h(
      "div",
      { class: "table-scroll" },
      h("table", { class: "table" }, tableHead(heads), h("tbody", {}, rows)),
    ),
    h("p", { class: "hint" }, hint),
  );
}

/** Misses in each group of failing flights, with or without a promise for the group. */
function groups(evaluation, calibration, catalog) {
  const measured = evaluation?.groups ?? [];
  if (!measured.length) return null;
  const promised = calibration.groups[0]?.rule;
  const row = ({ rule, name, n_unsafe, misses, withdrawn, miss_interval: [low, high] }) =>
    h(
      "tr",
      {},
      h("td", {}, name),
      ...[n_unsafe.toLocaleString("en"), share(misses, n_unsafe), `${percent(low)} to ${percent(high)}`, share(withdrawn, n_unsafe)].map((text) =>
        h("td", { class: "number" }, text),
      ),
      h("td", {}, rule === promised ? "its own" : "none"),
    );
  return counted({
    title: `Missed in each group, at ε = ${figure(evaluation.epsilon)}`,
    heads: [["Failing flights"], ["failed", 1], ["missed", 1], ["95 % interval", 1], ["INVALID before an alert", 1], ["promise"]],
    rows: measured.map(row),
    hint: promised
      ? `The promise holds in each group by ${kindName(catalog, "grouping", { kind: promised })}, not for other groups nor for all groups at once.`
      : "The promise covers all failing flights together; one group may be missed more often. Train with groups for a promise in each.",
  });
}

function guarantee(monitor, calibration) {
  const early = monitor.n_early
    ? h(
        "li",
        {},
        `${monitor.n_early} of the ${calibration.alphas.length} failures came within the first ${figure(monitor.lead)} s: no timely alert was possible, and each counts as a miss.`,
      )
    : null;
  return h(
    "section",
    { class: "panel stack" },
    h("h2", { class: "panel-title" }, "What is guaranteed ", guideLink("what-the-numbers-mean#what-is-promised-and-what-is-not", "the guarantee")),
    h("p", { class: "promise" }, "P(no timely alert | the flight fails) ≤ epsilon"),
    h(
      "ul",
      {},
      h(
        "li",
        {},
        `The promise holds ${monitor.recipe.guarantee === "95%" ? "with 95 % confidence in this monitor" : "on average over calibration sets"}, for flights like the simulated ones: this aircraft with its uncertainty, this manoeuvre, this simulated pilot.`,
      ),
      h(
        "li",
        {},
        `Timely: at least ${figure(monitor.lead)} s before the first exceedance. Later alerts do not count.`,
      ),
      h(
        "li",
        {},
        "The risk (p-value) is not the probability of failure. High risk: the flight resembles failing flights.",
      ),
      h("li", {}, validity(monitor)),
      calibration.groups.length
        ? h("li", {}, `It holds in each group of failing flights: ${calibration.groups.map(({ name }) => name).join("; ")}.`)
        : null,
      early,
    ),
  );
}

function validity({ support }) {
  if (!support)
    return "Validity is not calibrated: Forewarn cannot tell whether a flight is like the training flights. Train the monitor again to calibrate it.";
  const { n_safe, n_unsafe, level } = support;
  const flights = `${n_safe.toLocaleString("en")} safe and ${n_unsafe.toLocaleString("en")} failing fresh flights`;
  return `Validity: INVALID withdraws the guarantee of a manoeuvre. At most ${percent(level)} of flights like the simulated ones, safe or failing, are called INVALID. Calibrated on ${flights}.`;
}

function memberWords({ lead, n_unsafe, recipe }, catalog) {
  const parts = ["predictor", "score"].map((part) => kindName(catalog, part, recipe[part]));
  return `${figure(lead)} s ahead: ${methodOf(catalog, recipe)?.label ?? parts.join(", ")}; alone calibrated on ${n_unsafe.toLocaleString("en")} failures`;
}

function details(monitor, { members }, catalog) {
  const { dataset, monitor: form } = catalog.recipes;
  const hashes = [
    ["File, SHA-256", monitor.digest, true],
    ["Dataset, SHA-256", monitor.dataset_digest, true],
    ["Program", monitor.version],
    ["Seed", monitor.seed ?? "not recorded"],
    ["Created", moment(monitor.created)],
    [
      "Dataset",
      monitor.dataset_id
        ? h("a", { href: `#/datasets/${monitor.dataset_id}` }, monitor.dataset_id)
        : "not stored here",
    ],
    ["Sample interval", `${figure(monitor.dt)} s`],
    ...members.map((member, k) => [`Member ${k + 1}`, memberWords(member, catalog)]),
  ];
  return h(
    "section",
    { class: "panel stack" },
    h("h2", { class: "panel-title" }, "Recipe"),
    h(
      "div",
      { class: "columns recipe-columns" },
      h(
        "div",
        { class: "stack-tight" },
        h("h3", {}, "Monitor"),
        recipeTable(form.schema, monitor.recipe, catalog),
        h("h3", {}, "Origin"),
        recipeList(hashes),
      ),
      h(
        "div",
        { class: "stack-tight" },
        h("h3", {}, "Planned test"),
        recipeTable(dataset.schema, monitor.dataset_recipe, catalog),
      ),
    ),
    rawRecipe("Recipe as JSON", { ...monitor.recipe, dataset: monitor.dataset_recipe }),
  );
}
