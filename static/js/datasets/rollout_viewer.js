/** Inspect one rollout of a dataset: strips with cursors, parameters, replay by `monitors`, the best first. */

import { createFlightChart } from "../charts/live/flight_chart.js";
import { limitedFirst } from "../charts/strips.js";
import { fold, select } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { button, errorLine, factList, formatted, h, link, panel } from "../lib/dom.js";
import { startFlight } from "../lib/monitors.js";
import { figure } from "../lib/numbers.js";

export function createRolloutViewer({ api, channels, dataset, monitors, navigate }) {
  const counts = { unsafe: dataset.n_unsafe, safe: dataset.n_safe };
  const outcome = select(
    Object.entries(counts).map(([key, n]) => n && [key, `${key} (${n})`]),
    { id: "rollout-outcome", onchange: () => pick(0) },
  );
  const turnTo = () => pick(Number(index.value));
  const index = h("input", { type: "number", id: "rollout-index", min: 0, step: 1, value: 0, onchange: turnTo });
  const words = h("p.rollout-words", { role: "status" });
  const strips = h("div.rollout-strips");
  const theta = h("div");
  const failure = errorLine();
  const monitor = select(
    monitors.map(({ id, name }) => [id, name]),
    { id: "replay-monitor", "aria-label": "monitor for the replay" },
  );
  const training = link("Train a monitor", `#/monitors/new?dataset=${dataset.id}`);
  const flying = needs("POST /flights");
  const replay = monitors.length
    ? [button("Replay with", fly, { class: "button button-primary", ...flying }), h("div.field", flying, monitor)]
    : [h("span.hint", "Train a monitor to replay this rollout."), training];
  const step = (word, by) => button(word, () => pick(Number(index.value) + by), { class: "button button-small" });
  const pickers = h(
    "div.row.rollout-pick",
    h("label", { for: "rollout-outcome" }, "outcome"),
    h("div.field", outcome),
    h("label", { for: "rollout-index" }, "number"),
    h("div.field", index),
    step("Previous", -1),
    step("Next", 1),
    h("div.spread.row", replay),
  );
  const look = { class: "panel stack rollout-viewer", "aria-label": "One rollout" };
  const element = panel("One rollout", [pickers, words, failure.element, strips, theta], look);
  let chart = null;
  let turn = 0;
  let isClosed = false;
  pick(0);
  return {
    element,
    close: () => {
      isClosed = true;
      chart?.destroy();
    },
  };

  async function pick(wanted) {
    const last = counts[outcome.value] - 1;
    const chosen = Math.min(Math.max(Math.trunc(wanted) || 0, 0), last);
    const first = outcome.value === "unsafe" ? 0 : dataset.n_unsafe;
    const mine = ++turn;
    index.max = last;
    index.value = chosen;
    await failure.attempt(async () => {
      const rollout = await api.get(`/datasets/${dataset.id}/rollouts/${first + chosen}`);
      if (mine === turn && !isClosed) draw(rollout);
    });
  }

  function draw({ telemetry, fail_index: failed, theta: parameters }) {
    const { t } = telemetry;
    const end = figure(t.at(-1));
    const fate = failed === null ? `stays within its limits for ${end} s` : `fails at ${end} s, where it is cut`;
    words.textContent = `Rollout ${index.value}, ${outcome.value}: ${fate}. Point at the strips for values; cursors A and B show differences.`;
    chart?.destroy();
    const host = h("div");
    strips.replaceChildren(host);
    const { limited, others } = limitedFirst(channels);
    chart = createFlightChart(host, {
      channels,
      order: [...limited, ...others],
      forecasts: [],
      dt: dataset.dt,
      seconds: Math.max(t.at(-1), dataset.dt),
      history: t.length + 8,
    });
    chart.setTransport({ playing: false, speed: 1 });
    const sampleAt = (k) => channels.map(({ key }) => telemetry[key][k]);
    chart.push(t.map((time, k) => ({ t: time, y: sampleAt(k), p_value: null, alert: null, state: "ok" })));
    chart.setWindow(0, t.at(-1) + dataset.dt);
    if (failed !== null) chart.setCursor(t[failed]);
    const values = Object.entries(parameters).map(([name, value]) => [formatted(name), figure(value, 4)]);
    theta.replaceChildren(...(values.length ? [fold("Uncertain parameters of this rollout", factList(values, "facts theta"))] : []));
  }

  function fly() {
    const source = { kind: "replay", dataset: dataset.id, outcome: outcome.value, rollout: Number(index.value) };
    return failure.attempt(() => startFlight({ api, navigate }, { source, monitor: monitor.value }));
  }
}
