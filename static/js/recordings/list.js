/** List of recordings, with upload. Exports  showRecordings(element, context). */

import { loadCatalog } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { hiddenHead, tableHead } from "../lib/lists.js";
import { loadingView } from "../lib/loading_view.js";
import { needs } from "../lib/me.js";
import { bytesText, durationText, moment } from "../lib/numbers.js";
import { askToConfirm, button, empty, link, pageOf } from "../lib/view_states.js";
import { createDropZone } from "./drop_zone.js";
import { mappingState } from "./words.js";

export function showRecordings(element, { api, navigate }) {
  return loadingView(element, { title: "Recordings", text: "Loading recordings", build });

  async function build({ keep }) {
    const [catalog, recordings] = await Promise.all([loadCatalog(api), api.get("/recordings")]);
    const formats = catalog.telemetry.formats;
    const aircraft = [
      ...new Set(recordings.map(({ aircraft }) => aircraft).filter(Boolean)),
    ].sort();
    const zone = keep(
      createDropZone({ aircraft, formats: formats.map(formatWords), done: arrived }),
    );
    const list = h("div", {}, listOf(recordings));
    return pageOf("Recordings", [link("Storage", "#/storage")], zone.element, list);

    async function arrived(uploaded, someFailed) {
      if (uploaded.length === 1 && !someFailed) navigate(`#/recordings/${uploaded[0].id}`);
      else list.replaceChildren(listOf(await api.get("/recordings")));
    }

    function listOf(all) {
      if (all.length) return table(all, catalog, remove);
      return empty(
        "No recording yet",
        "A recording is a telemetry file from any recorder. Upload one, check which signal is which channel, then score it with a monitor.",
        button("Choose a file", zone.choose, { class: "button button-primary", ...needs("POST /recordings") }),
        guideLink("first-recording", "how to score a first recording"),
      );
    }

    function remove({ id, name, n_scorings: scorings }) {
      const also = scorings ? `, ${scorings} ${scorings === 1 ? "scoring" : "scorings"}` : "";
      askToConfirm(
        `Delete the recording “${name}”?`,
        `Deletes the file${also} and its notes permanently.`,
        "Delete permanently",
        async () => {
          await api.delete(`/recordings/${id}`);
          list.replaceChildren(listOf(await api.get("/recordings")));
        },
      );
    }
  }
}

function table(recordings, catalog, remove) {
  const heads = [
    ["Name"],
    ["Aircraft"],
    ["Length", 1],
    ["Format"],
    ["Size", 1],
    ["Mapping"],
    ["Scorings", 1],
    ["Uploaded"],
    hiddenHead("Delete"),
  ];
  const rows = recordings.map((recording) => {
    const { word, level, text } = mappingState(recording);
    return h(
      "tr",
      {},
      h("th", { scope: "row" }, h("a", { href: `#/recordings/${recording.id}` }, recording.name), twinMark(recording, recordings)),
      h(
        "td",
        { class: "nowrap", "data-label": "Aircraft" },
        recording.aircraft ?? h("span", { class: "dim" }, "not recorded"),
      ),
      h("td", { class: "number", "data-label": "Length" }, durationText(recording.duration)),
      h("td", { "data-label": "Format" }, formatTitle(catalog, recording.format)),
      h("td", { class: "number", "data-label": "Size" }, bytesText(recording.size)),
      h(
        "td",
        { "data-label": "Mapping" },
        h("span", { class: "chip", "data-level": level, title: text }, word),
      ),
      h("td", { class: "number", "data-label": "Scorings" }, recording.n_scorings),
      h("td", { class: "dim", "data-label": "Uploaded" }, moment(recording.created)),
      h(
        "td",
        {},
        button("Delete", () => remove(recording), {
          class: "button button-small",
          "aria-label": `Delete ${recording.name}`,
          ...needs("DELETE /recordings/{}"),
        }),
      ),
    );
  });
  return h(
    "div",
    { class: "table-scroll panel" },
    h(
      "table",
      { class: "table table-cards recording-table" },
      tableHead(heads),
      h("tbody", {}, rows),
    ),
  );
}

/** Mark of a recording whose file was uploaded before. */
function twinMark({ same_as: twin }, recordings) {
  if (!twin) return null;
  const earlier = recordings.find(({ id }) => id === twin);
  return h("span", { class: "list-mark" }, "same file as ", h("a", { href: `#/recordings/${twin}` }, earlier?.name ?? "an earlier one"));
}

export function formatTitle(catalog, key) {
  return catalog.telemetry.formats.find((format) => format.key === key)?.title ?? key;
}

function formatWords({ title, installed, experimental }) {
  if (!installed) return `${title} (not installed)`;
  return experimental ? `${title} (experimental)` : title;
}
