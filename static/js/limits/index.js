/**
 * Limit sets: #/limits lists them and creates one; #/limits/{id} shows its versions and adds the next.
 *
 * Exports  show(element, {id, api, navigate}) -> {close()}
 */

import { limitWords, loadCatalog } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { scrolledTable, tableHead } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { moment } from "../lib/numbers.js";
import { button, empty, link, pageOf } from "../lib/view_states.js";
import { createLimitForm, rangeText } from "./form.js";

export function show(element, { id, api, navigate }) {
  const path = `/limit-sets/${encodeURIComponent(id ?? "")}`;
  return loadingView(element, id ? { title: "Limit set", text: "Loading versions", build: buildOne } : { title: "Limit sets", text: "Loading limit sets", build });

  async function build() {
    const [catalog, sets] = await Promise.all([loadCatalog(api), api.get("/limit-sets")]);
    const rows = sets.map(({ id: set, name, newest, created }) =>
      h("tr", {}, h("th", { scope: "row" }, h("a", { href: `#/limits/${set}` }, name)), h("td", { class: "number" }, newest), h("td", { class: "nowrap" }, moment(created))));
    const form = createLimitForm({
      catalog, newest: null, word: "Create the limit set", route: "POST /limit-sets",
      send: async (version) => navigate(`#/limits/${(await api.post("/limit-sets", version)).limit_set}`),
    });
    const list = sets.length
      ? scrolledTable({ heads: [["Name"], ["Newest version", 1], ["Created"]], rows })
      : empty(
          "No limit set yet",
          "Exceedances are measured against each monitor's own limits. A limit set replaces them for live flights and can depend on the flight condition.",
          button("Create a limit set", () => form.querySelector("input").focus(), { class: "button button-primary", ...needs("POST /limit-sets") }),
          guideLink("limit-sets", "how to use limit sets"),
        );
    return pageOf("Limit sets", [link("Fly", "#/fly"), link("Monitors", "#/monitors")], list, form);
  }

  async function buildOne({ again }) {
    const [catalog, versions] = await Promise.all([loadCatalog(api), api.get(path)]);
    const [newest] = versions;
    const form = createLimitForm({
      catalog, newest, word: `Create version ${newest.version + 1}`, route: "POST /limit-sets/{}/versions",
      send: async (version) => {
        await api.post(`${path}/versions`, version);
        again();
      },
    });
    return pageOf(newest.name, [link("All limit sets", "#/limits"), link("Fly", "#/fly")], ...versions.map((version) => versionPanel(version, catalog)), form);
  }
}

function versionPanel({ version, by, created, text, cases }, catalog) {
  const { conditions } = catalog;
  const rows = cases.map(({ name, ranges, limits }) =>
    h("tr", {},
      h("th", { scope: "row" }, name),
      ...conditions.map(({ key }) => h("td", { class: "nowrap" }, rangeText(ranges[key]))),
      h("td", {}, limitWords(catalog, limits))));
  const heads = conditions.map(({ label, unit }) => [`${label}${unit && ` [${unit}]`}`]);
  return h("section", { class: "panel", "aria-label": `Version ${version}` },
    h("h2", {}, `Version ${version}`),
    h("p", {}, `By ${by}, ${moment(created)}${text ? `: ${text}` : ""}`),
    h("table", { class: "table" }, tableHead([["Condition"], ...heads, ["Limits"]]), h("tbody", {}, rows)));
}
