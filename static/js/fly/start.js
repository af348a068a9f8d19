/**
 * Start a flight, or open one that is in progress or has ended.
 *
 * showFlightStart(element, {query, api, navigate}) -> {close()}
 *     query: kind, monitor or set, epsilon, outcome, seed fill in the form (#/fly?monitor=3f9a)
 */

import { createForm, fold, labelled, numberInput, radioGroup, select } from "../forms/controls.js";
import { asksForToken, may } from "../lib/api.js";
import { isSimulated } from "../lib/catalog.js";
import { chip, empty, h, link, loadingView, put } from "../lib/dom.js";
import { jobList } from "../lib/job_progress.js";
import { createLongList } from "../lib/long_list.js";
import { createDisplayChoice, fittingMonitor, startFlight, warningLines, warningMark, warningsAt, warningWords } from "../lib/monitors.js";
import { counted, leadSeconds, moment } from "../lib/numbers.js";
import { lastCheck, worstOf } from "../lib/session_check.js";
import { watching } from "../lib/watching.js";
import { guarantee } from "./alarms/alarm_panel.js";
import { createLimitChoice } from "./flight_limits.js";
import { resultOf, staleText } from "./headline.js";
import { sourceText } from "./panels.js";

const OLDER = 500; // ms between words of the age of a stale flight
const LISTED = 30; // ended flights
const OVER = "/flights?progress=ended&progress=failed&progress=interrupted";
const WAIT = 1.5; // intervals of the monitor that a sample waits for others by default
const KINDS = [["simulated", "Simulated"], ["live", "Live"]];

export function showFlightStart(element, { query, api, navigate }) {
  const loads = ["/monitors", "/monitor-sets", "/recordings?limit=200"];
  return loadingView(element, { title: "Fly", text: "Looking for monitors and flights", loads, build });

  async function build({ keep, again }, monitors, sets, recordings) {
    const list = createFlightList(api, monitors);
    await list.load();
    keep(watching(list.element, { flights_in_progress: list.loadRunning, flights: list.load }));
    keep(list);
    const training = monitors.length === 0 ? keep(await jobList({ api, kind: "monitor", done: again })) : null;
    const start = training ? noMonitor(training.element) : startForm({ monitors, sets, recordings, query, api, navigate });
    return h("div.page", h("div.columns.start-columns", start, list.element));
  }
}

/** The monitor in training, or how to get one; failed trainings below. */
function noMonitor(training) {
  if (training?.querySelector(".job")) return training;
  const none = empty("No monitor yet", "A monitor assesses each flight. Train one for your aircraft, or watch a recorded flight.", link("Train a monitor", "#/monitors/new", true), link("Watch a recording", "#/demonstration"));
  return h("div.stack", h("h1.visually-hidden", "Fly"), none, training);
}

function createFlightList(api, monitors) {
  const names = new Map(monitors.map(({ id, name }) => [id, name]));
  const running = h("ul.flight-list.under-way");
  const ended = h("ul.flight-list");
  const list = createLongList({ api, path: OVER, search: "Search ended flights by name or monitor", step: LISTED, show: showEnded });
  const element = h("section.panel.stack", { "aria-label": "Flights" }, h("h2", "In progress"), running, h("h2", "Ended"), list.box, ended, list.more);
  const shown = new Map(); // what each part shows now
  let stale = []; // flights
  let answered = 0;
  const timer = setInterval(showAges, OLDER);
  return { element, load, loadRunning, close: () => clearInterval(timer) };

  async function load() {
    await Promise.all([loadRunning(), list.load()]);
  }

  async function loadRunning() {
    const flights = await api.get("/flights?progress=running&limit=1000");
    [stale, answered] = [flights.filter(({ age }) => age !== null), performance.now()];
    show(running, flights, "Watch", "No flight in progress. Flights that you start appear here.");
    showAges();
  }

  function showAges() {
    if (element.hasAttribute("data-lost")) return;
    for (const flight of stale) {
      const place = running.querySelector(`[data-flight="${flight.id}"] .flight-stale`);
      const age = flight.age + (performance.now() - answered) / 1000;
      if (place !== null) put(place, ageText({ ...flight, age }));
    }
  }

  function showEnded(flights, text) {
    show(ended, flights, "Record", text ? `No ended flight has “${text}” in its name, or in that of its monitor or monitor set.` : "Ended flights and their records appear here.");
  }

  function show(part, flights, verb, none) {
    const signature = JSON.stringify([none, ...flights.map((flight) => [flight.id, flight.progress, flight.open_alarms, resultOf(flight).words])]);
    if (signature !== shown.get(part)) part.replaceChildren(...rows(flights, verb, none));
    shown.set(part, signature);
  }

  function rows(flights, verb, none) {
    return flights.length ? flights.map((flight) => flightRow(flight, names, verb)) : [h("li.dim", none)];
  }
}

function flightRow(flight, names, verb) {
  const source = sourceText(flight.source, flight.name);
  const { words, level } = resultOf(flight);
  const monitor = `${names.get(flight.monitor) ?? flight.monitor} at ε ${flight.epsilon}`;
  const about = `${flight.monitor_set ? `monitor set ${flight.monitor_set.name}` : monitor}, ${flight.created.slice(0, 16).replace("T", " ")} UTC`;
  return h(
    "li",
    { class: "flight-row", "data-flight": flight.id },
    h("span", { class: "chip mode", "data-mode": flight.mode }, flight.mode.toUpperCase()),
    chip(words, level),
    h("span", { class: "flight-name" }, source.includes(flight.name) ? source : `${flight.name} (${source})`, h("span", { class: "dim flight-detail" }, about), h("span", { class: "flight-stale flight-detail" }, ageText(flight)), warningMark(flight)),
    h("a", { class: "button button-small", href: `#/fly/${flight.id}`, "aria-label": `${verb}: ${flight.name}` }, verb),
  );
}

function ageText({ status, beside, state, reason: why, age }) {
  const isStale = age !== null && [status, ...beside].includes("stale");
  return isStale ? staleText(state === "stale" ? why : "", age) : "";
}

function startForm({ monitors, sets, recordings, query, api, navigate }) {
  const setOptions = sets.map(({ id, name, cases }) => h("option", { value: id }, `${name} (${counted(cases.length, "condition")})`));
  const monitor = select(
    [
      ...monitors.map(({ id, name, lead, n_unsafe: failures, warnings }) => [id, `${name} (${lead} s ahead, ${counted(failures, "failure")}) ${warningWords({ warnings })}`]),
      sets.length > 0 && h("optgroup", { label: "Monitor sets" }, setOptions),
    ],
    { id: "monitor", value: query.get("set") ?? query.get("monitor"), oninput: () => (byHand = true) },
  );
  const epsilon = numberInput({ min: 0, max: 1, value: query.get("epsilon") });
  const served = h("span");
  const own = monitors.some((each) => each.id === query.get("monitor") && !isSimulated(each));
  const asked = query.get("kind") ?? (own ? "live" : "simulated");
  const kind = radioGroup({ name: "kind", ways: KINDS, value: asked === "live" ? asked : "simulated", label: "Source" });
  const outcome = select([["unsafe", "exceeds its limit"], ["safe", "stays within its limit"], ["any", "random"]], { value: query.get("outcome") });
  const seed = numberInput({ min: 0, step: 1, value: query.get("seed") ?? 1 });
  const simulated = h("div.stack", labelled("Outcome", outcome).element, labelled("Seed", seed, { hint: "Same seed, same flight." }).element);
  const live = createLiveFields(recordings);
  const warnings = h("div");
  const chosenSet = () => sets.find(({ id }) => id === monitor.value);
  const members = () => (chosenSet()?.cases ?? [{ monitor: monitor.value }]).map((each) => monitors.find(({ id }) => id === each.monitor));
  const promised = labelled("ε, accepted miss rate", epsilon, { hint: served }).element;
  const display = createDisplayChoice(monitors);
  const limits = createLimitChoice(api, "the monitor's own");
  let hasLimits = may("POST /limit-sets");
  limits.ready.then((n) => {
    hasLimits ||= n > 0;
    adapt();
  });
  let epsilonOf = query.has("epsilon") ? query.get("monitor") : "";
  let warned = ""; // the monitor and the epsilon of the warnings
  let kindOf = ""; // the kind that the preselected monitor fits
  let byHand = query.has("monitor") || query.has("set");
  const fits = { simulated: isSimulated, live: () => true };
  const pages = [["Recordings", "#/recordings"], ["Datasets", "#/datasets"]].map(([name, href]) => h("a", { href }, name));
  const { element, form } = createForm({
    title: "Start a flight",
    word: "Start the flight",
    route: "POST /flights",
    classes: "panel form",
    content: [
      h("h1", "Start a flight"),
      checkLine(),
      labelled("Monitor", monitor).element,
      warnings,
      display.element,
      limits.element,
      h("fieldset", h("legend", "Source"), kind.element, h("p.hint", "A new simulation, or live samples. Recordings and rollouts are replayed from the pages ", pages[0], " and ", pages[1], ".")),
      simulated,
      live.element,
      promised,
    ],
    send: () => startFlight({ api, navigate }, request()),
  });
  for (const event of ["input", "change"]) form.addEventListener(event, adapt);
  adapt();
  return element;

  function adapt() {
    const shown = kind.value();
    if (!byHand && shown !== kindOf) monitor.value = fittingMonitor(monitors, fits[shown]).id;
    kindOf = shown;
    const [now] = members();
    const isSet = chosenSet() !== undefined;
    if (epsilonOf !== now.id) epsilon.value = now.epsilon;
    epsilonOf = now.id;
    warn(now);
    display.adapt(now);
    promised.hidden = isSet;
    if (isSet) display.element.hidden = true;
    limits.adapt(isSet);
    limits.element.hidden = !isSet && !hasLimits;
    const least = Number(now.smallest_epsilon.toPrecision(3));
    const promise = epsilon.value >= now.smallest_epsilon ? guarantee({ epsilon: Number(epsilon.value), lead: now.lead, guarantee: now.recipe.guarantee }) : "";
    put(served, `Calibrated on ${now.n_unsafe} failures, enough for ε ≥ ${least}. ${promise}`);
    live.element.hidden = shown !== "live";
    simulated.hidden = shown === "live";
    live.adapt(now);
  }

  /** Warnings depend on epsilon: those at the typed one. */
  async function warn(now) {
    if (chosenSet()) {
      warned = "";
      warnings.replaceChildren(...warningLines({ warnings: [...new Set(members().flatMap((each) => each.warnings))] }));
      return;
    }
    const typed = Number(epsilon.value);
    const pair = `${now.id} ${typed}`;
    if (pair === warned) return;
    warned = pair;
    const current = await warningsAt(api, now, [typed]);
    if (pair === warned) warnings.replaceChildren(...warningLines(current));
  }

  function request() {
    const source = kind.value() === "live" ? live.source() : { kind: "simulated", seed: Number(seed.value), outcome: outcome.value };
    if (chosenSet()) return { source, monitor_set: monitor.value, ...limits.chosen() };
    return { source, monitor: monitor.value, monitors: display.chosen(), ...limits.chosen(), epsilon: Number(epsilon.value) };
  }
}

/** The last session check of this browser, and the way to it. */
function checkLine() {
  const check = lastCheck();
  const worst = check && worstOf(check);
  const words = check === null ? "not done in this browser today" : `${worst === "passed" ? "passed" : worst === "failed" ? "FAILED" : "not complete"}, ${moment(check.at)}`;
  return h("p.check-line", { "data-level": worst === "passed" ? "ok" : "caution" }, `Session check: ${words}. `, h("a", { href: "#/fly/check" }, check === null ? "Do it" : "See it"));
}

/** Settings of a live flight beside its monitor; all are optional. */
function createLiveFields(recordings) {
  const mapped = recordings.filter(({ mapping_state: state }) => state !== "proposed");
  const mapping = select([["", "Forewarn's names, SI units"], ...mapped.map(({ id, name }) => [id, `as ${name}`])]);
  const trim = select([["detected", "measured at rest before each manoeuvre"], ["none", "samples are deviations from trim already"]]);
  const delay = numberInput({ min: 0 });
  const waits = h("span");
  const udp = select([["any", "any free port"], ["none", "none"], ["port", "this port"]], { value: asksForToken() ? "none" : "any" });
  const port = numberInput({ min: 1024, max: 65_535, step: 1, value: 9870, "aria-label": "UDP port" });
  const unguarded = h("span", "Datagrams carry no token: anyone who reaches the port can send.");
  const fields = [
    labelled("Channels", mapping, { hint: "Names, units and signs: Forewarn's, or those of a recording's confirmed mapping." }),
    labelled("Trim", trim),
    labelled("Longest wait for a sample", delay, { unit: "s", hint: waits }),
    labelled("UDP datagrams", udp, { hint: unguarded }),
  ];
  udp.after(port);
  const optional = fold("Channels, trim, delay, UDP", h("div.stack", fields.map((field) => field.element)));
  const element = h("div.stack", h("p.hint", "The flight waits for its first sample and shows where to send it."), optional);

  function adapt({ dt, lead }) {
    delay.placeholder = String(Number((WAIT * dt).toFixed(4)));
    const wait = delay.value === "" ? WAIT * dt : Number(delay.value);
    put(waits, `For late samples and samples out of order. Subtracted from the lead time: alerts warn ${leadSeconds(lead - wait)} s ahead.`);
    port.hidden = udp.value !== "port";
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
