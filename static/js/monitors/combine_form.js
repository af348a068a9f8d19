/** Combine monitors of one planned test: choose members and lead time; then the job, then the new monitor's page. */

import { checkbox, createForm, fieldset, group, labelled, optionalName, select } from "../forms/controls.js";
import { createFields } from "../forms/form.js";
import { ApiError } from "../lib/api.js";
import { isSimulated, loadCatalog, methodWords, testNames } from "../lib/catalog.js";
import { empty, guideLink, h, link, loadingView, pageOf, table } from "../lib/dom.js";
import { warningMark } from "../lib/monitors.js";
import { figure } from "../lib/numbers.js";

const TITLE = "Combine monitors";

export function showCombining(element, { api, navigate }) {
  return loadingView(element, { title: TITLE, text: "Loading monitors", loads: [loadCatalog, "/monitors"], build });

  function build({ keep }, catalog, monitors) {
    const members = monitors.filter(isMember);
    const content =
      members.length < 2
        ? empty(
            "Not enough monitors",
            "A combination needs at least two monitors of one planned test, such as for 0.25 and 0.5 s ahead. Combinations and monitors calibrated by groups cannot be members.",
            link("Train a monitor", "#/monitors/new", true),
          )
        : formOf({ catalog, members, api, navigate, keep });
    return pageOf(TITLE, [guideLink("first-monitor#several-monitors-as-one", "combinations")], content);
  }
}

function isMember(monitor) {
  const { groups, predictor } = monitor.recipe;
  const isPooled = (groups?.kind ?? "pooled") === "pooled";
  return isPooled && predictor?.kind !== "combination" && isSimulated(monitor);
}

function formOf({ catalog, members, api, navigate, keep }) {
  const { schema, default: usual } = catalog.recipes.combination;
  const fields = createFields(schema, usual, { catalog, path: "combination", hidden: ["lead"] });
  const boxes = members.map(({ id, name }) => checkbox({ value: id, "aria-label": name, id: `member-${id}` }));
  const lead = select([], { id: "combination-lead" });
  const leadField = labelled("warning lead time", lead, {
    unit: "s",
    hint: "that of one member; an alert counts if it comes at least this early",
  });
  const named = optionalName("name of the monitor", "combination-name");
  const chosen = () => members.filter((_, k) => boxes[k].checked);
  const { element } = createForm({
    title: TITLE,
    word: "Combine",
    route: "POST /monitors/combinations",
    fields: [fields, group({ "combination.lead": leadField, name: named })],
    content: [
      fieldset(
        "1  Members",
        h("p.hint", "The combination shows the highest risk of its members and is calibrated as a whole. All members need the same planned test."),
        h("div", { onchange: follow }, memberTable(members, boxes, catalog)),
      ),
      fieldset("2  Promise", h("div.field-grid", leadField.element, fields.keys.map(fields.element), named.element)),
    ],
    beside: link("Cancel", "#/monitors"),
    send,
    follow: {
      api,
      keep,
      title: () => "Calibrating the combination",
      done: ({ monitor }) => navigate(`#/monitors/${monitor}`),
    },
  });
  follow();
  return element;

  function follow() {
    const before = lead.value;
    const leads = [...new Set(chosen().map((member) => member.lead))].sort((a, b) => a - b);
    const options = leads.map((value) => h("option", { value }, figure(value)));
    lead.replaceChildren(...(options.length ? options : [h("option", "choose members first")]));
    if (leads.map(String).includes(before)) lead.value = before;
    lead.disabled = leads.length === 0;
  }

  function send() {
    if (chosen().length < 2) throw new ApiError("Choose at least two members.", 0);
    return api.post("/monitors/combinations", {
      ...fields.read(),
      lead: Number(lead.value),
      monitors: chosen().map(({ id }) => id),
      ...named.read(),
    });
  }
}

function memberTable(members, boxes, catalog) {
  const ticked = (monitor, k) => h("label.row", { for: boxes[k].id }, boxes[k], monitor.name, warningMark(monitor));
  const columns = [
    ["Member", ticked],
    ["Aircraft", (monitor) => testNames(catalog, monitor)[0]],
    ["Manoeuvre", (monitor) => testNames(catalog, monitor)[1], "nowrap"],
    ["Method", ({ recipe }) => methodWords(catalog, recipe)],
    ["Warning lead time [s]", (member) => figure(member.lead), "number"],
  ];
  return table({ columns, items: members, panel: false });
}
