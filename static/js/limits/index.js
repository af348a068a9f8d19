/** Limit sets: #/limits lists them and creates one; #/limits/{id} shows its versions and adds the next. */

import { conditionColumns, createCaseForm } from "../forms/conditions.js";
import { createFields } from "../forms/form.js";
import { needs } from "../lib/api.js";
import { limitWords, loadCatalog } from "../lib/catalog.js";
import { button, empty, formatted, guideLink, h, link, loadingView, pageOf, panel, table } from "../lib/dom.js";
import { moment } from "../lib/numbers.js";

const COLUMNS = [
  ["Name", ({ id, name }) => h("a", { href: `#/limits/${id}` }, name), "name"],
  ["Newest version", ({ newest }) => newest, "number"],
  ["Created", ({ created }) => moment(created), "date"],
];

export function show(element, { id, api, navigate }) {
  const path = `/limit-sets/${encodeURIComponent(id ?? "")}`;
  const view = id
    ? { title: "Limit set", text: "Loading versions", loads: [loadCatalog, path], build: buildOne }
    : { title: "Limit sets", text: "Loading limit sets", loads: [loadCatalog, "/limit-sets"], build };
  return loadingView(element, view);

  function build(_, catalog, sets) {
    const form = createLimitForm({
      catalog,
      newest: null,
      word: "Create the limit set",
      route: "POST /limit-sets",
      send: async (version) => navigate(`#/limits/${(await api.post("/limit-sets", version)).limit_set}`),
    });
    const begin = button("Create a limit set", () => form.querySelector("input").focus(), {
      class: "button button-primary",
      ...needs("POST /limit-sets"),
    });
    const list = sets.length
      ? table({ columns: COLUMNS, items: sets })
      : empty(
          "No limit set yet",
          "Exceedances are measured against each monitor's own limits. A limit set replaces them for live flights and can depend on the flight condition.",
          begin,
          guideLink("limit-sets", "how to use limit sets"),
        );
    return pageOf("Limit sets", [link("Fly", "#/fly"), link("Monitors", "#/monitors")], list, form);
  }

  function buildOne({ again }, catalog, versions) {
    const [newest] = versions;
    const form = createLimitForm({
      catalog,
      newest,
      word: `Create version ${newest.version + 1}`,
      route: "POST /limit-sets/{}/versions",
      send: async (version) => {
        await api.post(`${path}/versions`, version);
        again();
      },
    });
    const actions = [link("All limit sets", "#/limits"), link("Fly", "#/fly")];
    return pageOf(newest.name, actions, ...versions.map((version) => versionPanel(version, catalog)), form);
  }
}

/** newest: the version to begin with; null for a new set. */
function createLimitForm({ catalog, newest, word, route, send }) {
  const { schema } = catalog.families.limits.entries.limits;
  return createCaseForm({
    catalog,
    word,
    route,
    heading: newest === null ? "New limit set" : "Next version",
    hint: "A version never changes, and each flight records its version. Conditions must not overlap; an empty field is unbounded.",
    nameless: newest === null ? "No name was given: name the limit set." : null,
    cases: newest?.cases ?? [{ name: "any condition", ranges: {} }],
    contentOf: ({ limits }) => {
      const fields = createFields(schema, limits, { catalog, path: "limits" });
      return { elements: h("div.field-grid", fields.keys.map(fields.element)), check: fields.check, read: () => ({ limits: fields.read() }) };
    },
    send,
  });
}

function versionPanel({ version, by, created, text, cases }, catalog) {
  const columns = [...conditionColumns(catalog), ["Limits", ({ limits }) => formatted(limitWords(catalog, limits))]];
  return panel(
    `Version ${version}`,
    [h("p", `By ${by}, ${moment(created)}${text ? `: ${text}` : ""}`), table({ columns, items: cases, panel: false })],
    { "aria-label": `Version ${version}` },
  );
}
