/** Monitor sets: #/sets lists them and makes one; #/sets/{id} shows its conditions and their monitors. */

import { conditionColumns, createCaseForm } from "../forms/conditions.js";
import { labelled, select } from "../forms/controls.js";
import { needs } from "../lib/api.js";
import { loadCatalog } from "../lib/catalog.js";
import { button, deleteButton, empty, guideLink, h, link, loadingView, pageOf, panel, table } from "../lib/dom.js";
import { moment } from "../lib/numbers.js";

const ROUTE = "POST /monitor-sets";
const SHARED = "Its monitors have the same channels, sample interval and lead time. Each keeps its own ε and limits.";
const COLUMNS = [
  ["Name", ({ id, name }) => h("a", { href: `#/sets/${id}` }, name), "name"],
  ["Conditions", ({ cases }) => cases.length, "number"],
  ["By", ({ by }) => by],
  ["Created", ({ created }) => moment(created), "date"],
];

export function show(element, { id, api, navigate }) {
  const path = `/monitor-sets/${encodeURIComponent(id ?? "")}`;
  const view = id
    ? { title: "Monitor set", text: "Loading the monitor set", loads: [loadCatalog, path], build: buildOne }
    : { title: "Monitor sets", text: "Loading monitor sets", loads: [loadCatalog, "/monitor-sets", "/monitors"], build };
  return loadingView(element, view);

  function build(_, catalog, sets, monitors) {
    const form = createSetForm(catalog, monitors, async (made) => navigate(`#/sets/${(await api.post("/monitor-sets", made)).id}`));
    const begin = button("Create a monitor set", () => form.querySelector("input").focus(), { class: "button button-primary", ...needs(ROUTE) });
    const list = sets.length
      ? table({ columns: COLUMNS, items: sets })
      : empty(
          "No monitor set yet",
          "A monitor set has a monitor for each flight condition of one test, such as ranges of Mach number and altitude. A live flight uses the one whose condition holds.",
          monitors.length ? begin : link("Train a monitor", "#/monitors/new", true),
          guideLink("limit-sets#monitor-sets", "how to use monitor sets"),
        );
    return pageOf("Monitor sets", [link("Fly", "#/fly"), link("Monitors", "#/monitors")], list, monitors.length ? form : null);
  }

  function buildOne(_, catalog, { name, by, created, text, cases }) {
    const monitor = ({ monitor: its, monitor_name: words }) => h("a", { href: `#/monitors/${its}` }, words);
    const columns = [...conditionColumns(catalog), ["Monitor", monitor, "name"]];
    const remove = deleteButton({ api, path, what: "monitor set", consequence: "Its monitors stay.", done: () => navigate("#/sets") });
    const actions = [link("Fly it", `#/fly?set=${id}&kind=live`, true), link("All monitor sets", "#/sets"), remove];
    const about = h("p", `By ${by}, ${moment(created)}${text ? `: ${text}` : ""}. ${SHARED}`);
    return pageOf(name, actions, panel("Conditions", [about, table({ columns, items: cases, panel: false })], { "aria-label": "Conditions" }));
  }
}

function createSetForm(catalog, monitors, send) {
  const choices = monitors.map(({ id, name, lead }) => [id, `${name} (${lead} s ahead)`]);
  return createCaseForm({
    catalog,
    word: "Create the monitor set",
    route: ROUTE,
    heading: "New monitor set",
    hint: `Conditions may overlap at their ends; the monitor in use then stays in use. An empty field is unbounded. ${SHARED}`,
    nameless: "No name was given: name the monitor set.",
    cases: [{ name: "", ranges: {} }, { name: "", ranges: {} }],
    contentOf: () => {
      const choice = select(choices);
      return { elements: labelled("Monitor", choice).element, check: () => true, read: () => ({ monitor: choice.value }) };
    },
    send,
  });
}
