/**
 * Strips and gauge without a server: the tests feed them and set the clock.
 * `?auto` runs the animation loop; else `harness.draw(wall)` draws once. `?theme=light`, `?seconds=20`.
 */

import { createAlarmPanel } from "/static/js/fly/alarms/alarm_panel.js";
import { createAttitudeIndicator } from "/static/js/fly/scene/attitude_indicator.js";
import { changedChannels } from "/static/js/recordings/mapping/changes.js";
import { validityWords } from "/static/js/recordings/words.js";
import { createRingBuffer } from "/static/js/charts/live/ring_buffer.js";
import { createRiskGauge } from "/static/js/fly/assessment/risk_gauge.js";
import { headlineOf } from "/static/js/fly/headline.js";
import { limitsOf, limitsInWords, exceededWords, withLimits } from "/static/js/lib/limits.js";
import { decimal, decimals, riskText } from "/static/js/lib/numbers.js";
import { createAddress, keepWindow } from "/static/js/lib/address.js";
import { addDrawer, loopStats } from "/static/js/lib/draw_loop.js";
import { createFlightChart } from "/static/js/charts/live/flight_chart.js";
import { createTimeline } from "/static/js/charts/live/timeline.js";
import { bindMuteButton, createTone } from "/static/js/fly/alarms/tone.js";
import { marginAt, stripOf } from "/static/js/charts/strips.js";
import { createValueAxis } from "/static/js/charts/value_axis.js";

const options = new URLSearchParams(location.search);
if (options.has("theme")) document.documentElement.dataset.theme = options.get("theme");

const CHANNELS = [
  { key: "beta", symbol: "β", unit: "rad", label: "sideslip", limit: null },
  { key: "p", symbol: "p", unit: "rad/s", label: "roll rate", limit: null },
  { key: "r", symbol: "r", unit: "rad/s", label: "yaw rate", limit: null },
  { key: "Ny", symbol: "N_y", unit: "g", label: "lateral acceleration", limit: 0.5 },
  { key: "delta_a", symbol: "δ_a", unit: "rad", label: "aileron", limit: null },
  { key: "delta_r", symbol: "δ_r", unit: "rad", label: "rudder", limit: null },
];
const EPSILON = 0.1;
const dt = Number(options.get("dt") ?? 0.02);
const lead = Number(options.get("lead") ?? 0.5);

/** A doublet every eight seconds, each stronger than the last by `growth`. */
export function sample(t, growth = 0.06) {
  const size = 1 + growth * Math.floor(t / 8);
  const s = t % 8;
  const rudder = s < 1 ? 0 : s < 2 ? 0.12 : s < 3 ? -0.12 : 0;
  const ring = (begin, w, z) => (s < begin ? 0 : Math.exp(-z * (s - begin)) * Math.sin(w * (s - begin)));
  const turn = ring(1, 2.9, 0.5) - 2 * ring(2, 2.9, 0.5) + ring(3, 2.9, 0.5);
  const lag = ring(1.1, 2.9, 0.5) - 2 * ring(2.1, 2.9, 0.5) + ring(3.1, 2.9, 0.5);
  const noise = 0.004 * Math.sin(t * 61) * Math.sin(t * 17.3);
  return [
    size * 0.05 * turn + noise / 4, size * 0.14 * lag + noise, -size * 0.09 * turn + noise,
    size * 0.17 * lag + noise, size * 0.03 * lag, size * rudder,
  ];
}

export function frame(t, { growth = 0.06, state = "ok", reason = "", cause = null } = {}) {
  const y = sample(t, growth);
  const ahead = sample(t + lead, growth);
  const strongest = Math.max(...[0, 0.5, 1].map((s) => Math.abs(sample(t + s * lead, growth)[3])));
  const p_value = state === "ok" ? Math.min(1, 0.004 + 1.2 * Math.max(0, strongest / 0.5 - 0.35) ** 3) : null;
  return {
    t, y, p_value, state, alert: p_value === null ? null : p_value > EPSILON, reason, cause,
    y_hat: state === "ok" ? ahead.map((value) => 0.96 * value) : null,
  };
}

const timeline = createTimeline({ seconds: Number(options.get("seconds") ?? 60), lead, dt });
const address = createAddress();
const chart = createFlightChart(document.querySelector("#strips"), {
  address,
  simulated: window.simulated ?? null, starts: () => [{ t: 8, from: "trim" }],
  channels: CHANNELS, epsilon: EPSILON, dt, lead, timeline, autostart: options.has("auto"),
  beside: options.get("beside"),
  history: Number(options.get("history") ?? 180_000),
});
document.querySelector("#strips").after(chart.cross);
keepWindow(address, timeline);
const dial = createRiskGauge(document.querySelector("#gauge"), options.has("auto") ? timeline : null);
let reading = { state: null };
const gauge = {
  update: (given) => {
    reading = given;
    dial.update(reading);
    drawGauge(performance.now());
  },
};
if (options.has("auto")) addDrawer(drawGauge);
const tone = createTone();
bindMuteButton(document.querySelector("#mute"), tone, new AbortController().signal);

/** Draws the gauge as the headline of a flight with this sample only has it. */
function drawGauge(wall) {
  if (reading.state === null) return dial.draw(wall);
  const { state, alert, p_value } = reading;
  const status = state === "ok" && alert ? "risk" : state === "ok" && !Number.isFinite(p_value) ? "invalid" : state;
  const level = { risk: "warning", stale: "caution", invalid: "caution", ok: "none" }[status] ?? "advisory";
  const stale = options.has("auto") && timeline.stale(wall);
  dial.draw(wall, headlineOf({ status, level, beside: [] }, { stale, alarms: 0 }));
}

/** Frames of times from..to, a sample every dt, all arriving at `wall`. */
function feed(from, to, wall, given = {}) {
  const frames = [];
  for (let k = Math.ceil(from / dt - 1e-9); k * dt < to - 1e-9; k++) frames.push(frame(k * dt, given));
  const stored = chart.push(frames, wall);
  if (frames.length > 0) gauge.update({ ...frames.at(-1), epsilon: EPSILON });
  return stored;
}

/** Pixels of a strip's plot that are near a colour token: [count, leftmost, rightmost] in device px. */
function pixels(key, token, tolerance = 40) {
  const canvas = document.querySelector(`.strip[data-key="${key}"] canvas`);
  const probe = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  probe.fillStyle = getComputedStyle(document.querySelector("#strips")).getPropertyValue(`--${token}`).trim();
  probe.fillRect(0, 0, 1, 1);
  const wanted = probe.getImageData(0, 0, 1, 1).data;
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const pen = copy.getContext("2d", { willReadFrequently: true });
  pen.drawImage(canvas, 0, 0);
  const { data, width } = pen.getImageData(0, 0, copy.width, copy.height);
  let [count, left, right] = [0, Infinity, -Infinity];
  for (let i = 0; i < data.length; i += 4) {
    if (Math.max(...[0, 1, 2].map((c) => Math.abs(data[i + c] - wanted[c]))) > tolerance) continue;
    const x = (i / 4) % width;
    if (x < 46 * devicePixelRatio) continue;
    count += 1;
    left = Math.min(left, x);
    right = Math.max(right, x);
  }
  return [count, left, right];
}

Object.assign(window, {
  harness: {
    chart, dial, gauge, timeline, tone, feed, frame, sample, pixels, loopStats, riskText,
    createFlightChart, createRingBuffer, createTimeline, createValueAxis, createTone, createAlarmPanel, createAttitudeIndicator,
    decimal, decimals, limitsInWords, exceededWords, withLimits, limitsOf, marginAt, stripOf, changedChannels, validityWords, EPSILON, CHANNELS,
    draw: (wall) => chart.update(wall),
  },
});
