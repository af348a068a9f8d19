/**
 * How the source of a live flight does, in one line beside the markers, and what must not be overlooked.
 *
 * Exports
 *   createLivePanel({line, problem}, {begin, address, events, flag}) -> LivePanel
 *     line, problem: elements.   begin() -> Promise    says that a manoeuvre begins now
 *     address() -> bool    shows or hides where samples are sent; whether it is shown
 *     flag(flag), events: marks a beginning on the strips, lists it
 *   beginningEvent({number, t}) -> event, beginningFlag({number, t}) -> flag    of a manoeuvre, for the event list and the strips
 *   lossText(live) -> [string]     what came, by kind, and what of it was not used, of a flight that is over
 *
 * LivePanel
 *   update(live, {lead})     as hello or the message `live` has it; lead: shown [s], the delay subtracted
 *   explain(reason)          of the newest sample: what trim waits for
 *   setUsable(boolean)       false while there is no connection
 *   begin()                  for its key
 */

import { reason as reasonOf } from "../lib/api.js";
import { h, put } from "../lib/dom.js";
import { may, needs } from "../lib/me.js";
import { leadSeconds } from "../lib/numbers.js";

const BEGIN = "POST /flights/{}/manoeuvre";
const LATE = 0.25; // s of lag that is cautioned of
const KINDS = [
  ["late", "late", "Samples that came when their time had been passed, left out"],
  ["missing", "missing", "Times of the monitor at which nothing was known"],
  ["out_of_order", "out of order", "Samples that came after a later one, and were used"],
  ["repeated", "repeated", "Samples of a time that had come before, left out"],
  ["clock_steps", "clock steps", "Steps of the source's clock, each a gap"],
  ["implausible_times", "implausible times", "Samples of a time that the next one did not follow, left out"],
];
const HARMLESS = ["out_of_order", "repeated"];
const ITEMS = [
  ["phase", "phase", "Manoeuvre under way, or what it and its trim wait for"],
  ["rate", "source", "Rate at which the source samples"],
  ["lag", "lag", "How much later the newest sample came than the quickest of the last minute"],
  ["delay", "delay", "That a sample waits for others at most"],
  ["lead", "lead", "How far ahead an alert warns: the monitor's lead less the delay"],
  ["batches", "batches", "That came, without repeated ones"],
  ...KINDS,
  ["malformed", "malformed", "Messages that were no batch"],
  ["foreign", "foreign", "Datagrams of somebody else than the source"],
  ["resumed", "restarts", "Times that the flight went on after its server was killed"],
  ["unread", "not read", "Names that the source sends and nothing reads: look at the names and the mapping"],
  ["udp", "UDP", "Where it listens for datagrams"],
];

export function createLivePanel({ line, problem }, { begin, address, events, flag }) {
  line.classList.add("live-panel");
  const items = new Map();
  const known = new Set(); // manoeuvres
  const strange = new Set(); // names that nothing reads
  const failure = h("span", { class: "error transport-error", role: "status", hidden: true });
  const beginButton = h("button", { type: "button", class: "button button-small begin-button", title: "Manoeuvre begins now, where the surfaces have not shown it (key G)", onclick: press, ...needs(BEGIN) }, "Manoeuvre begins ", h("span", { class: "marker-key" }, "[G]"));
  const open = h("button", { type: "button", class: "button button-small", "aria-expanded": "false", title: "Where samples are sent", onclick: () => open.setAttribute("aria-expanded", String(address())) }, "Address");
  const figures = h("div", { class: "live-items" });
  for (const [key, name, title] of ITEMS) {
    const value = h("span", { class: "live-value" }, "–");
    const box = h("div", { class: "live-item", "data-item": key, title }, h("span", { class: "status-name" }, name), value);
    items.set(key, { box, value });
    figures.append(box);
  }
  line.append(h("strong", { class: "live-word" }, "LIVE"), beginButton, open, failure);
  line.after(figures);
  let steps = 0; // of the source's clock that are told
  let live = null;
  let usable = false;
  let why = "";

  function show(key, text, level = "") {
    const { box, value } = items.get(key);
    box.hidden = text === "";
    put(value, text);
    if (box.dataset.level !== level) box.dataset.level = level;
  }

  const count = (key, n, level = "caution") => show(key, n > 0 ? n.toLocaleString("en") : "", level);

  function update(given, { lead }) {
    live = given;
    const { delay, counts } = live;
    showNow();
    show("delay", `${Number(delay.toFixed(3))} s`);
    show("lead", `${leadSeconds(lead)} s`);
    show("batches", live.batches.toLocaleString("en"));
    for (const [kind] of KINDS) count(kind, counts[kind], HARMLESS.includes(kind) ? "" : "caution");
    count("malformed", live.malformed);
    count("foreign", live.foreign);
    count("resumed", live.resumed);
    show("udp", live.udp ?? "");
    const unread = live.unread ?? [];
    show("unread", unread.join(", "));
    const told = unread.filter((name) => !strange.has(name));
    if (told.length > 0) events.add({ t: null, text: `the source sends what nothing reads: ${told.join(", ")}`, seen: true });
    for (const name of told) strange.add(name);
    tellSteps(counts.clock_steps);
    showManoeuvre();
    showProblem();
    live.begun.filter(({ number }) => !known.has(number)).forEach(mark);
  }

  /** What is known only as long as the server is heard. */
  function showNow() {
    const { interval, lag } = live;
    show("rate", !usable || interval === null ? "–" : `${rate(1 / interval)} Hz`);
    show("lag", usable ? `${lag.toFixed(2)} s` : "–", usable && lag > LATE ? "caution" : "");
  }

  function tellSteps(n) {
    if (n > steps) events.add({ t: null, text: `the source's clock stepped, ${n} in all: the flight goes on by the times of arrival, after a gap`, level: "caution", seen: true });
    steps = n;
  }

  function showManoeuvre() {
    const { trim, manoeuvre } = live;
    const phase = manoeuvre > 0 ? `manoeuvre ${manoeuvre} under way` : why.split(":")[0] || "no manoeuvre";
    show("phase", trim === "none" ? "all is assessed" : phase);
    items.get("phase").box.title = manoeuvre > 0 ? "Assessed from the trim before it" : why;
    beginButton.hidden = trim === "none";
    beginButton.disabled = !usable || manoeuvre > 0;
  }

  function showProblem() {
    const { problem: disk, refused = "" } = live;
    problem.hidden = disk === "" && refused === "";
    if (refused !== "") put(problem, `◆ REFUSED, the source's newest message: ${refused}`);
    if (disk !== "") put(problem, `◆ NOT DURABLE: the disk takes nothing (${disk}). Samples are shown, but not acknowledged: make space.`);
  }

  function mark({ number, t }) {
    known.add(number);
    flag(beginningFlag({ number, t }));
    events.add(beginningEvent({ number, t }));
  }

  async function press() {
    if (live === null || live.trim === "none" || !may(BEGIN)) return;
    failure.hidden = true;
    beginButton.disabled = true;
    try {
      await begin();
    } catch (error) {
      put(failure, reasonOf(error));
      failure.hidden = false;
    }
    showManoeuvre();
  }

  return {
    update,
    begin: press,
    explain: (reason) => {
      if (reason === why) return;
      why = reason;
      if (live !== null) showManoeuvre();
    },
    setUsable: (is) => {
      usable = is;
      if (live === null) return;
      showNow();
      showManoeuvre();
    },
  };
}

export function beginningEvent({ number, t }) {
  return { t, text: `manoeuvre ${number} begins`, seen: true };
}

export function beginningFlag({ number, t }) {
  return { key: null, t, word: `manoeuvre ${number}`, colour: "text", thin: true };
}

export function lossText({ batches, counts, malformed, foreign, resumed, unread = [] }) {
  const told = KINDS.filter(([kind]) => counts[kind] > 0).map(([kind, name]) => `${name}: ${counts[kind].toLocaleString("en")}`);
  const others = [["malformed messages", malformed], ["foreign datagrams", foreign], ["restarts of the server", resumed]];
  return [
    `${counts.accepted.toLocaleString("en")} samples used, of ${batches.toLocaleString("en")} batches`,
    ...told,
    ...others.filter(([, n]) => n > 0).map(([name, n]) => `${name}: ${n.toLocaleString("en")}`),
    ...(unread.length > 0 ? [`not read: ${unread.join(", ")}`] : []),
  ];
}

function rate(hertz) {
  return hertz >= 100 ? hertz.toFixed(0) : hertz.toFixed(1);
}
