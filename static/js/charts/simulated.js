/**
 * The flights that a monitor was trained on, as charts show them behind a flight.
 *
 * createSimulated(api, monitor) -> Simulated, which asks the server once for each answer
 *   facts() -> Promise<facts>     of GET /monitors/{id}/simulated
 *   flights(x, y) -> Promise<{safe, unsafe, reason}>     [{x: [value], y: [value]}] of two channels, by key
 *     reason: why there are none, or ""
 * createSafeChoice(simulated, address, show) -> element     whether the band of the safe flights is shown; simulated null: never
 *     show(band | null, errors | null): see strip.js, with `shift` in place of starts: [s] from a time to the start, by
 *       what that time is of
 */

import { reason } from "../lib/api.js";
import { h, put } from "../lib/dom.js";
import { percent } from "../lib/numbers.js";

const MOST = 30; // flights of each outcome

export function createSimulated(api, monitor) {
  const answers = new Map();
  let known = null;

  const facts = () => (known ??= api.get(`/monitors/${encodeURIComponent(monitor)}/simulated`));

  function flights(x, y) {
    const pair = `${x} ${y}`;
    if (!answers.has(pair)) answers.set(pair, read(x, y));
    return answers.get(pair);
  }

  async function read(x, y) {
    const { dataset, reason } = await facts();
    if (dataset === null) return { safe: [], unsafe: [], reason };
    const wanted = [...new Set([x, y])].map((key) => `&channel=${encodeURIComponent(key)}`).join("");
    const of = (outcome) => api.get(`/datasets/${dataset}/rollouts?outcome=${outcome}&count=${MOST}${wanted}`);
    const [safe, unsafe] = await Promise.all(["safe", "unsafe"].map(of));
    const lines = (rollouts) => rollouts.map(({ telemetry }) => ({ x: telemetry[x], y: telemetry[y] }));
    return { safe: lines(safe), unsafe: lines(unsafe), reason: "" };
  }

  return { facts, flights };
}

const BAND = "band"; // name in the address

export function createSafeChoice(simulated, address, show) {
  const box = h("input", { type: "checkbox", checked: address.get(BAND) !== "off", onchange: choose });
  const note = h("p.hint");
  const element = h("div", h("label.row", box, "Band of simulated safe flights"), note);
  let facts = null;
  element.hidden = simulated === null;
  if (simulated !== null) simulated.facts().then(know, fail);
  address.follow(BAND, (text) => {
    box.checked = text !== "off";
    tell();
  });
  return element;

  function know(given) {
    facts = given;
    box.disabled = facts.band === null;
    put(note, noteOf(facts));
    tell();
  }

  function fail(error) {
    box.disabled = true;
    put(note, `It could not be read: ${reason(error)}`);
  }

  function choose() {
    address.set(BAND, box.checked ? null : "off");
    tell();
  }

  function tell() {
    if (facts === null) return;
    const { band, forecast, quantiles } = facts;
    const words = band && `${percents(quantiles)} of ${band.n_flights} simulated safe flights`;
    const shift = { onset: 0, trim: facts.lead_in, rollout: band?.onset };
    show(box.checked && band ? { ...band, shift, word: words } : null, forecast?.channels ?? null);
  }
}

const percents = ([low, high]) => `${percent(low, 0).replace(" %", "")} to ${percent(high, 0)}`;

function noteOf({ quantiles: [low, high], reason: why, band, band_reason: without, forecast, forecast_reason: alone }) {
  if (why) return `None: ${why}.`;
  const first = band ? "At each time from the detected start. A whole flight stays within it less often." : `None: ${without}.`;
  if (forecast === null) return `${first} No interval of the forecast: ${alone}.`;
  const rest = `Interval of the forecast: ${percent(high - low, 0)} of the samples of ${forecast.n_flights} safe flights held out, ${percent(forecast.covered, 0)} of failing ones.`;
  return `${first} ${rest}`;
}
