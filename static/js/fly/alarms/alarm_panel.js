/**
 * The alarm line. A warning stays on screen and sounds until someone acknowledges it; a caution stays too, in
 * amber, and sounds once. Warnings come before cautions; an acknowledgement covers the alarms that are shown.
 *
 * Without an open alarm the line shows the guarantee, the monitor's warnings, or that the guarantee is withdrawn.
 * Its height is the same either way, so that the strips do not move when an alarm comes.
 *
 * createAlarmPanel(element, {tone, acknowledge(alarm) -> Promise of the acknowledged alarm}) -> AlarmPanel
 *   show({flight, assessment, stale, headline, doubts, isLinked})     what has changed
 *     flight: {epsilon, alertAbove, guarantee, lead, warnings, limits, channels}; limits: the monitor's own, in words;
 *       empty where none is known
 *     assessment: {state, reason, cause, last}, the newest; last: cause of the newest sample
 *     stale: why and by how much the newest sample is stale; empty where it is current
 *     headline: {status, beside, exceeded_t}; an acknowledged condition may continue
 *     doubts: why the newest samples are in doubt; empty where that is not known.   isLinked: false: new alarms cannot arrive
 *   onAlarm(alarm)       raised or acknowledged
 *   acknowledgeAll()     all open warnings; all open cautions where there are none
 *   open()               number of unacknowledged warnings
 */

import { needs, reason } from "../../lib/api.js";
import { secondsText } from "../../lib/clock.js";
import { errorLine, formatted, h, put } from "../../lib/dom.js";
import { sentence } from "../../lib/monitors.js";
import { counted, figure, leadSeconds, magnitudeIn, quantity, riskText } from "../../lib/numbers.js";
import { shownState } from "../../lib/states.js";
import { exceededAt } from "../headline.js";
import { CAUTION_WORDS, cautionText, waitingOf } from "../panels.js";

const GOES_ON = {
  exceeding: "LIMIT EXCEEDED continues, acknowledged",
  risk: "ALERT continues, acknowledged",
  caution: "CAUTION continues, acknowledged",
};

const PROMISED = {
  average: "on average over calibration sets",
  "95%": "with 95 % confidence in this monitor",
};

export function guarantee({ epsilon, lead, guarantee: kind = "average" }) {
  const share = `${Number((100 * epsilon).toPrecision(3))} %`;
  return (
    `At most ${share} of failing flights get no alert at least ${leadSeconds(lead)} s ahead, ` +
    `${PROMISED[kind]}, for flights drawn like the simulated ones. ` +
    "Risk is not the probability of failure."
  );
}

export function createAlarmPanel(element, { tone, acknowledge }) {
  element.classList.add("alarm-panel");
  const text = h("span", { class: "alarm-text" });
  const button = h("button", { type: "button", class: "button", title: "Acknowledge (key K)", onclick: acknowledgeAll, ...needs("POST /flights/{}/alarms/{}/acknowledge") }, "Acknowledge [K]");
  const banner = h("div", { class: "alarm-banner", role: "alert", hidden: true }, text, button);
  const quiet = h("strong", {}, "◆ Alarms not known yet. ");
  const promise = h("span", {});
  const calm = h("p", { class: "alarm-calm" }, quiet, promise);
  const failure = errorLine();
  element.append(banner, calm, failure.element);
  const alarms = new Map();
  const now = {
    flight: { epsilon: NaN, alertAbove: NaN, lead: 0, warnings: [], limits: "", channels: [] },
    assessment: { state: null, reason: "", cause: null },
    headline: /** @type {any} */ ({ status: "", beside: [] }),
    stale: "",
    doubts: [],
    isLinked: true,
  };
  let shown = "";

  /** The first exceedance, in words. */
  const exceeded = () => exceededAt(now.headline);
  const waiting = () => waitingOf([...alarms.values()]);
  const heard = new Set(); // cautions

  function render() {
    put(promise, promised());
    put(quiet, quietWords());
    const { status } = now.headline;
    calm.toggleAttribute("data-warned", now.flight.warnings.length > 0 || exceeded() !== "");
    const { warnings, cautions } = waiting();
    const open = warnings.length > 0 ? warnings : cautions;
    const latest = open.findLast(({ kind }) => kind === "limit") ?? open.at(-1); // a measured exceedance comes first
    const held = latest === undefined && status in GOES_ON;
    element.dataset.open = String(warnings.length);
    banner.dataset.level = (held ? status === "caution" : open === cautions) ? "caution" : "alert";
    banner.hidden = latest === undefined && !held;
    calm.hidden = !banner.hidden;
    banner.toggleAttribute("data-acknowledged", held);
    button.hidden = held;
    const alike = open.filter(({ kind }) => kind === latest?.kind);
    const { reason: present = "" } = presentCause(latest?.kind);
    const about = `${alike.map(({ number }) => number)} of ${open.length} ${latest?.kind === "stale" ? now.stale : present.replace(/[\d.]+/g, "")}`;
    const why = status === "caution" ? `: ${now.doubts.join("; ") || "the samples are in doubt"}` : "";
    if (latest === undefined) put(text, held ? GOES_ON[status] + why : "");
    else if (about !== shown) text.replaceChildren(formatted(words(alike, open.length - alike.length)));
    shown = about;
    if (warnings.length > 0) tone.start(latest.kind === "limit" ? "limit" : "alert");
    else tone.stop();
    const unheard = cautions.filter(({ number }) => !heard.has(number));
    if (warnings.length === 0 && unheard.length > 0) {
      for (const { number } of unheard) heard.add(number);
      tone.caution(unheard.at(-1).kind);
    }
  }

  /** Never calm after an exceedance, also where someone has acknowledged it. */
  function quietWords() {
    if (!now.isLinked) return "◆ Not connected: new alarms cannot arrive. ";
    return exceeded() ? `◆ LIMIT ${exceeded()}, acknowledged. ` : "No unacknowledged alarms. ";
  }

  function promised() {
    const { assessment, flight } = now;
    const holds = [now.headline.status, ...now.headline.beside];
    const state = holds.includes("stale") ? "stale" : shownState(assessment);
    const wasBetween = shownState({ state: "invalid", cause: assessment.last }) === "not_assessed";
    if (holds.includes("invalid") && state === "stale" && !wasBetween)
      return "The guarantee is withdrawn: the monitor was not applicable to the last sample.";
    if (state === "not_assessed" || (holds.includes("invalid") && wasBetween)) return "No guarantee between manoeuvres: nothing is assessed there.";
    if (state === "invalid") return `The guarantee is withdrawn: ${assessment.reason || "the monitor is not applicable here"}`;
    if (state === "stale") return "No guarantee without current samples: nothing is assessed.";
    return flight.warnings.length ? `◆ ${flight.warnings.map(sentence).join(" ")}` : guarantee(flight);
  }

  /** Reason and cause of a caution that holds now: another may have raised it. */
  function presentCause(kind) {
    if (kind === "stale" && now.stale !== "") return { reason: now.stale };
    const { reason: why, cause = null } = now.assessment;
    return kind === "invalid" && shownState(now.assessment) === "invalid" && why ? { reason: why, cause } : {};
  }

  /** The first of several of a kind, as in the headline; `others`: number of further alarms. */
  function words(alike, others) {
    const { flight } = now;
    const first = alike.reduce((earliest, alarm) => (alarm.t < earliest.t ? alarm : earliest));
    const { t, p_value: risk, kind, exceedance, reason: why } = first;
    const value = risk === null ? "" : ` ${riskText(risk, flight.alertAbove)}`;
    const at = alike.length > 1 ? `first at ${secondsText(t)}, ${alike.length} alarms` : `at ${secondsText(t)}`;
    const more = others > 0 ? `, and ${counted(others, "more alarm")}` : "";
    if (kind in CAUTION_WORDS) return `${cautionText({ ...first, ...presentCause(kind) }, ` ${at}`)}${more}`;
    if (kind === "limit") return `LIMIT EXCEEDED ${at}: ${[measured(exceedance), why].filter(Boolean).join(", ")}${more}`;
    const lead = leadSeconds(flight.lead);
    const above = Number.isFinite(flight.alertAbove) ? ` > ${figure(flight.alertAbove)}` : "";
    return `ALERT ${at}: risk${value}${above}, warns ${lead} s before ${flight.limits || "a failure as labelled"}${more}`;
  }

  function measured({ channel, value, limit, judged }) {
    const measured = now.flight.channels.find(({ key }) => key === channel);
    const which = judged === "recorded" ? " as recorded, bias and trim included" : "";
    return `${measured.symbol} ${quantity(measured, value)}${which}, limit ${magnitudeIn(measured, limit)}`;
  }

  async function acknowledgeAll() {
    failure.show("");
    try {
      const { warnings, cautions } = waiting();
      for (const alarm of warnings.length > 0 ? warnings : cautions) onAlarm(await acknowledge(alarm));
    } catch (error) {
      failure.show(`Not acknowledged. ${reason(error)}`);
    }
  }

  function onAlarm(alarm) {
    const known = alarms.get(alarm.number);
    if (known?.acknowledged && !alarm.acknowledged) return;
    alarms.set(alarm.number, alarm);
    while (alarms.size > 200) alarms.delete(alarms.keys().next().value);
    render();
  }

  function show(given) {
    if (Object.keys(given).every((name) => JSON.stringify(given[name]) === JSON.stringify(now[name]))) return;
    Object.assign(now, given);
    if (given.flight) shown = "";
    render();
  }

  return {
    show,
    onAlarm,
    acknowledgeAll,
    open: () => waiting().warnings.length,
    close: () => tone.stop(),
  };
}
