/**
 * Inspect one rollout of a dataset: strips with cursors, parameters, replay.
 *
 * Exports
 *   createRolloutViewer({api, catalog, dataset, monitors, navigate}) -> {element, close()}
 *     monitors: those that can assess it, the best first
 */

import { createFlightChart } from "../charts/live/flight_chart.js";
import { limitedFirst } from "../charts/strips.js";
import { reason } from "../lib/api.js";
import { formatted, h } from "../lib/dom.js";
import { figure } from "../lib/numbers.js";
import { button, errorLine, link } from "../lib/view_states.js";

export function createRolloutViewer({ api, catalog, dataset, monitors, navigate }) {
  const counts = { unsafe: dataset.n_unsafe, safe: dataset.n_safe };
  const outcome = h(
    "select",
    { id: "rollout-outcome", onchange: () => pick(0) },
    Object.keys(counts)
      .filter((key) => counts[key])
      .map((key) => h("option", { value: key }, `${key} (${counts[key]})`)),
  );
  const index = h("input", {
    type: "number",
    id: "rollout-index",
    min: 0,
    step: 1,
    value: 0,
    onchange: () => pick(Number(index.value)),
  });
  const words = h("p", { class: "rollout-words", role: "status" });
  const strips = h("div", { class: "rollout-strips" });
  const theta = h("div", {});
  const failure = errorLine();
  const monitor = h(
    "select",
    { id: "replay-monitor", "aria-label": "monitor for the replay" },
    monitors.map(({ id, name }) => h("option", { value: id }, name)),
  );
  const replay = monitors.length
    ? h(
        "div",
        { class: "row" },
        button("Replay with", fly, { class: "button button-primary" }),
        h("div", { class: "field" }, monitor),
      )
    : h(
        "div",
        { class: "row" },
        h("span", { class: "hint" }, "Train a monitor to replay this rollout."),
        link("Train a monitor", `#/monitors/new?dataset=${dataset.id}`),
      );
  const element = h(
    "section",
    { class: "panel stack rollout-viewer", "aria-labelledby": "viewer-title" },
    h("h2", { class: "panel-title", id: "viewer-title" }, "One rollout"),
    h(
      "div",
      { class: "row rollout-pick" },
      h("label", { for: "rollout-outcome" }, "outcome"),
      h("div", { class: "field" }, outcome),
      h("label", { for: "rollout-index" }, "number"),
      h("div", { class: "field" }, index),
      button("Previous", () => pick(Number(index.value) - 1), { class: "button button-small" }),
      button("Next", () => pick(Number(index.value) + 1), { class: "button button-small" }),
      h("div", { class: "spread" }, replay),
    ),
    words,
    failure.element,
    strips,
    theta,
  );
  let chart = null;
  let turn = 0;
  let closed = false;
  pick(0);
  return {
    element,
    close: () => {
      closed = true;
      chart?.destroy();
    },
  };

  async function pick(wanted) {
    const count = counts[outcome.value];
    const chosen = Math.min(Math.max(Math.trunc(wanted) || 0, 0), count - 1);
    const mine = ++turn;
    index.max = count - 1;
    index.value = chosen;
    failure.show("");
    try {
      const rollout = await api.get(
        `/datasets/${dataset.id}/rollouts/${outcome.value === "unsafe" ? chosen : dataset.n_unsafe + chosen}`,
      );
      if (mine === turn && !closed) draw(rollout);
    } catch (error) {
      failure.show(reason(error));
    }
  }

  function draw({ telemetry, fail_index, theta: parameters }) {
    const { t } = telemetry;
    const fails =
      fail_index === null
        ? `stays within its limits for ${figure(t.at(-1))} s`
        : `fails at ${figure(t.at(-1))} s, where it is cut`;
    words.textContent = `Rollout ${index.value}, ${outcome.value}: ${fails}. Point at the strips for values; cursors A and B show differences.`;
    chart?.destroy();
    const host = h("div", {});
    strips.replaceChildren(host);
    const channels = catalog.channels.map((channel) => ({
      ...channel,
      limit: dataset.recipe.limits?.[channel.key] ?? null,
    }));
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
    chart.push(
      t.map((time, k) => ({
        t: time,
        y: channels.map(({ key }) => telemetry[key][k]),
        p_value: null,
        alert: null,
        state: "ok",
      })),
    );
    chart.setWindow(0, t.at(-1) + dataset.dt);
    if (fail_index !== null) chart.setCursor(t[fail_index]);
    theta.replaceChildren(thetaTable(parameters));
  }

  function fly() {
    navigate(
      `#/fly?dataset=${dataset.id}&outcome=${outcome.value}&rollout=${index.value}&monitor=${monitor.value}`,
    );
  }
}

function thetaTable(parameters) {
  const cells = Object.entries(parameters).map(([name, value]) =>
    h("div", {}, h("dt", {}, formatted(name)), h("dd", {}, figure(value, 4))),
  );
  return h(
    "details",
    { class: "fold" },
    h("summary", {}, "Uncertain parameters of this rollout"),
    h("dl", { class: "facts theta" }, cells),
  );
}
