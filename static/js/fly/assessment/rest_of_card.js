/**
 * The forecast for the rest of the test card, in words: whether and when it exceeds a limit.
 *
 * Where nothing is forecast, it gives the reason; a method that never forecasts is hidden.
 *
 * createRestOfCard(element, noRest) -> {draw(stale, ahead, t, state, channels, headline)}     each frame
 *     noRest: why the monitor never forecasts it; empty where it does
 *     headline: of the flight, {status, exceeded_t}: what is exceeded is not predicted
 *     ahead: see charts/live/flight_chart.js; t, state: of the newest sample [s], as shown; null for none
 */

import { formatted, h } from "../../lib/dom.js";
import { isBeyond, limitsOf } from "../../lib/limits.js";
import { magnitudeIn, percent } from "../../lib/numbers.js";

const WORST = ["predicted", "possible", "none"];
const UNKNOWN = {
  warming_up: "not known: too few samples yet",
  invalid: "not known: the monitor is not applicable",
  not_assessed: "not known between manoeuvres",
  not_applicable: "not known: the monitor is not applicable",
  limits_unknown: "not known: the monitor is not applicable",
};

export function createRestOfCard(element, noRest) {
  element.classList.add("rest-of-card");
  element.setAttribute("aria-label", "Rest of the test card");
  const line = h("p", {});
  element.append(h("h2", { class: "risk-ahead-heading" }, "rest of the test card"), line);
  const now = /** @type {any} */ ({});
  let worst = null; // of the forecast
  let shown = "";
  element.hidden = Boolean(noRest);

  /** Level and words. */
  function reading({ stale, ahead, t, state, status, exceeded }) {
    if (stale) return ["unknown", "not known: the display is stale"];
    if (ahead === null) return ["unknown", UNKNOWN[state] ?? "not known"];
    if (status === "exceeding") return ["unknown", "a limit is exceeded now"];
    if (ahead.why) return ["unknown", ahead.why];
    const again = Number.isFinite(exceeded) && exceeded <= t;
    if (ahead.peak) return [levelOf(ahead.peak), peakWords(ahead.peak, again)];
    return [worst.level, wordsOf(worst, t, again)];
  }

  function draw(stale, ahead, t, state, channels, { status = "", exceeded_t: exceeded = null } = {}) {
    const isSame = ahead === now.ahead && channels === now.channels;
    if (isSame && stale === now.stale && t === now.t && state === now.state && status === now.status && exceeded === now.exceeded) return;
    if (!isSame) worst = worstOf(ahead, channels);
    Object.assign(now, { stale, ahead, t, state, channels, status, exceeded });
    const [level, text] = reading(now);
    if (`${level} ${text}` === shown) return;
    shown = `${level} ${text}`;
    element.dataset.level = level;
    line.replaceChildren(formatted(text.replaceAll(" %", "\u00a0%")));
  }

  return { draw };
}

/** The channel that is most likely to exceed its limit; the earliest of equals. Null without a forecast of channels. */
function worstOf(ahead, channels) {
  if (ahead === null) return null;
  const each = Object.entries(ahead.channels).map(([key, band]) => {
    const { predicted, possible } = band;
    const channel = channels.find((one) => one.key === key);
    const level = predicted !== null ? "predicted" : possible !== null ? "possible" : "none";
    const at = predicted ?? possible ?? Infinity;
    return { channel, level, at, limit: limitAt(channel, ahead.t, band, at) };
  });
  return each.sort((a, b) => WORST.indexOf(a.level) - WORST.indexOf(b.level) || a.at - b.at)[0] ?? null;
}

/** The limit that the band exceeds at this time or, being thinned, nearest to it. */
function limitAt(channel, t, { low, high }, at) {
  const limits = limitsOf(channel);
  const ends = (limits ?? []).map((limit, side) => {
    const times = t.filter((_, k) => isBeyond(limits, low[k], high[k])[side]);
    return { limit, side, apart: Math.min(...times.map((time) => Math.abs(time - at))) };
  });
  return ends.sort((a, b) => a.apart - b.apart)[0];
}

function levelOf({ mean, high }) {
  return mean >= 1 ? "predicted" : high >= 1 ? "possible" : "none";
}

function peakWords(peak, again) {
  const [mean, low, high] = [peak.mean, peak.low, peak.high].map((share) => percent(share, 0));
  const words = `peak ahead ${mean} of a limit (90 % interval: ${low} to ${high})`;
  return { predicted: `▲ ${again ? "another " : ""}exceedance predicted, `, possible: "◇ may exceed, ", none: "" }[levelOf(peak)] + words;
}

function wordsOf({ channel, level, at, limit }, t, again) {
  if (level === "none") return "no exceedance predicted in the rest of the card";
  const exceeds = `${exceedWords(channel, limit)}${again ? " again" : ""}`;
  const within = `${Math.max(0, at - t).toFixed(1)} s`;
  return level === "predicted"
    ? `▲ ${channel.symbol} predicted to ${exceeds} in ${within}`
    : `◇ ${channel.symbol} may ${exceeds} in ${within}: the 90 % band reaches it`;
}

/** "exceed 0.5 g", "fall below −1.4 g". */
function exceedWords(channel, { limit, side }) {
  const [least, greatest] = limitsOf(channel);
  if (least === -greatest) return `exceed ${magnitudeIn(channel, greatest)}`;
  return `${side === 0 ? "fall below" : "exceed"} ${magnitudeIn(channel, limit)}`;
}
