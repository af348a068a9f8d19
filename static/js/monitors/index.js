/**
 * The Monitors page: #/monitors lists; #/monitors/new trains one, #/monitors/combine combines several,
 * #/monitors/sweep compares methods and lead times; #/monitors/{id} is one monitor.
 */

import { fileInput } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { loadCatalog, testNames } from "../lib/catalog.js";
import { button, empty, errorLine, guideLink, h, hiddenHead, link, loadingView, pageOf, table } from "../lib/dom.js";
import { jobList } from "../lib/job_progress.js";
import { warningMark } from "../lib/monitors.js";
import { figure, moment, percent } from "../lib/numbers.js";
import { showCombining } from "./combine_form.js";
import { showSweep } from "./lead_sweep.js";
import { showMonitor } from "./page.js";
import { showTraining } from "./train_form.js";

const VIEWS = { new: showTraining, combine: showCombining, sweep: showSweep };

export function show(element, context) {
  const view = context.id ? (VIEWS[context.id] ?? showMonitor) : showMonitors;
  return view(element, context);
}

function showMonitors(element, { api, navigate }) {
  return loadingView(element, { title: "Monitors", text: "Loading monitors", loads: [loadCatalog, "/monitors"], build });

  async function build({ keep, again }, catalog, monitors) {
    const jobs = keep(await jobList({ api, kind: "monitor", done: again }));
    const training = () => link("Train a monitor", "#/monitors/new", true);
    const content = monitors.length
      ? listOf(monitors, catalog)
      : empty(
          "No monitor yet",
          "Train one: choose the aircraft and the manoeuvre. The rest has defaults, and training takes seconds to minutes.",
          training(),
          guideLink("first-monitor", "how to train a first monitor"),
        );
    const actions = [
      training(),
      monitors.length > 1 ? link("Combine monitors", "#/monitors/combine") : null,
      link("Lead-time study", "#/monitors/sweep"),
      link("Monitor sets", "#/sets"),
      uploader(api, navigate),
    ];
    return pageOf("Monitors", actions, jobs.element, content);
  }
}

const shareOf = (share) => (share ? percent(share.count / share.total) : "not tested");

function uploader(api, navigate) {
  const failure = errorLine();
  const input = fileInput({
    accept: ".fwm",
    class: "visually-hidden",
    tabindex: -1,
    "aria-label": "portable monitor file",
    failure,
    read: async (file) => {
      const name = file.name.replace(/\.fwm$/, "").slice(0, 200) || "uploaded";
      const { id } = await api.upload(`/monitors?name=${encodeURIComponent(name)}`, file).ended;
      navigate(`#/monitors/${id}`);
    },
  });
  const choose = button("Upload a monitor file", () => input.click(), needs("POST /monitors"));
  return h("div.row", choose, input, failure.element);
}

function listOf(monitors, catalog) {
  const fly = ({ id, name }) =>
    h("a.button.button-small", { href: `#/fly?monitor=${id}`, "aria-label": `Fly ${name}`, ...needs("POST /flights") }, "Fly");
  const columns = [
    ["Name", (monitor) => [h("a", { href: `#/monitors/${monitor.id}` }, monitor.name), warningMark(monitor)], "name"],
    ["Aircraft", (monitor) => testNames(catalog, monitor)[0]],
    ["Manoeuvre", (monitor) => testNames(catalog, monitor)[1]],
    ["Lead time", ({ lead }) => `${figure(lead)} s`, "number"],
    ["ε", ({ epsilon }) => figure(epsilon), "number"],
    ["Missed", ({ missed }) => shareOf(missed), "number"],
    ["Valid and quiet", ({ quiet }) => shareOf(quiet), "number"],
    ["Validity", ({ support }) => (support ? `≤ ${percent(support.level)} INVALID` : "not calibrated"), "nowrap"],
    ["Created", ({ created }) => moment(created), "date"],
    [hiddenHead("Fly"), fly],
  ];
  const caption =
    "On fresh flights, at each monitor's ε: failing flights missed, and safe flights that stay valid and without an alert (its power). Validity: share of flights like those of training that it may call INVALID.";
  return table({ columns, items: monitors, caption });
}
