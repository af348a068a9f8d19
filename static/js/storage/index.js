/**
 * Storage: disk use of database and recordings, the largest and oldest flights and recordings, and retention.
 *
 * Exports  show(element, {api}) -> {close()}
 */

import { reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { createKeepButton } from "../lib/keep_button.js";
import { factList, tableHead } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { bytesText, moment } from "../lib/numbers.js";
import { errorLine, link, pageOf } from "../lib/view_states.js";

const PAGES = { flight: "fly", recording: "recordings" };
const PATHS = { flight: "flights", recording: "recordings" };

export function show(element, { api }) {
  return loadingView(element, { title: "Storage", text: "Measuring disk use", build });

  async function build() {
    const usage = await api.get("/storage");
    const failure = errorLine();
    const list = (title, things) => listOf(title, things, (thing) => keepButton(thing, failure));
    return pageOf(
      "Storage",
      [link("Flights", "#/fly"), link("Recordings", "#/recordings"), guideLink("keeping-data#what-takes-the-space", "what takes the space")],
      usage.space.warning ? h("p", { class: "error", role: "alert" }, `◆ ${sentence(usage.space.warning)}`) : null,
      h("section", { class: "panel", "aria-label": "Disk" }, factList(factsOf(usage))),
      kindTable(usage.kinds),
      failure.element,
      list("Largest flights and recordings", usage.largest),
      list("Oldest flights and recordings", usage.oldest),
      h("p", { class: "dim" }, h("code", {}, "forewarn retain"), " deletes old data, daily if ", h("code", {}, "FOREWARN_RETAIN_DAYS"), " or ", h("code", {}, "FOREWARN_RETAIN_GB"), " is set. Data kept permanently are never deleted."),
    );
  }

  function keepButton({ kind, id, name, keep }, failure) {
    const fail = (error) => failure.show(reason(error));
    return createKeepButton({ api, path: `/${PATHS[kind]}/${id}`, keep, fail, name, attributes: { class: "button button-small" } });
  }
}

function factsOf({ space, database, reusable, recordings, journals }) {
  return [
    ["Free on the disk", bytesText(space.free)],
    ["Disk size", bytesText(space.total)],
    ["Database", database === null ? "on another server" : bytesText(database)],
    ["Reusable in the database", reusable === null ? "–" : bytesText(reusable)],
    ["Recordings", bytesText(recordings)],
    ["Live flights without a recording", bytesText(journals)],
  ];
}

function kindTable(kinds) {
  const rows = kinds.map(({ kind, n, n_kept: kept, size, oldest }) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, `${kind.charAt(0).toUpperCase()}${kind.slice(1)}s`),
      h("td", { class: "number", "data-label": "Number" }, n),
      h("td", { class: "number", "data-label": "Kept permanently" }, kind in PATHS ? kept : "–"),
      h("td", { class: "number", "data-label": "Size" }, bytesText(size)),
      h("td", { "data-label": "Oldest" }, moment(oldest)),
    ),
  );
  return tableOf([["Kind"], ["Number", 1], ["Kept permanently", 1], ["Size", 1], ["Oldest"]], rows);
}

function listOf(title, things, control) {
  if (things.length === 0) return null;
  const rows = things.map((thing) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, h("a", { href: `#/${PAGES[thing.kind]}/${thing.id}` }, thing.name)),
      h("td", { class: "nowrap", "data-label": "Kind" }, thing.kind),
      h("td", { class: "number", "data-label": "Size" }, bytesText(thing.size)),
      h("td", { class: "dim nowrap", "data-label": "Ended or uploaded" }, moment(thing.since)),
      h("td", {}, control(thing)),
    ),
  );
  const heads = [["Name"], ["Kind"], ["Size", 1], ["Ended or uploaded"], ["Retention"]];
  return h("section", { class: "stack-tight" }, h("h2", {}, title), tableOf(heads, rows));
}

function tableOf(heads, rows) {
  return h("div", { class: "table-scroll panel" }, h("table", { class: "table table-cards" }, tableHead(heads), h("tbody", {}, rows)));
}

function sentence(text) {
  return `${text.charAt(0).toUpperCase()}${text.slice(1)}.`;
}
