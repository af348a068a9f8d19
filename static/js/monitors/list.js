/** List of monitors, stored and in training. Exports  showMonitors(element, context). */

import { reason } from "../lib/api.js";
import { aircraftName, kindName, loadCatalog } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { jobList } from "../lib/job_progress.js";
import { hiddenHead, scrolledTable } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { figure, moment, percent } from "../lib/numbers.js";
import { warningMark } from "../lib/monitor_warnings.js";
import { button, empty, errorLine, link, pageOf } from "../lib/view_states.js";

export function showMonitors(element, { api, navigate }) {
  return loadingView(element, { title: "Monitors", text: "Loading monitors", build });

  async function build({ keep, again }) {
    const done = () => again();
    const [catalog, monitors, datasets, jobs] = await Promise.all([
      loadCatalog(api),
      api.get("/monitors"),
      api.get("/datasets"),
      jobList({ api, kinds: ["monitor"], done }),
    ]);
    keep(jobs);
    const rates = new Map(datasets.map(({ id, unsafe_rate }) => [id, unsafe_rate]));
    const content = monitors.length
      ? table(monitors, rates, catalog)
      : empty(
          "No monitor yet",
          "Train one: choose the aircraft and the manoeuvre. The rest has defaults, and training takes seconds to minutes.",
          link("Train a monitor", "#/monitors/new", true),
          guideLink("first-monitor", "how to train a first monitor"),
        );
    return pageOf(
      "Monitors",
      [
        link("Train a monitor", "#/monitors/new", true),
        monitors.length > 1 ? link("Combine monitors", "#/monitors/combine") : null,
        link("Compare five methods", "#/monitors/compare"),
        link("Lead-time study", "#/monitors/sweep"),
        link("Limit sets", "#/limits"),
        uploader(),
      ],
      jobs.element,
      content,
    );
  }

  function uploader() {
    const failure = errorLine();
    const input = h("input", {
      type: "file",
      accept: ".fwm",
      class: "visually-hidden",
      tabindex: -1,
      "aria-label": "portable monitor file",
      onchange: upload,
    });
    return h(
      "div",
      { class: "row" },
      button("Upload a monitor file", () => input.click(), needs("POST /monitors")),
      input,
      failure.element,
    );

    async function upload() {
      const [file] = input.files;
      if (!file) return;
      const name = file.name.replace(/\.fwm$/, "").slice(0, 200) || "uploaded";
      try {
        const { id } = await api.upload(`/monitors?name=${encodeURIComponent(name)}`, file);
        navigate(`#/monitors/${id}`);
      } catch (error) {
        failure.show(reason(error));
        input.value = "";
      }
    }
  }
}

function table(monitors, rates, catalog) {
  const heads = [
    ["Name"],
    ["Aircraft"],
    ["Manoeuvre"],
    ["Failures N", 1],
    ["ε", 1],
    ["Warning lead time [s]", 1],
    ["Unsafe rate", 1],
    ["Created"],
    hiddenHead("Fly"),
  ];
  const rows = monitors.map((monitor) => {
    const { aircraft, maneuver } = monitor.dataset_recipe;
    return h(
      "tr",
      {},
      h("th", { scope: "row" }, h("a", { href: `#/monitors/${monitor.id}` }, monitor.name), warningMark(monitor)),
      h("td", {}, aircraftName(catalog, aircraft)),
      h("td", { class: "nowrap" }, kindName(catalog, "maneuver", maneuver)),
      h("td", { class: "number" }, monitor.n_unsafe),
      h("td", { class: "number" }, figure(monitor.epsilon)),
      h("td", { class: "number" }, figure(monitor.lead)),
      h("td", { class: "number" }, percent(rates.get(monitor.dataset_id))),
      h("td", { class: "dim nowrap" }, moment(monitor.created)),
      h(
        "td",
        {},
        h(
          "a",
          {
            class: "button button-small",
            href: `#/fly?monitor=${monitor.id}`,
            "aria-label": `Fly ${monitor.name}`,
          },
          "Fly",
        ),
      ),
    );
  });
  return scrolledTable({ heads, rows });
}
