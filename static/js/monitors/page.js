/** One monitor: its promise, its results on fresh flights, figures, recipe and file. */

import { channelTable } from "../datasets/channel_table.js";
import { rolloutFigure, sampleRollouts } from "../datasets/figures.js";
import { foldedPanel } from "../forms/controls.js";
import { rawRecipe, recipeTable } from "../forms/recipe_table.js";
import { needs } from "../lib/api.js";
import { channelsOf, isSimulated, limitsOfMonitor, loadCatalog, methodWords, modelFacts, ownLimits, testNames, testRecipe } from "../lib/catalog.js";
import {
  button,
  chip,
  deleteButton,
  empty,
  factList,
  formatted,
  guideLink,
  h,
  link,
  loadingView,
  pageOf,
  panel,
  recipeList,
  table,
} from "../lib/dom.js";
import { withLimits } from "../lib/limits.js";
import { warningLines } from "../lib/monitors.js";
import { capital, count, counted, figure, interval, moment, percent } from "../lib/numbers.js";
import { createAirframeChoice } from "./airframe.js";
import { createEpsilonChoice } from "./choose_epsilon.js";
import { createEpsilonCost } from "./epsilon_cost.js";
import { calibrationFigure, curvesFigure, leadFigure, preventionFigure } from "./figures.js";

const share = (n, total) => (total ? percent(n / total) : "–");

export function showMonitor(element, { id, api, navigate }) {
  const loads = [loadCatalog, `/monitors/${id}`, `/monitors/${id}/calibration`, () => evaluationOf(api, id), `/monitors/${id}/airframe`];
  return loadingView(element, { title: "Monitor", text: "Opening the monitor", loads, build });

  async function build({ keep }, catalog, monitor, calibration, evaluation, airframe) {
    const { dataset_id: from } = monitor;
    const [dataset, rollouts] = from ? await Promise.all([api.get(`/datasets/${from}`), sampleRollouts(api, from)]) : [];
    const calibrations = calibration.groups.length ? calibration.groups : [calibration];
    const calibrationCurves = calibrations.map(calibrationFigure);
    const curves = evaluation && curvesFigure(evaluation);
    const changed = (rule) => [...calibrationCurves, curves].forEach((drawn) => drawn?.mark(rule));
    const cost = createEpsilonCost({ monitor, calibration, evaluation, changed });
    const isKnown = isSimulated(monitor);
    const again = (isPrimary) => link("Train one like it", `#/monitors/new?like=${id}${from && !isKnown ? `&dataset=${from}` : ""}`, isPrimary);
    const { predictor } = monitor.recipe;
    const certificate = `/api/v1/monitors/${id}/certificate`;
    const channels = withLimits(channelsOf(catalog, monitor), ownLimits(monitor));
    const training = [
      rollouts
        ? rolloutFigure({ ...dataset, channels, rollouts })
        : empty("No rollouts", "The training dataset is not stored on this server. The monitor works without it."),
      ...calibrationCurves,
    ];
    const untested = () =>
      empty(
        "No test flights",
        "The monitor was uploaded, or trained without test flights. Train one like it with test flights to measure misses and false alarms.",
        predictor && isKnown && again(true),
      );
    const tested = curves ? [curves, leadFigure(evaluation), preventionFigure(evaluation)] : [untested()];
    return pageOf(
      monitor.name,
      [
        button("Fly", () => navigate(`#/fly?monitor=${id}&epsilon=${cost.epsilon}`), { class: "button button-primary", ...needs("POST /flights") }),
        h("a.button", { href: `/api/v1/monitors/${id}/file`, download: true }, "Download"),
        evaluation && h("a.button", { href: certificate, target: "_blank" }, "Certificate"),
        predictor?.kind !== "combination" && again(),
        deleteButton({
          api,
          path: `/monitors/${id}`,
          what: `monitor “${monitor.name}”`,
          consequence: "Deletes the monitor with its calibration and evaluation permanently. Download its file first to keep a copy. The dataset stays.",
          done: () => navigate("#/monitors"),
        }),
      ],
      ...warningLines(monitor),
      facts({ monitor, calibration, dataset, evaluation, catalog }),
      evaluation?.calibrated_on && h("p.panel", `${capital(evaluation.calibrated_on.words)}.`),
      cost.element,
      isKnown ? createEpsilonChoice({ api, id, catalog, navigate, keep }) : null,
      guarantee(monitor, calibration, isKnown, isKnown || Boolean(evaluation?.simulator)),
      methods(evaluation, catalog),
      figurePanels(tested),
      fold("All results on fresh flights, as in the certificate", evaluation && h("iframe.certificate", { src: certificate, title: "Certificate", loading: "lazy" })),
      fold("Training flights and calibration", figurePanels(training)),
      fold("Channels", isKnown ? null : channelTable(channels)),
      fold("Aircraft in the scene", createAirframeChoice({ api, id, airframe })),
      fold("Recipe, origin and file", details(monitor, calibration, catalog)),
    );
  }
}

const fold = (title, content) => content && foldedPanel(title, content);

const figurePanels = (figures) => h("div.figures", figures.filter(Boolean).map((block) => h("section.panel", block)));

function evaluationOf(api, id) {
  return api.get(`/monitors/${id}/evaluation`).catch((error) => {
    if (error.status !== 404) throw error;
    return null;
  });
}

function facts({ monitor, calibration, dataset, evaluation, catalog }) {
  const { sources } = monitor.dataset_recipe.aircraft ?? {};
  const nGroups = calibration.groups.length;
  const mixture = evaluation?.calibrated_on;
  const [aircraft, maneuver] = testNames(catalog, monitor);
  const test = isSimulated(monitor)
    ? [["Aircraft", aircraft], ...(sources ? [["Identified from", sources.join(", ")]] : []), ...modelFacts(catalog, monitor.dataset_recipe), ["Manoeuvre", maneuver]]
    : [["Trained on", evaluation?.simulator ? aircraft : `${aircraft}, split by flight`]];
  const entries = [
    ...test,
    ["Limits", formatted(limitsOfMonitor(catalog, monitor))],
    ["Warning lead time", `${figure(monitor.lead)} s`],
    ["Calibrated on", mixture ? `${mixture.simulated} simulated and ${counted(mixture.flown, "flown failure")}` : `${counted(monitor.n_unsafe, "failure")}${nGroups ? ` of each of ${nGroups} groups` : ""}`],
    ["Smallest epsilon", figure(monitor.smallest_epsilon)],
    ["Unsafe rate", percent(dataset?.unsafe_rate ?? evaluation?.unsafe_rate)],
    ["Test flights", evaluation ? count(evaluation.n_test) : "none"],
  ];
  return factList(entries, "facts panel");
}

/** The methods tried on own rollouts, and a plain threshold; null for other monitors. */
function methods(evaluation, catalog) {
  const tried = evaluation?.methods ?? [];
  if (!tried.length) return null;
  const labelOf = ({ name }) => catalog.tried[name] ?? name;
  const columns = [
    ["Method", (method) => [labelOf(method), method.chosen ? [" ", chip("chosen", "ok")] : null], "name"],
    ["Failing flights missed", ({ missed: n, n_unsafe: of }) => `${n} of ${count(of)} (${share(n, of)})`, "number"],
    ["95 % interval", ({ miss_interval: bounds }) => (bounds ? interval(bounds) : "–"), "number"],
    ["Safe flights, valid and without an alert", ({ quiet: n, n_safe: of }) => `${n} of ${count(of)} (${share(n, of)})`, "number"],
  ];
  const isThreshold = ({ name }) => !catalog.methods.some(({ kind }) => kind === name);
  const hint = `At ε = ${figure(evaluation.epsilon)} and this warning lead time, on flights used for nothing else.`;
  const [{ most_missed: most, n_unsafe: of }] = tried;
  const kept = most === undefined ? "" : ` A method keeps ε in this trial if it misses at most ${most} of ${count(of)}: so few flights cannot tell more from chance (two standard errors). The promise comes from the calibration.`;
  const beside = tried.some(isThreshold) ? " The threshold is calibrated like the methods." : "";
  return panel("Methods tried", [table({ columns, items: tried, panel: false }), h("p.hint", hint + kept + beside)]);
}

function guarantee(monitor, { groups: promised, alphas }, isKnown, isFresh) {
  const lead = figure(monitor.lead);
  const isSure = monitor.recipe.guarantee === "95%";
  const holds = isSure ? "with 95 % confidence in this monitor" : "on average over calibration sets";
  const points = [
    isKnown
      ? `The promise holds ${holds}, for flights like the simulated ones: this aircraft with its uncertainty, this manoeuvre, this simulated pilot.`
      : `The promise holds ${holds}, for flights like those it was trained on: their aircraft, manoeuvre and pilot.`,
    `Timely: at least ${lead} s before the first exceedance. Later alerts do not count.`,
    "The risk (p-value) is not the probability of failure. High risk: the flight resembles failing flights.",
    validity(monitor, isKnown, isFresh),
    promised.length && `It holds in each group of failing flights: ${promised.map(({ name }) => name).join("; ")}.`,
    monitor.n_early &&
      `${monitor.n_early} of the ${alphas.length} failures came within the first ${lead} s: no timely alert was possible, and each counts as a miss.`,
  ];
  const title = ["What is guaranteed ", guideLink("what-the-numbers-mean#what-is-promised-and-what-is-not", "the guarantee")];
  const list = h("ul", points.filter(Boolean).map((point) => h("li", point)));
  return panel(title, [h("p.promise", "P(no timely alert | the flight fails) ≤ epsilon"), list]);
}

function validity({ support }, isKnown, isFresh) {
  if (!support)
    return "Validity is not calibrated: Forewarn cannot tell whether a flight is like the training flights. Train the monitor again to calibrate it.";
  const { n_safe, n_unsafe, level } = support;
  return `Validity: INVALID withdraws the guarantee of a manoeuvre. At most ${percent(level)} of flights like ${isKnown ? "the simulated ones" : "those it was trained on"}, safe or failing, are called INVALID. Calibrated on ${count(n_safe)} safe and ${count(n_unsafe)} failing ${isFresh ? "fresh" : "held-out"} flights.`;
}

function details(monitor, { members }, catalog) {
  const memberWords = ({ lead, n_unsafe, recipe }) =>
    `${figure(lead)} s ahead: ${methodWords(catalog, recipe)}; alone calibrated on ${counted(n_unsafe, "failure")}`;
  const { dataset_id: dataset } = monitor;
  const origin = [
    ["File, SHA-256", monitor.digest, true],
    ["Dataset, SHA-256", monitor.dataset_digest, true],
    ["Program", monitor.version],
    ["Seed", monitor.seed ?? "not recorded"],
    ["Created", moment(monitor.created)],
    ["Dataset", dataset ? h("a", { href: `#/datasets/${dataset}` }, dataset) : "not stored here"],
    ["Sample interval", `${figure(monitor.dt)} s`],
    ...members.map((member, k) => [`Member ${k + 1}`, memberWords(member)]),
  ];
  const part = (title, content) => [h("h3", title), content];
  const recipe = recipeTable(catalog.recipes.monitor.schema, monitor.recipe, catalog);
  const test = recipeTable(testRecipe(catalog, monitor.dataset_recipe).schema, monitor.dataset_recipe, catalog);
  return [
    h(
      "div.columns.recipe-columns",
      h("div.stack-tight", part("Monitor", recipe), part("Origin", recipeList(origin))),
      h("div.stack-tight", part("Planned test", test)),
    ),
    rawRecipe({ ...monitor.recipe, dataset: monitor.dataset_recipe }),
  ];
}
