/**
 * What is forecast of the rest of the test card, in words: whether and when a limit is predicted to be exceeded.
 *
 * Nothing is shown of a flight whose monitor forecasts no card; "not known" while it says nothing of now.
 *
 * Exports
 *   createRestOfCard(element) -> {show(ahead, {t, channels}), draw(stale)}     ahead: see charts/live/ahead.js; t: of the newest sample [s]
 */

import { symbolNodes } from "../charts/readout.js";
import { h } from "../lib/dom.js";
import { percent } from "../lib/numbers.js";
import { magnitudeIn } from "../lib/units.js";

const WORST = ["predicted", "possible", "none"];

export function createRestOfCard(element) {
  element.classList.add("rest-of-card");
  element.setAttribute("aria-label", "Rest of the test card");
  element.hidden = true;
  const line = h("p", {});
  element.append(h("h2", { class: "risk-ahead-heading" }, "rest of the test card"), line);
  let now = { ahead: null, t: 0, channels: [] };
  let told = "";

  function draw(stale) {
    if (now.ahead !== null) element.hidden = false;
    if (element.hidden) return;
    const known = stale ? null : now.ahead;
    const peak = known?.peak;
    const worst = known === null || peak ? null : worstOf(now);
    const level = peak ? levelOf(peak) : (worst?.level ?? "unknown");
    const nodes = peak ? peakWords(peak) : worst === null ? ["not known"] : wordsOf(worst, now.t);
    const text = nodes.map((node) => node.textContent ?? node).join("");
    if (`${level} ${text}` === told) return;
    told = `${level} ${text}`;
    element.dataset.level = level;
    line.replaceChildren(...nodes);
  }

  return {
    draw,
    show: (ahead, { t, channels }) => {
      now = { ahead, t, channels };
    },
  };
}

/** Of the channels, the one whose limit is exceeded most surely, and of these first. */
function worstOf({ ahead, channels }) {
  const each = Object.entries(ahead.channels).map(([key, { predicted, possible }]) => {
    const channel = channels.find((one) => one.key === key);
    const level = predicted !== null ? "predicted" : possible !== null ? "possible" : "none";
    return { channel, level, at: predicted ?? possible ?? Infinity };
  });
  return each.sort((a, b) => WORST.indexOf(a.level) - WORST.indexOf(b.level) || a.at - b.at)[0];
}

function levelOf({ mean, high }) {
  return mean >= 1 ? "predicted" : high >= 1 ? "possible" : "none";
}

function peakWords(peak) {
  const [mean, low, high] = [peak.mean, peak.low, peak.high].map((share) => percent(share, 0));
  const words = `peak still to come, of any limited channel: ${mean} of its limit (90 %: ${low} to ${high})`;
  return [{ predicted: "▲ exceedance predicted, ", possible: "◇ may exceed, ", none: "" }[levelOf(peak)] + words];
}

function wordsOf({ channel, level, at }, t) {
  if (level === "none") return ["no exceedance predicted in the rest of the card"];
  const limit = magnitudeIn(channel, channel.limit);
  const within = `${Math.max(0, at - t).toFixed(1)} s`;
  const symbol = symbolNodes(channel.symbol);
  return level === "predicted"
    ? ["▲ ", ...symbol, ` predicted to exceed ${limit} in ${within}`]
    : ["◇ ", ...symbol, ` may exceed ${limit} in ${within}: the 90 % band reaches it`];
}
