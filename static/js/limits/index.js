/**
 * Limit sets: #/limits lists them and makes one; #/limits/{id} has its versions and makes the next.
 *
 * Exports  show(element, {id, api, navigate}) -> {close()}
 */

import { limitWords, loadCatalog } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { tableHead } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { moment } from "../lib/numbers.js";
import { empty, link, pageOf } from "../lib/view_states.js";
import { createLimitForm, rangeText } from "./form.js";

export function show(element, { id, api, navigate }) {
  const path = `/limit-sets/${encodeURIComponent(id ?? "")}`;
  return loadingView(element, id ? { title: "Limit set", text: "Reading its versions", build: buildOne } : { title: "Limit sets", text: "Looking up the limit sets", build });

  async function build() {
    const [catalog, sets] = await Promise.all([loadCatalog(api), api.get("/limit-sets")]);
    const rows = sets.map(({ id: set, name, newest, created }) =>
      h("tr", {}, h("th", { scope: "row" }, h("a", { href: `#/limits/${set}` }, name)), h("td", { class: "number" }, newest), h("td", { class: "nowrap" }, moment(created))));
    const list = sets.length
      ? h("table", { class: "table" }, tableHead([["Name"], ["Newest version", 1], ["Created"]]), h("tbody", {}, rows))
      : empty("No limit set yet", "Measured exceedances are held against each monitor's own limits until one is put in force.");
    const form = createLimitForm({
      catalog, newest: null, word: "Make the limit set", route: "POST /limit-sets",
      send: async (made) => navigate(`#/limits/${(await api.post("/limit-sets", made)).limit_set}`),
    });
    return pageOf("Limit sets", [link("Fly", "#/fly"), link("Monitors", "#/monitors")], list, form);
  }

  async function buildOne({ again }) {
    const [catalog, versions] = await Promise.all([loadCatalog(api), api.get(path)]);
    const [newest] = versions;
    const form = createLimitForm({
      catalog, newest, word: `Make version ${newest.version + 1}`, route: "POST /limit-sets/{}/versions",
      send: async (made) => {
        await api.post(`${path}/versions`, made);
        again();
      },
    });
    return pageOf(newest.name, [link("All limit sets", "#/limits"), link("Fly", "#/fly")], ...versions.map((version) => versionPanel(version, catalog)), form);
  }
}

/** A version as it stays for ever: who made it, when and why, and its conditions. */
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
