/** Add rollouts of any simulator, or flown ones: choose files or recordings, set roles and limits, store them. */

import { createForm, fieldset, fold, group, labelled, numberInput, optionalName, select, textInput } from "../forms/controls.js";
import { createDropTarget } from "../forms/drop_target.js";
import { needs, reason } from "../lib/api.js";
import { channelName, loadCatalog } from "../lib/catalog.js";
import { errorLine, formatted, guideLink, h, link, loadingView, pageOf, table } from "../lib/dom.js";
import { bytesText, capital, count, counted, decimal, figure, magnitude, magnitudeIn, shownIn } from "../lib/numbers.js";
import { createFlownFlights } from "./flown_flights.js";

const TITLE = "Add rollouts";
const ROLES = [
  ["output", "output"],
  ["control", "control"],
  ["condition", "condition"],
];
const FORMATS = "npz, MATLAB or HDF5 arrays; one CSV or Parquet table with a column flight; or one file for each flight";

export function showRollouts(element, { query, api, navigate }) {
  return loadingView(element, { title: TITLE, text: "Loading the catalog", loads: [loadCatalog, "/datasets"], build });

  async function build({ keep }, catalog, datasets) {
    const stage = h("div.stack");
    const status = h("p", { role: "status" });
    const failure = errorLine();
    const more = createMore({ again: () => read(true) });
    const flown = await createFlownFlights({ api, datasets, chosen: query.getAll("recording"), changed: clear, use: () => read() });
    const zone = keep(
      createDropTarget({
        words: "Drop the flights of your simulator anywhere on this page",
        label: "files of rollouts",
        word: "Choose files",
        hint: `Formats: ${FORMATS}`,
        take: (chosen) => {
          files = chosen;
          read();
        },
        ...needs("POST /datasets"),
      }),
    );
    const named = optionalName("name of the dataset", "dataset-name");
    let files = [];
    let rows = [];
    let turn = 0;
    let sending = null;
    keep({ close: () => sending?.cancel() });
    const source = h("section.panel.stack", { "aria-label": "Files" }, zone.element, flown.element, status, failure.element, more.element);
    return pageOf([TITLE, " ", guideLink("own-simulator", "rollouts of your own simulator")], [link("Cancel", "#/datasets")], source, stage);

    function clear() {
      rows = [];
      stage.replaceChildren();
      stop();
    }

    function stop() {
      turn += 1;
      failure.show("");
      status.textContent = "";
      sending?.cancel();
    }

    /** again: the same files, so the form keeps what was typed in it. */
    async function read(again = false) {
      if (again) stop();
      else clear();
      const mine = turn;
      if (!files.length && !flown.count()) return;
      const what = namesOf(files, flown.count());
      try {
        const preview = await send("/datasets/preview", [...more.fields(), ...flown.fields()], `Reading ${what}`);
        if (mine !== turn || preview === null) return;
        status.replaceChildren(...wordsOf(what, preview));
        const focused = document.activeElement;
        stage.replaceChildren(createChannels(preview));
        if (focused instanceof HTMLElement && stage.contains(focused)) focused.focus();
      } catch (error) {
        if (mine !== turn) return;
        status.textContent = "";
        failure.show(withName(reason(error), files[0]?.name));
        more.open();
      }
    }

    function send(path, fields, words) {
      const form = new FormData();
      for (const [name, value] of fields) form.append(name, value);
      for (const file of files) form.append("file", file, file.name);
      sending?.cancel();
      sending = api.upload(path, form, (sent, total) => {
        status.textContent = sent < total ? `Sending: ${bytesText(sent)} of ${bytesText(total)}` : words;
      });
      status.textContent = words;
      return sending.ended;
    }

    function createChannels(preview) {
      const isJoining = flown.dataset() !== "";
      const typed = new Map(rows.map((row) => [row.of, row]));
      rows = isJoining ? [] : preview.dictionary.channels.map((channel) => createRow(channel, preview.ranges[channel.key], typed));
      const { element: form } = createForm({
        title: TITLE,
        word: "Add",
        route: "POST /datasets",
        fields: [group({ name: named, dt: more.interval }, () => rows.map((row) => [row, row.wrong()]))],
        content: [
          fieldset(
            isJoining ? "Dataset" : "Channels and limits",
            h("p.hint", isJoining ? "Channels and limits are those of the dataset. It stays as it is: a new one holds both." : hintOf(preview)),
            isJoining ? null : table({ columns: COLUMNS, items: rows, classes: "channel-table", panel: false }),
            h("div.field-grid", named.element),
          ),
        ],
        send: add,
        follow: {
          api,
          keep,
          title: ({ request }) => `Adding “${request.name}”`,
          done: ({ dataset }) => navigate(`#/datasets/${dataset}`),
        },
      });
      return form;

      async function add() {
        const fields = [...(isJoining ? [] : chosen()), ...flown.fields(), ...Object.entries(named.read())];
        const before = [...status.childNodes];
        try {
          return await send("/datasets", fields, "Sent");
        } finally {
          status.replaceChildren(...before);
        }
      }

      function chosen() {
        const channels = preview.dictionary.channels.map((channel, k) => ({ ...channel, role: rows[k].role.value }));
        return [
          ...more.fields().filter(([name]) => name !== "dictionary"),
          ["dictionary", JSON.stringify({ ...preview.dictionary, channels })],
          ...rows.flatMap((row) => row.limit().map((text) => ["limit", text])),
          ...more.limits(),
        ];
      }
    }
  }
}

const COLUMNS = [
  ["Channel", ({ channel }) => formatted(channelName(channel)), "name"],
  ["Unit", ({ unit }) => unit || "none", "nowrap"],
  ["Least to greatest", ({ range }) => range, "number"],
  ["Role", ({ role }) => h("div.field", role)],
  ["Limit: low", ({ low }) => h("div.field", low.control)],
  ["Limit: high", ({ high, failure }) => h("div.field", high.control, failure.element)],
];

/** The row of the channel, or that of `typed` if it is of the same channel and values. */
function createRow(channel, { low, high, rest }, typed) {
  const of = JSON.stringify([channel, low, high, rest]);
  if (typed.has(of)) return typed.get(of);
  const { unit, factor } = shownIn(channel);
  const spoken = (end) => `${end} limit of ${channel.label}`;
  const ends = ["low", "high"].map((end) => {
    const control = textInput({ inputmode: "decimal", "aria-label": spoken(end), placeholder: "none", size: 8, oninput: () => failure.show("") });
    const read = () => (control.value.trim() ? decimal(control.value.trim()) / factor : null);
    return { control, read };
  });
  const failure = errorLine();
  return {
    of,
    channel,
    unit,
    range: low === null ? "no value" : `${magnitude(channel, low)} to ${magnitude(channel, high)}`,
    role: select(ROLES, { "aria-label": `role of ${channel.label}`, value: channel.role, disabled: Boolean(channel.formula) }),
    low: ends[0],
    high: ends[1],
    failure,
    wrong,
    say: failure.show,
    focus: () => ends[0].control.focus(),
    limit: () => {
      const [least, most] = ends.map(({ read }) => read());
      return least === null && most === null ? [] : [`${channel.key}=${least ?? ""}..${most ?? ""}`];
    },
  };

  function wrong() {
    const [least, most] = ends.map(({ read }) => read());
    const trim = rest ?? 0;
    if (Number.isNaN(least) || Number.isNaN(most)) return "Give a number, or leave it empty.";
    const isBetween = (least ?? -Infinity) < trim && trim < (most ?? Infinity);
    return isBetween ? "" : `Trimmed flight, at ${magnitudeIn(channel, trim)}, must be between the limits.`;
  }
}

/** What only some files need: a dictionary, a sample interval, computed channels, limits in words. */
function createMore({ again }) {
  let dictionary = null;
  const file = h("input", {
    type: "file",
    accept: ".csv,.json",
    onchange: () => {
      [dictionary] = file.files;
      again();
    },
  });
  const dt = numberInput({ id: "rollouts-dt", min: 0, placeholder: "as in the files", onchange: again });
  const interval = labelled("sample interval", dt, { unit: "s", hint: "Only if the files have neither times nor dt." });
  const lines = (placeholder) => h("textarea", { rows: 2, spellcheck: "false", placeholder });
  const computed = lines("load [kN] = 0.7*Nz*mass");
  const limits = lines("Nz=..4.9 for 0.2 s");
  const element = fold(
    "Dictionary, sample interval, computed channels",
    h(
      "div.field-grid",
      labelled("dictionary", file, { hint: "CSV or JSON with key and unit of each channel, if the files do not name them." }).element,
      interval.element,
      labelled("computed channels", computed, { hint: "One per line: key [unit] = formula." }).element,
      labelled("limits in words", limits, { hint: "One per line: limits on computed channels, with a duration, or requirements such as always (Nz < 4.9 or alpha < 0.2)." }).element,
    ),
  );
  const given = (name, text) => (text.trim() ? [[name, text.trim()]] : []);
  return {
    element,
    interval,
    fields: () => [...(dictionary ? [["dictionary", dictionary]] : []), ...given("dt", dt.value)],
    limits: () => [...given("channel", computed.value), ...given("limit", limits.value)],
    open: () => (element.open = true),
  };
}

/** The server's sentence, which begins with a capital, with a file's name as it is. */
function withName(words, name = "") {
  return words.toLowerCase().startsWith(name.toLowerCase()) ? name + words.slice(name.length) : words;
}

function namesOf(files, n) {
  const flown = n ? [counted(n, "recording")] : [];
  const names = files.length > 1 ? [`${files.length} files`] : files.map(({ name }) => name);
  return [...names, ...flown].join(", ");
}

function wordsOf(what, { n_flights: n, n_samples: samples, dt, n_flown: flown, findings }) {
  const of = flown ? `, ${count(flown)} of them flown,` : "";
  const words = `${what}: ${count(n)} flights${of} of up to ${figure((samples - 1) * dt)} s, one sample every ${figure(dt)} s.`;
  return [words, ...findings.map((text) => h("span.hint.hint-line", `${capital(text)}.`))];
}

function hintOf({ n_failing: failing, n_flights: n }) {
  if (failing === null) return "The files label no failures: a flight fails if it exceeds a limit. Set at least one limit, in the unit of its row.";
  return `By their labels, ${count(failing)} of ${count(n)} flights fail. Limits are optional; where they disagree, the label counts.`;
}
