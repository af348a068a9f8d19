/** Storage: disk use of database and recordings, the largest and oldest flights and recordings, and retention. */

import { reason } from "../lib/api.js";
import { createKeepButton, errorLine, factList, guideLink, h, link, loadingView, pageOf, table } from "../lib/dom.js";
import { sentence } from "../lib/monitors.js";
import { bytesText, capital, moment } from "../lib/numbers.js";

const PAGES = { flight: "fly", recording: "recordings" };
const PATHS = { flight: "flights", recording: "recordings" };

export function show(element, { api }) {
  return loadingView(element, { title: "Storage", text: "Measuring disk use", loads: ["/storage"], build });

  function build(_, stored) {
    const { space, kinds, largest, oldest } = stored;
    const failure = errorLine();
    return pageOf(
      "Storage",
      [
        link("Flights", "#/fly"),
        link("Recordings", "#/recordings"),
        guideLink("keeping-data#what-takes-the-space", "what takes the space"),
      ],
      space.warning ? h("p.error", { role: "alert" }, sentence(space.warning)) : null,
      h("section.panel", { "aria-label": "Disk" }, factList(factsOf(stored))),
      table({ columns: KINDS, items: kinds }),
      failure.element,
      listOf("Largest flights and recordings", largest),
      listOf("Oldest flights and recordings", oldest),
      h(
        "p.dim",
        h("code", "forewarn retain"),
        " deletes old data, daily if ",
        h("code", "FOREWARN_RETAIN_DAYS"),
        " or ",
        h("code", "FOREWARN_RETAIN_GB"),
        " is set. Data kept permanently are never deleted.",
      ),
    );

    function listOf(title, items) {
      if (items.length === 0) return null;
      const columns = [
        ["Name", ({ kind, id, name }) => h("a", { href: `#/${PAGES[kind]}/${id}` }, name), "name"],
        ["Kind", ({ kind }) => kind, "nowrap"],
        ["Size", ({ size }) => bytesText(size), "number"],
        ["Ended or uploaded", ({ since }) => moment(since), "date"],
        ["Retention", keepButton],
      ];
      return h("section.stack-tight", h("h2", title), table({ columns, items }));
    }

    function keepButton({ kind, id, name, keep }) {
      const fail = (error) => failure.show(reason(error));
      return createKeepButton({
        api,
        path: `/${PATHS[kind]}/${id}`,
        keep,
        fail,
        name,
        attributes: { class: "button button-small" },
      });
    }
  }
}

const KINDS = [
  ["Kind", ({ kind }) => `${capital(kind)}s`, "name"],
  ["Number", ({ n }) => n, "number"],
  ["Kept permanently", ({ kind, n_kept: n }) => (kind in PATHS ? n : "–"), "number"],
  ["Size", ({ size }) => bytesText(size), "number"],
  ["Oldest", ({ oldest }) => moment(oldest)],
];

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
