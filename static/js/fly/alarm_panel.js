/**
 * The alarm line: a warning stays, seen and heard, until someone acknowledges it, and so does, in amber and
 * heard once, a caution. Warnings come before cautions, and an acknowledgement is of those that are shown.
 *
 * While no alarm is open it says the guarantee, what the monitor's test flights say against it, or that it is withdrawn; its height is the same either way, so that
 * the strips do not move at the very moment they are looked at.
 *
 * Exports
 *   createAlarmPanel(element, {tone, acknowledge}) -> AlarmPanel
 *     acknowledge(alarm) -> Promise    tells the server; the alarm comes back acknowledged
 *   guarantee({epsilon, lead, guarantee}) -> string
 *
 * AlarmPanel
 *   describe({epsilon, alertAbove, guarantee, lead, warnings, limits, channels})   warnings: of the monitor; limits: nodes, |N_y| 0.5 g; of the flight
 *   setState({state, reason, last})    of the newest assessment: whether the guarantee stands; last: the reason of its sample
 *   take(alarm)          raised or acknowledged
 *   setStale(words)      why the newest sample is not of now and how old it is; empty where it is of now
 *   setHeadline({status, beside})   of the flight: what goes on after it was acknowledged
 *   setLinked(boolean)   false: nobody knows whether there are new alarms
 *   acknowledgeAll()     all open warnings; all open cautions where there are none
 *   open()               how many warnings wait
 *   alert()              the newest alert of a risk that waits, as it was raised, or null
 *   close()              silence
 */

import { shownState, symbolNodes } from "../charts/readout.js";
import { reason } from "../lib/api.js";
import { h, put } from "../lib/dom.js";
import { needs } from "../lib/me.js";
import { sentence } from "../lib/monitor_warnings.js";
import { figure, leadSeconds, riskText } from "../lib/numbers.js";
import { magnitudeIn, quantity } from "../lib/units.js";
import { errorLine } from "../lib/view_states.js";
import { CAUTION_WORDS, cautionText, waitingOf } from "./panels.js";

const GOES_ON = {
  exceeding: "LIMIT EXCEEDED, it continues, acknowledged",
  risk: "ALERT continues, acknowledged",
};

const PROMISED = {
  average: "on average over calibration sets",
  "95%": "with 95 % confidence in this monitor",
};

export function guarantee({ epsilon, lead, guarantee: kept = "average" }) {
  const share = `${Number((100 * epsilon).toPrecision(3))} %`;
  return (
    `Of flights that fail, at most ${share} get no alert at least ${leadSeconds(lead)} s ahead, ` +
    `${PROMISED[kept]}, for flights drawn like the simulated ones. ` +
    "Risk is not the probability of failure."
  );
}

export function createAlarmPanel(element, { tone, acknowledge }) {
  element.classList.add("alarm-panel");
  const text = h("span", { class: "alarm-text" });
  const button = h("button", { type: "button", class: "button", title: "Acknowledge (key K)", onclick: acknowledgeAll, ...needs("POST /flights/{}/alarms/{}/acknowledge") }, "Acknowledge [K]");
  const banner = h("div", { class: "alarm-banner", role: "alert", hidden: true }, text, button);
  const quiet = h("strong", {}, "No alarm waits. ");
  const promise = h("span", {});
  const calm = h("p", { class: "alarm-calm" }, quiet, promise);
  const failure = errorLine();
  element.append(banner, calm, failure.element);
  const alarms = new Map();
  let flight = { epsilon: NaN, alertAbove: NaN, lead: 0, warnings: [], limits: [], channels: [] };
  let assessment = { state: null, reason: "" };
  let status = "";
  let holds = []; // what the headline and what stands beside it say
  let shown = "";
  let stale = "";

  const waiting = () => waitingOf([...alarms.values()]);
  const heard = new Set(); // cautions

  function render() {
    put(promise, promised());
    calm.toggleAttribute("data-warned", flight.warnings.length > 0);
    const { warnings, cautions } = waiting();
    const open = warnings.length > 0 ? warnings : cautions;
    const latest = open.findLast(({ kind }) => kind === "limit") ?? open.at(-1); // what is measured comes first
    const held = latest === undefined && status in GOES_ON;
    element.dataset.open = String(warnings.length);
    banner.dataset.level = open === cautions && !held ? "caution" : "alert";
    banner.hidden = latest === undefined && !held;
    calm.hidden = !banner.hidden;
    banner.toggleAttribute("data-acknowledged", held);
    button.hidden = held;
    const alike = open.filter(({ kind }) => kind === latest?.kind);
    const now = `${alike.map(({ number }) => number)} of ${open.length} ${latest?.kind === "stale" ? stale : ""}`;
    if (latest === undefined) put(text, held ? GOES_ON[status] : "");
    else if (now !== shown) text.replaceChildren(...words(alike, open.length - alike.length));
    shown = now;
    if (warnings.length > 0) tone.start();
    else tone.stop();
    if (warnings.length === 0 && cautions.some(({ number }) => !heard.has(number))) {
      for (const { number } of cautions) heard.add(number);
      tone.caution();
    }
  }

  function promised() {
    const state = shownState(assessment);
    const wasBetween = shownState({ state: "invalid", cause: assessment.last }) === "not_assessed";
    if (holds.includes("invalid") && state === "stale" && !wasBetween)
      return "The guarantee is withdrawn: the monitor was not applicable to the last sample.";
    if (state === "not_assessed" || (holds.includes("invalid") && wasBetween)) return "No guarantee between manoeuvres: nothing is assessed there.";
    if (state === "invalid") return `The guarantee is withdrawn: ${assessment.reason || "the monitor is not applicable here"}`;
    if (state === "stale") return "No guarantee while no sample of now comes: nothing is assessed.";
    return flight.warnings.length ? `◆ ${flight.warnings.map(sentence).join(" ")}` : guarantee(flight);
  }

  /** Of the first of several of a kind, as the headline says it too; `others` wait beside them. */
  function words(alike, others) {
    const first = alike.reduce((one, next) => (next.t < one.t ? next : one));
    const { t, p_value: risk, kind, exceedance } = first;
    const value = risk === null ? "" : ` ${riskText(risk, flight.alertAbove)}`;
    const at = alike.length > 1 ? `first at ${t.toFixed(2)} s, ${alike.length} alarms` : `at ${t.toFixed(2)} s`;
    const more = others > 0 ? `, ${others} more` : "";
    const goesOn = kind === "stale" && stale !== "" ? { reason: stale } : {};
    if (kind in CAUTION_WORDS) return [`${cautionText({ ...first, ...goesOn }, ` ${at}`)}${more}`];
    if (kind === "limit") return [`LIMIT EXCEEDED ${at}: `, ...measured(exceedance), more];
    const lead = leadSeconds(flight.lead);
    const what = `ALERT ${at}: risk${value} > ${figure(flight.alertAbove)}, warns ${lead} s before `;
    return [what, ...flight.limits.map((node) => node.cloneNode(true)), more];
  }

  function measured({ channel, value, limit, judged }) {
    const measured = flight.channels.find(({ key }) => key === channel);
    const which = judged === "recorded" ? " as recorded, bias and trim included" : "";
    return [
      ...symbolNodes(measured.symbol),
      ` ${quantity(measured, value)}${which}, limit ${magnitudeIn(measured, limit)}`,
    ];
  }

  async function acknowledgeAll() {
    failure.show("");
    try {
      const { warnings, cautions } = waiting();
      for (const alarm of warnings.length > 0 ? warnings : cautions) take(await acknowledge(alarm));
    } catch (error) {
      failure.show(`Not acknowledged. ${reason(error)}`);
    }
  }

  function take(alarm) {
    const known = alarms.get(alarm.number);
    if (known?.acknowledged && !alarm.acknowledged) return;
    alarms.set(alarm.number, alarm);
    while (alarms.size > 200) alarms.delete(alarms.keys().next().value);
    render();
  }

  return {
    describe: (given) => {
      flight = given;
      shown = "";
      render();
    },
    setState: (now) => {
      assessment = now;
      render();
    },
    setLinked: (linked) => put(quiet, linked ? "No alarm waits. " : "◆ Not connected: new alarms are not known. "),
    take,
    setStale: (words) => {
      if (words === stale) return;
      stale = words;
      render();
    },
    setHeadline: (now) => {
      const next = [now.status, ...now.beside];
      if (next.join() === holds.join()) return;
      [status, holds] = [now.status, next];
      render();
    },
    acknowledgeAll,
    open: () => waiting().warnings.length,
    alert: () => waiting().warnings.findLast(({ kind }) => kind === "risk") ?? null,
    close: () => tone.stop(),
  };
}
