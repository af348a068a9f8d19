/**
 * The Recordings page: #/recordings lists and uploads; #/recordings/{id} is one recording,
 * with ?monitor={mid} chosen to score it, with ?scoring={sid} one of its scorings, with ?compare={sid},{rid}:{sid} several side by side.
 */

import { needs } from "../lib/api.js";
import { loadCatalog } from "../lib/catalog.js";
import { button, chip, deleteButton, empty, guideLink, h, hiddenHead, link, loadingView, pageOf, table } from "../lib/dom.js";
import { createLongList } from "../lib/long_list.js";
import { bytesText, durationText, moment } from "../lib/numbers.js";
import { showComparedScorings } from "./compare/index.js";
import { createDropZone } from "./drop_zone.js";
import { formatTitle } from "./facts.js";
import { aircraftOf, deletion, showRecording } from "./page.js";
import { showScoring } from "./scoring/page.js";
import { mappingState } from "./words.js";

const LISTED = 50;

export function show(element, context) {
  const { id, query } = context;
  if (!id) return showRecordings(element, context);
  if (query.get("scoring")) return showScoring(element, context);
  if (query.get("compare")) return showComparedScorings(element, context);
  return showRecording(element, context);
}

function showRecordings(element, { api, navigate }) {
  return loadingView(element, { title: "Recordings", text: "Loading recordings", loads: [loadCatalog], build });

  async function build({ keep }, catalog) {
    const formats = catalog.telemetry.formats.map(formatWords);
    const shown = h("div");
    let aircraft = [];
    const list = createLongList({ api, path: "/recordings", search: "Search recordings", step: LISTED, show });
    await list.load();
    const zone = keep(createDropZone({ aircraft, formats, done: arrived }));
    return pageOf("Recordings", [list.box, link("Archives", "#/archives"), link("Storage", "#/storage")], zone.element, shown, list.more);

    function show(recordings, text) {
      aircraft = aircraftOf(recordings);
      shown.replaceChildren(listOf(recordings, text));
    }

    async function arrived(uploaded, someFailed) {
      if (uploaded.length === 1 && !someFailed) navigate(`#/recordings/${uploaded[0].id}`);
      else await list.load();
    }

    function listOf(all, text) {
      if (all.length) return table({ columns: columnsOf(all), items: all, classes: "recording-table" });
      if (text) return empty("No recording found", `No name has “${text}” in it.`);
      return empty(
        "No recording yet",
        "A recording is a telemetry file from any recorder. Upload one, check which signal is which channel, then score it with a monitor.",
        button("Choose a file", () => zone.choose(), { class: "button button-primary", ...needs("POST /recordings") }),
        guideLink("first-recording", "how to score a first recording"),
      );
    }

    function columnsOf(all) {
      return [
        ["Name", nameOf, "name"],
        ["Aircraft", ({ aircraft }) => aircraft ?? h("span.dim", "not recorded"), "nowrap"],
        ["Length", ({ duration }) => durationText(duration), "number"],
        ["Format", ({ format }) => formatTitle(catalog, format)],
        ["Size", ({ size }) => bytesText(size), "number"],
        ["Mapping", mappingChip],
        ["Scorings", ({ n_scorings: n }) => n, "number"],
        ["Uploaded", ({ created }) => moment(created), "dim"],
        [hiddenHead("Delete"), deleteOf],
      ];

      function nameOf(recording) {
        return [h("a", { href: `#/recordings/${recording.id}` }, recording.name), twinMark(recording, all)];
      }

      function deleteOf(recording) {
        return deleteButton({ api, ...deletion(recording), done: list.load, short: recording.name });
      }
    }
  }
}

function mappingChip(recording) {
  const { word, level, text } = mappingState(recording);
  return chip(word, level, text);
}

function twinMark({ same_as: twin }, recordings) {
  if (!twin) return null;
  const earlier = recordings.find(({ id }) => id === twin);
  const name = h("a", { href: `#/recordings/${twin}` }, earlier?.name ?? "an earlier one");
  return h("span.list-mark", "same file as ", name);
}

function formatWords({ title, installed, experimental }) {
  if (!installed) return `${title} (not installed)`;
  return experimental ? `${title} (experimental)` : title;
}
