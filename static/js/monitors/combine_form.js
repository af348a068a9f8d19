/**
 * Combine monitors of one planned test: choose members and lead time; then the job, then the new monitor's page.
 *
 * Exports  showCombining(element, {api, navigate})
 */

import { createFields } from "../forms/form.js";
import { reason } from "../lib/api.js";
import { aircraftName, kindName, loadCatalog, methodOf } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { followInPlace } from "../lib/job_progress.js";
import { tableHead } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { warningMark } from "../lib/monitor_warnings.js";
import { figure } from "../lib/numbers.js";
import { empty, errorLine, link, pageOf } from "../lib/view_states.js";

const TITLE = "Combine monitors";

export function showCombining(element, { api, navigate }) {
  return loadingView(element, { title: TITLE, text: "Loading monitors", build });

  async function build({ keep }) {
    const [catalog, monitors] = await Promise.all([loadCatalog(api), api.get("/monitors")]);
    const members = monitors.filter(isMember);
    if (members.length < 2)
      return pageOf(
        TITLE,
        [],
        empty(
          "Not enough monitors",
          "A combination needs at least two monitors of one planned test, such as for 0.25 and 0.5 s ahead. Combinations and monitors calibrated by groups cannot be members.",
          link("Train a monitor", "#/monitors/new", true),
        ),
      );
    return pageOf(TITLE, [guideLink("first-monitor#several-monitors-as-one", "combinations")], formOf({ catalog, members, api, navigate, keep }));
  }
}

function isMember({ recipe, dataset_recipe: test }) {
  const isPooled = (recipe.groups?.kind ?? "pooled") === "pooled";
  return isPooled && recipe.predictor?.kind !== "combination" && Object.keys(test).length > 0;
}

function formOf({ catalog, members, api, navigate, keep }) {
  const { schema, default: usual } = catalog.recipes.combination;
  const fields = createFields(schema, usual, { catalog, path: "combination", hidden: ["lead"] });
  const boxes = members.map((monitor) => h("input", { type: "checkbox", value: monitor.id, "aria-label": monitor.name }));
  const lead = h("select", { id: "combination-lead" });
  const name = h("input", { type: "text", id: "combination-name", maxlength: 200, placeholder: "optional" });
  const failure = errorLine();
  const go = h("button", { class: "button button-primary", type: "submit", ...needs("POST /monitors/combinations") }, "Combine");
  const form = h(
    "form",
    { class: "form", novalidate: true, onsubmit: send, "aria-label": TITLE, "data-keeps-input": true },
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "1  Members"),
      h(
        "p",
        { class: "hint" },
        "The combination shows the highest risk of its members and is calibrated as a whole. All members need the same planned test.",
      ),
      h(
        "div",
        { class: "table-scroll", onchange: follow },
        h(
          "table",
          { class: "table" },
          tableHead([["Member"], ["Aircraft"], ["Manoeuvre"], ["Method"], ["Warning lead time [s]", true]]),
          h("tbody", {}, members.map(row)),
        ),
      ),
    ),
    h(
      "fieldset",
      { class: "panel stack" },
      h("legend", {}, "2  Promise"),
      h(
        "div",
        { class: "field-grid" },
        h(
          "div",
          { class: "field" },
          h("label", { for: "combination-lead" }, "warning lead time ", h("span", { class: "unit" }, "[s]")),
          lead,
          h("p", { class: "hint" }, "the lead time of one member; an alert counts if it comes at least this early"),
        ),
        fields.keys.map(fields.element),
        h("div", { class: "field" }, h("label", { for: "combination-name" }, "name of the monitor"), name),
      ),
    ),
    failure.element,
    h("div", { class: "row" }, go, link("Cancel", "#/monitors")),
  );
  const stage = h("div", { class: "stack" }, form);
  follow();
  return stage;

  function row(monitor, k) {
    const { aircraft, maneuver } = monitor.dataset_recipe;
    const { predictor, score } = monitor.recipe;
    boxes[k].id = `member-${monitor.id}`;
    return h(
      "tr",
      {},
      h("td", {}, h("label", { class: "row", for: boxes[k].id }, boxes[k], monitor.name, warningMark(monitor))),
      h("td", {}, aircraftName(catalog, aircraft)),
      h("td", { class: "nowrap" }, kindName(catalog, "maneuver", maneuver)),
      h("td", {}, methodOf(catalog, monitor.recipe)?.label ?? `${kindName(catalog, "predictor", predictor)}, ${kindName(catalog, "score", score)}`),
      h("td", { class: "number" }, figure(monitor.lead)),
    );
  }

  function chosen() {
    return members.filter((_, k) => boxes[k].checked);
  }

  function follow() {
    const before = lead.value;
    const leads = [...new Set(chosen().map((member) => member.lead))].sort((a, b) => a - b);
    const options = leads.map((value) => h("option", { value }, figure(value)));
    lead.replaceChildren(...(options.length ? options : [h("option", {}, "choose members first")]));
    if (leads.map(String).includes(before)) lead.value = before;
    lead.disabled = leads.length === 0;
  }

  async function send(event) {
    event.preventDefault();
    if (chosen().length < 2) return failure.show("Choose at least two members.");
    if (!fields.check()) return undefined;
    failure.show("");
    go.disabled = true;
    try {
      const job = await api.post("/monitors/combinations", {
        ...fields.read(),
        lead: Number(lead.value),
        monitors: chosen().map(({ id }) => id),
        ...(name.value.trim() && { name: name.value.trim() }),
      });
      const done = ({ monitor }) => navigate(`#/monitors/${monitor}`);
      followInPlace({ form, stage, keep, focus: go, api, job, title: "Calibrating the combination", done });
    } catch (error) {
      fields.point(error.message);
      failure.show(reason(error));
    } finally {
      go.disabled = false;
    }
    return undefined;
  }
}
