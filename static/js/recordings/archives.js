/**
 * The Archives page: #/archives lists them; #/archives/{id} is the summary of one and its flights, filtered as its
 * address says; with ?flight={fid} and &monitor={name} it is one of its flights.
 */

import { select } from "../forms/controls.js";
import { createAddress } from "../lib/address.js";
import { chip, empty, errorLine, factList, guideLink, h, link, loadingView, pageOf, panel, table } from "../lib/dom.js";
import { createLongList } from "../lib/long_list.js";
import { sentence } from "../lib/monitors.js";
import { count, figure, moment, riskText } from "../lib/numbers.js";
import { showArchivedFlight } from "./archived_flight.js";

const LISTED = 50;
const GROUPS = [
  ["", "monitor"],
  ["aircraft", "aircraft"],
  ["month", "month"],
  ["aircraft,month", "aircraft and month"],
];
const SOME = [
  ["", "all flights"],
  ["misses", "with misses"],
  ["exceedances", "with exceedances"],
  ["exceedances_as_recorded", "with exceedances as recorded only"],
  ["warned_late", "with late alerts"],
  ["false_alarms", "with false alarms"],
  ["not_valid", "with INVALID manoeuvres"],
];
const SORTS = [
  ["misses", "most misses"],
  ["exceedances", "most exceedances"],
  ["false_alarms", "most false alarms"],
  ["peak_risk", "highest risk"],
  ["flight", "name"],
];
const ADDS_UP =
  "Each manoeuvre is in time, late, a miss, a false alarm, quiet or without a verdict. Each exceedance, measured from trim, is in time, late, a miss or without a verdict; one as recorded only, or outside every manoeuvre, is counted apart.";
const BAD = (n) => (n ? chip(`◆ ${count(n)}`, "caution") : count(n));
const COUNTS = [
  ["Manoeuvres", ({ manoeuvres }) => count(manoeuvres), "number"],
  ["Exceedances", exceedancesOf, "number"],
  ["Alerts", ({ alerts }) => count(alerts), "number"],
  ["In time", ({ warned_in_time: n }) => count(n), "number"],
  ["Late", ({ warned_late: n }) => BAD(n), "number"],
  ["Misses", ({ misses }) => BAD(misses), "number"],
  ["False alarms", ({ false_alarms: n }) => count(n), "number"],
  ["Quiet", ({ quiet }) => count(quiet), "number"],
  ["No verdict", noVerdictOf, "number"],
  ["Applicable", validityOf, "number"],
];

export function show(element, context) {
  const { id, query } = context;
  if (id && query.get("flight")) return showArchivedFlight(element, context);
  if (id) return showArchive(element, context);
  return loadingView(element, { title: "Archives", text: "Loading archives", loads: ["/archives"], build });

  function build(_, archives) {
    const columns = [
      ["Name", ({ id: one, name, problem }) => (problem ? name : h("a", { href: `#/archives/${one}` }, name)), "name"],
      ["Flights", ({ n_flights: n, problem }) => (problem ? "–" : count(n)), "number"],
      ["Not scored", ({ n_failed: n, problem }) => (problem ? "–" : BAD(n)), "number"],
      ["Scored", ({ scored, version, problem }) => (problem ? h("span.error", sentence(problem)) : `${moment(scored)} by Forewarn ${version}`)],
    ];
    const none = empty(
      "No archive",
      "An archive is a folder of recordings scored by forewarn score-archive. Start the server with --archive DIR or FOREWARN_ARCHIVES.",
    );
    const actions = [link("Recordings", "#/recordings"), guideLink("first-recording#an-archive", "how to score an archive")];
    return pageOf("Archives", actions, archives.length ? table({ columns, items: archives }) : none);
  }
}

function exceedancesOf({ exceedances: n, exceedances_as_recorded: recorded, exceedances_outside: outside }) {
  return [count(n), recorded > 0 && hint(`${count(recorded)} more as recorded only`), outside > 0 && hint(`${count(outside)} more outside`)];
}

function noVerdictOf({ no_verdict: n, exceedances, warned_in_time: inTime, warned_late: late, misses }) {
  const exceeded = exceedances - inTime - late - misses;
  return [count(n), exceeded > 0 && hint(`${count(exceeded)} with an exceedance`)];
}

const hint = (text) => h("span.hint.hint-line", text);

const doubtOf = ({ mapping_is_guess: isGuess, mapping_confidence: sure }) => isGuess && h("span.hint-line", chip(`◆ mapping is a guess: ${Math.round(100 * sure)} %`, "caution"));

function validityOf({ valid, not_valid: not, validity_unknown: unknown, manoeuvres }) {
  const title = `${count(valid)} applicable, ${count(not)} INVALID, ${count(unknown)} unknown`;
  return h("span", { title }, `${count(valid)} of ${count(manoeuvres)}`);
}

function showArchive(element, { id, api }) {
  const path = `/archives/${id}`;
  return loadingView(element, { title: "Archive", text: "Opening the archive", loads: [path], build });

  async function build(_, archive) {
    const { aircraft, months, monitors } = archive;
    const several = monitors.length > 1;
    const alertOf = new Map(monitors.map(({ name, alert_above: above }) => [name, above]));
    const failure = errorLine();
    const address = createAddress();
    let asked = "";
    const choose = (name, entries, label) => {
      const control = select(entries, { value: address.get(name), onchange: changed });
      function changed() {
        address.set(name, control.value === entries[0][0] ? null : control.value);
        failure.attempt(reload);
      }
      return { control, element: h("label.field.archive-choice", h("span.dim", label), control) };
    };
    const named = (names, all, none) => [["*", all], ...names.map((name) => [name, name]), ["", none]];
    const chosen = {
      aircraft: choose("aircraft", named(aircraft, "all", "not known"), "Aircraft"),
      month: choose("month", named(months, "all", "not known"), "Month"),
      monitor: choose("monitor", [["*", "all"], ...monitors.map(({ name }) => [name, name])], "Monitor"),
    };
    const some = choose("some", SOME, "Show");
    const sort = choose("sort", SORTS, "Sort by");
    const by = choose("by", GROUPS, "Summed by");
    const sums = h("div");
    const rows = h("div");
    const list = createLongList({ api, path: () => `${path}/flights?${queryOf([["sort", sort], ["some", some]])}`, search: "Search flights", step: LISTED, show: fill, address });
    const bad = h("div");
    const failed = createLongList({ api, path: `${path}/files?state=failed`, search: "Search files", step: LISTED, show: fillFailed });
    await Promise.all([reload(), archive.n_failed ? failed.load() : null]);
    return pageOf(
      archive.name,
      [link("All archives", "#/archives"), guideLink("first-recording#an-archive", "how to score an archive")],
      panel("Scored", [facts(archive), h("p.hint", "Recordings of ", h("code", archive.source)), monitorTable(monitors)]),
      h("div.row.archive-filters", chosen.aircraft.element, several && chosen.monitor.element, chosen.month.element),
      failure.element,
      panel("Summary", [sums, h("p.hint", ADDS_UP)], { beside: by.element }),
      panel("Flights", [rows, list.more], { beside: h("span.row.archive-filters", list.box, some.element, sort.element) }),
      archive.n_failed ? panel("Files not scored", [bad, failed.more], { beside: failed.box }) : null,
    );

    async function reload() {
      const groups = by.control.value.split(",").filter(Boolean);
      const query = [queryOf(), ...groups.map((name) => `by=${name}`), "limit=1000"].filter(Boolean).join("&");
      asked = query;
      const [found] = await Promise.all([api.get(`${path}/summary?${query}`), list.load()]);
      if (asked !== query) return; // another choice was made meanwhile
      sums.replaceChildren(found.length ? table({ columns: sumColumns(groups), items: found, panel: false, classes: "archive-table" }) : h("p.dim", "No flight matches."));
    }

    function queryOf(more = []) {
      const pairs = Object.entries(chosen).filter(([, { control }]) => control.value !== "*");
      const others = more.filter(([, { control }]) => control.value !== "");
      return new URLSearchParams([...pairs, ...others].map(([name, { control }]) => [name, control.value])).toString();
    }

    function sumColumns(groups) {
      const names = { aircraft: ["Aircraft", ({ aircraft: name }) => name ?? unknown()], month: ["Month", ({ month }) => month ?? unknown()] };
      const keys = groups.map((name) => names[name]);
      const monitor = ["Monitor", ({ monitor: name }) => name];
      const [first, ...others] = several || !keys.length ? [...keys, monitor] : keys;
      return [[...first, "name"], ...others, ["Flights", ({ flights }) => count(flights), "number"], ...COUNTS];
    }

    function fill(flights, text) {
      const none = h("p.dim", text ? `No flight has “${text}” in its path.` : "No flight matches.");
      const columns = [["Flight", nameOf, "name"], ...COUNTS, ["Peak risk", ({ peak_risk: risk, monitor }) => (risk === null ? "–" : riskText(risk, alertOf.get(monitor))), "number"]];
      rows.replaceChildren(flights.length ? table({ columns, items: flights, panel: false, classes: "archive-table" }) : none);
    }

    function nameOf(row) {
      const { id: flight, flight: name, aircraft: craft, month, monitor } = row;
      const query = new URLSearchParams({ flight, monitor });
      const about = [craft, month, several && monitor].filter(Boolean).join(" · ");
      return [h("a", { href: `#/archives/${id}?${query}` }, name), h("span.hint.hint-line", about), doubtOf(row)];
    }

    function fillFailed(files) {
      const columns = [
        ["File", ({ flight }) => flight, "name"],
        ["Reason", ({ error }) => error],
      ];
      bad.replaceChildren(files.length ? table({ columns, items: files, panel: false }) : h("p.dim", "No file matches."));
    }
  }
}

const unknown = () => h("span.dim", "not known");

function facts({ scored, version, n_flights: flights, n_failed: failed, n_copies: copies }) {
  return factList([
    ["Last run", moment(scored)],
    ["Forewarn", version],
    ["Flights", count(flights)],
    ["Files not scored", BAD(failed)],
    ["Copies of others", count(copies)],
  ]);
}

function monitorTable(monitors) {
  const columns = [
    ["Monitor", ({ name }) => name, "name"],
    ["File", ({ file }) => file],
    ["ε", ({ epsilon }) => figure(epsilon), "number"],
    ["Alerts above", ({ alert_above: above }) => figure(above), "number"],
    ["Warning lead time", ({ lead }) => `${figure(lead)} s`, "number"],
    ["SHA-256", ({ digest }) => h("code", { title: digest }, digest.slice(0, 12))],
  ];
  return table({ columns, items: monitors, panel: false });
}
