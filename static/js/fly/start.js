/**
 * Start a flight, or open one that is in progress or has ended.
 *
 * showFlightStart(element, {query, api, navigate}) -> {close()}
 *     query: kind, monitor, dataset, outcome, rollout, seed fill in the form (#/fly?monitor=3f9a)
 */

import { asksForToken, may, needs, reason } from "../lib/api.js";
import { demonstration } from "../lib/demonstration.js";
import { button, errorLine, h, link, put, state } from "../lib/dom.js";
import { jobList } from "../lib/job_progress.js";
import { canFly, createDisplayChoice, fittingMonitor, startFlight, warningLines, warningMark, warningsAt, warningWords } from "../lib/monitors.js";
import { leadSeconds, moment } from "../lib/numbers.js";
import { guarantee } from "./alarm_panel.js";
import { createLimitChoice } from "./flight_limits.js";
import { resultOf, staleText } from "./headline.js";
import { sourceText } from "./panels.js";

const REFRESH = 2000; // ms
const WAIT = 1.5; // intervals of the monitor that a sample waits for others by default
const SILENCE = 5000; // ms without an answer, after which the list may be out of date

export function showFlightStart(element, { query, api, navigate }) {
  const page = h("div", { class: "page" });
  element.replaceChildren(page);
  const heading = h("h1", { class: "visually-hidden" }, "Fly");
  page.append(heading, state("loading", "Looking for monitors and flights", "Asking the server."));
  let closed = false;
  let names = new Map();
  const flights = h("section", { class: "panel stack", "aria-label": "Flights" });
  const silent = h("p", { class: "error", role: "status", hidden: true });
  let heard = 0; // when the server answered last
  let asking = false;
  let training = { element: null, close: () => {} };

  async function load() {
    try {
      const [monitors, datasets, recordings] = await Promise.all([api.get("/monitors"), api.get("/datasets"), api.get("/recordings")]);
      names = new Map(monitors.map(({ id, name }) => [id, name]));
      await refresh();
      if (closed) return;
      training.close();
      if (monitors.length === 0) training = await jobList({ api, kind: "monitor", done: load });
      if (closed) return training.close();
      const start = monitors.length === 0 ? noMonitor(training.element, { api, load }) : startForm({ monitors, datasets, recordings, query, api, navigate });
      page.replaceChildren(h("div", { class: "columns start-columns" }, start, flights));
    } catch (error) {
      if (closed) return;
      const again = h("button", { type: "button", class: "button button-primary", onclick: load }, "Try again");
      page.replaceChildren(heading, state("error", "The server could not be read", reason(error), again));
    }
  }

  async function refresh() {
    const all = await api.get("/flights");
    if (closed) return;
    heard = performance.now();
    const signature = JSON.stringify(all.map((flight) => [flight.id, flight.progress, flight.open_alarms, resultOf(flight).words]));
    if (flights.dataset.signature !== signature) {
      flights.dataset.signature = signature;
      flights.replaceChildren(silent, ...flightLists(all, names));
    }
    for (const flight of all.filter(({ age }) => age !== null)) {
      const place = flights.querySelector(`[data-flight="${flight.id}"] .flight-stale`);
      if (place !== null) put(place, ageText(flight));
    }
  }

  /** One request at a time; a list that may be out of date is marked. */
  async function look() {
    const lost = heard > 0 && performance.now() - heard > SILENCE;
    if (lost && silent.hidden) {
      put(silent, `Not connected: this list is from ${new Date(Date.now() - SILENCE).toISOString().slice(11, 19)} UTC and may be out of date.`);
    }
    silent.hidden = !lost;
    flights.toggleAttribute("data-lost", lost);
    for (const was of flights.querySelectorAll(".under-way .was")) was.hidden = !lost;
    document.title = `${lost ? "◆ NOT CONNECTED – " : ""}Fly – Forewarn`;
    if (asking || heard === 0) return;
    asking = true;
    await refresh().catch(() => {});
    asking = false;
  }

  load();
  const timer = setInterval(look, REFRESH);
  return {
    close: () => {
      closed = true;
      training.close();
      clearInterval(timer);
    },
  };
}

/** The monitor in training, or how to get one; failed trainings below. */
function noMonitor(training, { api, load }) {
  if (training?.querySelector(".job")) return training;
  const failure = errorLine();
  const small = button("Train a small one now", prepare, { class: "button button-primary", ...needs("POST /demonstration") });
  const own = link("Train your own", "#/monitors/new");
  const none = state("empty", "No monitor yet", "A monitor assesses each flight. Train the small one of the demonstration, or one for your aircraft.", small, own, link("Watch a recording", "#/demonstration"));
  return h("div", { class: "stack" }, h("h1", { class: "visually-hidden" }, "Fly"), none, failure.element, training);

  async function prepare() {
    small.disabled = true;
    const train = () => demonstration.start(api).then(demonstration.ended);
    if (await failure.attempt(train)) load();
    small.disabled = false;
  }
}

function flightLists(all, names) {
  const running = all.filter(({ progress }) => progress === "running");
  const over = all.filter(({ progress }) => progress !== "running").slice(0, 30);
  const rows = [h("h2", {}, "In progress")];
  if (running.length === 0) rows.push(h("p", { class: "dim" }, "No flight in progress. Flights that you start appear here."));
  rows.push(h("ul", { class: "flight-list under-way" }, ...running.map((flight) => flightRow(flight, names, "Watch"))));
  rows.push(h("h2", {}, "Ended"));
  if (over.length === 0) rows.push(h("p", { class: "dim" }, "Ended flights and their records appear here."));
  rows.push(h("ul", { class: "flight-list" }, ...over.map((flight) => flightRow(flight, names, "Record"))));
  return rows;
}

function flightRow(flight, names, verb) {
  const source = sourceText(flight.source, flight.name);
  const { words, level } = resultOf(flight);
  const monitor = names.get(flight.monitor) ?? flight.monitor;
  const about = `${monitor} at ε ${flight.epsilon}, ${flight.created.slice(0, 16).replace("T", " ")} UTC`;
  return h(
    "li",
    { class: "flight-row", "data-flight": flight.id },
    h("span", { class: "chip mode", "data-mode": flight.mode }, flight.mode.toUpperCase()),
    h("span", { class: "chip", "data-level": level }, h("span", { class: "was", hidden: true }, "was "), words),
    h("span", { class: "flight-name" }, source.includes(flight.name) ? source : `${flight.name} (${source})`, h("span", { class: "dim flight-detail" }, about), h("span", { class: "flight-stale flight-detail" }, ageText(flight)), warningMark(flight)),
    h("a", { class: "button button-small", href: `#/fly/${flight.id}`, "aria-label": `${verb}: ${flight.name}` }, verb),
  );
}

function ageText({ status, beside, state, reason: why, age }) {
  const isStale = age !== null && [status, ...beside].includes("stale");
  return isStale ? staleText(state === "stale" ? why : "", age) : "";
}

function startForm({ monitors, datasets, recordings, query, api, navigate }) {
  const monitor = select("monitor", monitors.map(({ id, name, lead, n_unsafe: failures, warnings }) => [id, `${name} (${lead} s ahead, ${failures} failures) ${warningWords({ warnings })}`]), query.get("monitor"));
  const epsilon = h("input", { id: "epsilon", type: "number", step: "any", min: 0, max: 1 });
  const served = h("p", { class: "hint" });
  const kind = radios("kind", [["simulated", "Simulated"], ["replay", "Replay"], ["live", "Live"]], query.get("kind") ?? (query.get("dataset") ? "replay" : "simulated"));
  const outcome = select("outcome", [["unsafe", "exceeds its limit"], ["safe", "stays within its limit"], ["any", "random"]], query.get("outcome"));
  const seed = h("input", { id: "seed", type: "number", min: 0, step: 1, value: query.get("seed") ?? 1, required: true });
  const dataset = select("dataset", datasets.map(({ id, name, n_unsafe: unsafe, n_safe: safe, created }) => [id, `${name} (${moment(created)}, ${unsafe} unsafe, ${safe} safe)`]), query.get("dataset"));
  const rollout = h("input", { id: "rollout", type: "number", min: 0, step: 1, value: query.get("rollout") ?? 0, required: true });
  const range = h("p", { class: "hint" });
  const none = h("p", { class: "error" }, "No stored dataset has this monitor's sample interval: fly a simulation, or make a dataset.");
  const simulated = h("div", { class: "stack" }, field("Seed", seed, h("p", { class: "hint" }, "Same seed, same flight.")));
  const replayed = h("div", { class: "stack" }, field("Dataset", dataset), field("Rollout", rollout, range), none);
  const live = createLiveFields(recordings);
  const failure = errorLine();
  const warnings = h("div");
  const go = h("button", { class: "button button-primary" }, "Start the flight");
  const chosen = () => monitors.find(({ id }) => id === monitor.value);
  const display = createDisplayChoice(monitors);
  const limits = createLimitChoice(api, "the monitor's own");
  limits.ready.then((n) => {
    limits.element.hidden = n === 0 && !may("POST /limit-sets");
  });
  let epsilonOf = "";
  let warned = ""; // the monitor and the epsilon of the warnings
  let kindOf = ""; // the kind that the preselected monitor fits
  let byHand = query.has("monitor");
  const fits = { simulated: canFly, replay: ({ dt }) => datasets.some((data) => sameInterval(data.dt, dt)), live: () => true };
  monitor.addEventListener("input", () => {
    byHand = true;
  });

  function adapt() {
    if (!byHand && kind.value !== kindOf) monitor.value = fittingMonitor(monitors, fits[kind.value]).id;
    kindOf = kind.value;
    const now = chosen();
    if (epsilonOf !== now.id) epsilon.value = now.epsilon;
    epsilonOf = now.id;
    warn(now);
    display.adapt(now);
    const least = Number(now.smallest_epsilon.toPrecision(3));
    const promise = epsilon.value >= now.smallest_epsilon ? guarantee({ epsilon: Number(epsilon.value), lead: now.lead, guarantee: now.recipe.guarantee }) : "";
    put(served, `Calibrated on ${now.n_unsafe} failures, enough for ε ≥ ${least}. ${promise}`);
    const replay = kind.value === "replay";
    const isLive = kind.value === "live";
    live.element.hidden = !isLive;
    outcomes.hidden = outcome.disabled = isLive;
    live.adapt(now);
    simulated.hidden = seed.disabled = replay || isLive;
    replayed.hidden = dataset.disabled = rollout.disabled = !replay;
    for (const option of outcome.options) option.disabled = option.hidden = replay && option.value === "any";
    if (replay && outcome.value === "any") outcome.value = "unsafe";
    for (const option of dataset.options) {
      const { dt } = datasets.find(({ id }) => id === option.value);
      option.disabled = !sameInterval(dt, now.dt);
    }
    if (dataset.selectedOptions[0]?.disabled) dataset.value = [...dataset.options].find((option) => !option.disabled)?.value ?? "";
    const data = datasets.find(({ id }) => id === dataset.value);
    none.hidden = data !== undefined;
    go.disabled = replay && data === undefined;
    if (data === undefined) return;
    const count = outcome.value === "safe" ? data.n_safe : data.n_unsafe;
    rollout.max = Math.max(0, count - 1);
    put(range, `0 to ${count - 1} (${outcome.value} rollouts).`);
  }

  /** Warnings depend on epsilon: those at the typed one. */
  async function warn(now) {
    const typed = Number(epsilon.value);
    const pair = `${now.id} ${typed}`;
    if (pair === warned) return;
    warned = pair;
    const current = await warningsAt(api, now, [typed]);
    if (pair === warned) warnings.replaceChildren(...warningLines(current));
  }

  async function start(event) {
    event.preventDefault();
    const sources = {
      live: live.source,
      replay: () => ({ kind: "replay", dataset: dataset.value, outcome: outcome.value, rollout: Number(rollout.value) }),
      simulated: () => ({ kind: "simulated", seed: Number(seed.value), outcome: outcome.value }),
    };
    const request = { source: sources[kind.value](), monitor: monitor.value, monitors: display.chosen(), ...limits.chosen(), epsilon: Number(epsilon.value) };
    go.disabled = true;
    await failure.attempt(() => startFlight({ api, navigate }, request));
    go.disabled = false;
  }

  const outcomes = field("Outcome", outcome);
  const form = h(
    "form",
    { class: "panel form", novalidate: true, onsubmit: start, onchange: adapt, oninput: adapt, "aria-label": "Start a flight", ...needs("POST /flights"), "data-keeps-input": true },
    h("h1", {}, "Start a flight"),
    field("Monitor", monitor, warnings),
    display.element,
    limits.element,
    h("div", { class: "field" },
      h("fieldset", { class: "source-choice" }, h("legend", {}, "Source"), kind.labels),
      h("p", { class: "hint" }, "A new simulation, a stored rollout, or live samples. To replay a recording, open it on the ", h("a", { href: "#/recordings" }, "Recordings page"), ".")),
    outcomes,
    simulated,
    replayed,
    live.element,
    field("ε, accepted miss rate", epsilon, served),
    h("div", { class: "row" }, go),
    failure.element,
  );
  adapt();
  return form;
}

/** Settings of a live flight beside its monitor; all are optional. */
function createLiveFields(recordings) {
  const mapping = select("mapping", [["", "Forewarn's names, SI units"], ...recordings.map(({ id, name }) => [id, `as ${name}`])]);
  const trim = select("trim", [["detected", "measured at rest before each manoeuvre"], ["none", "samples are deviations from trim already"]]);
  const delay = h("input", { id: "delay", type: "number", min: 0, step: "any" });
  const waits = h("p", { class: "hint" });
  const udp = select("udp", [["any", "any free port"], ["none", "none"], ["port", "this port"]], asksForToken() ? "none" : "any");
  const port = h("input", { id: "port", type: "number", min: 1024, max: 65_535, step: 1, value: 9870, "aria-label": "UDP port" });
  const unguarded = h("p", { class: "hint" }, "Datagrams carry no token: anyone who reaches the port can send.");
  const optional = h(
    "details",
    {},
    h("summary", {}, "Channels, trim, delay, UDP"),
    h("div", { class: "stack" },
      field("Channels", mapping, h("p", { class: "hint" }, "Names, units and signs: Forewarn's, or those of a recording's mapping.")),
      field("Trim", trim),
      field("Longest wait for a sample [s]", delay, waits),
      field("UDP datagrams", udp, port, unguarded)),
  );
  const element = h("div", { class: "stack" }, h("p", { class: "hint" }, "The flight waits for its first sample and shows where to send it."), optional);

  function adapt({ dt, lead }) {
    delay.placeholder = String(Number((WAIT * dt).toFixed(4)));
    const wait = delay.value === "" ? WAIT * dt : Number(delay.value);
    put(waits, `For late samples and samples out of order. Subtracted from the lead time: alerts warn ${leadSeconds(lead - wait)} s ahead.`);
    port.hidden = port.disabled = udp.value !== "port";
    unguarded.hidden = udp.value === "none";
  }

  return {
    element,
    adapt,
    source: () => ({
      kind: "live",
      trim: trim.value,
      ...(mapping.value && { recording: mapping.value }),
      ...(delay.value !== "" && { delay: Number(delay.value) }),
      ...(udp.value !== "none" && { udp: udp.value === "any" ? 0 : Number(port.value) }),
    }),
  };
}

function sameInterval(a, b) {
  return Math.abs(a - b) <= 1e-9;
}

function field(label, control, ...notes) {
  return h("div", { class: "field" }, h("label", { for: control.id }, label), control, ...notes);
}

function select(id, choices, chosen) {
  const control = h("select", { id });
  for (const [value, text] of choices) control.append(h("option", { value }, text));
  if (choices.some(([value]) => value === chosen)) control.value = chosen;
  return control;
}

/** Returns {labels, value}. */
function radios(name, choices, chosen) {
  const known = choices.some(([value]) => value === chosen) ? chosen : choices[0][0];
  const inputs = choices.map(([value]) => h("input", { type: "radio", name, value, checked: value === known }));
  return {
    labels: inputs.map((input, k) => h("label", {}, input, choices[k][1])),
    get value() {
      return inputs.find(({ checked }) => checked).value;
    },
  };
}
