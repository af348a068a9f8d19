/** Upload recordings: drop files anywhere on the page, or choose them. Each shows its progress. */

import { labelled, textInput } from "../forms/controls.js";
import { createDropTarget } from "../forms/drop_target.js";
import { api, needs, reason } from "../lib/api.js";
import { button, h } from "../lib/dom.js";
import { bytesText } from "../lib/numbers.js";
import { badRowsTable } from "./facts.js";

const LONGEST_NAME = 200;
const small = (label) => ({ class: "button button-small", "aria-label": label });

export function knownNames(id, names) {
  const options = names.map((value) => h("option", { value }));
  return { element: h("datalist", { id }, options), attributes: { list: id, maxlength: LONGEST_NAME, autocomplete: "off" } };
}

export function createDropZone({ aircraft, formats, done }) {
  const known = knownNames("known-aircraft", aircraft);
  const name = textInput({ ...known.attributes, placeholder: "optional, such as PH-LAB" });
  const uploads = createUploads({ aircraft: () => name.value.trim(), done });
  const zone = createDropTarget({
    words: "Drop a recording anywhere on this page",
    label: "recorded telemetry file",
    hint: formats.length ? `Formats: ${formats.join(", ")}` : "",
    take: uploads.send,
  });
  const named = labelled("Aircraft", name, {
    hint: "Forewarn remembers the mapping for this aircraft and proposes it next time.",
  });
  const element = h(
    "section.panel.stack",
    { "aria-label": "Upload", ...needs("POST /recordings") },
    h("div.upload-columns", zone.element, h("div", named.element, known.element)),
    uploads.element,
  );
  return {
    element,
    choose: zone.choose,
    close: () => {
      zone.close();
      uploads.close();
    },
  };
}

/** Uploads in progress, and why a file was refused.   done([recording], someFailed)   all have ended; these succeeded */
function createUploads({ aircraft, done }) {
  const rows = h("ul.uploads");
  const sending = new Set();
  let uploaded = [];
  const close = () => sending.forEach((upload) => upload.cancel());
  return { element: rows, send: (files) => files.forEach(send), close };

  async function send(file) {
    const bar = h("progress.progress", { max: 1, value: 0, "aria-label": `sending ${file.name}` });
    const words = h("span.upload-words", { role: "status" }, "starting");
    const stop = button("Cancel", () => upload.cancel(), small(`Cancel ${file.name}`));
    const name = h("span.upload-name", file.name);
    const row = h("li.upload", { "data-status": "sending" }, name, words, stop, bar);
    rows.append(row);
    const craft = aircraft();
    const query = new URLSearchParams({ name: file.name.slice(-LONGEST_NAME), ...(craft && { aircraft: craft }) });
    const upload = api.upload(`/recordings?${query}`, file, (sent, total) => {
      if (sent === total) bar.removeAttribute("value");
      else bar.value = sent / total;
      words.textContent = sent === total ? "sent; the server is reading it" : `${bytesText(sent)} of ${bytesText(total)}`;
    });
    sending.add(upload);
    try {
      const recording = await upload.ended;
      if (recording) uploaded.push(recording);
      row.remove();
    } catch (error) {
      refuse(row, file, error);
    }
    sending.delete(upload);
    if (sending.size === 0 && uploaded.length) {
      const finished = uploaded;
      uploaded = [];
      done(finished, rows.children.length > 0);
    }
  }

  function refuse(row, file, error) {
    const isRetried = error.status === 0 || error.status >= 500;
    const again = () => {
      row.remove();
      send(file);
    };
    row.dataset.status = "refused";
    const badRows = error.problem?.bad_rows ?? [];
    const dismiss = button("Dismiss", () => row.remove(), small(`Dismiss ${file.name}`));
    const retry = isRetried && button("Try again", again, { class: "button button-small" });
    const parts = [
      h("span.upload-name", file.name),
      h("span.row", retry, dismiss),
      h("p.error", { role: "alert" }, withoutName(reason(error), file.name)),
      badRows.length && badRowsTable(badRows),
    ];
    row.replaceChildren(...parts.filter(Boolean));
  }
}

/** The server's sentence without the file name, which is shown above it. */
function withoutName(words, name) {
  const start = `${name}: `;
  if (!words.toLowerCase().startsWith(start.toLowerCase())) return words;
  return words.charAt(start.length).toUpperCase() + words.slice(start.length + 1);
}
