/**
 * The state of a live source, in one line beside the markers, and its problems.
 *
 * createLivePanel({line, problem}, {begin, accept, address, events, note}) -> LivePanel
 *     begin() -> Promise    marks that a manoeuvre begins now
 *     accept(sender) -> Promise    makes another sender of datagrams the source
 *     address() -> bool    shows or hides the source's addresses; whether they are shown
 *   show({live, lead, why, isLinked, isStale})     what has changed; live: as hello or the message `live` has it;
 *     lead: shown [s], the delay subtracted.   why: of the newest sample, what the trim is waiting for
 *     isStale: the display, so the lag is unknown
 *   begin()                  by a key
 * beginningNote({number, t}) -> {event, flag}    of a manoeuvre, for the event list and the strips
 * trimNotes(trims, channels) -> [{event, flag}]    of changes of the trim that is subtracted: of one time one event
 * lossText(live, moments) -> [string]   samples of an ended flight, received and not used, by kind; moments: times of
 *   its warnings, whose intervals of late samples are named first
 */

import { may, needs } from "../../lib/api.js";
import { secondsText } from "../../lib/clock.js";
import { errorLine, h, put } from "../../lib/dom.js";
import { counted, leadSeconds, quantity } from "../../lib/numbers.js";
import { createItems } from "../status_strip.js";

const BEGIN = "POST /flights/{}/manoeuvre";
const ACCEPT = "POST /flights/{}/sender";
const LISTED = 3; // intervals of late samples
const LATE = 0.25; // s of lag that is a caution
const KINDS = [
  ["late", "late", "Samples dropped: too late"],
  ["missing", "missing", "Monitor times without a sample"],
  ["out_of_order", "out of order", "Samples used although a later one came first"],
  ["repeated", "repeated", "Samples dropped: repeated time"],
  ["clock_steps", "clock steps", "Steps of the source's clock, each a gap"],
  ["implausible_times", "implausible times", "Samples dropped: implausible time"],
];
const HARMLESS = ["out_of_order", "repeated"];
const ITEMS = [
  ["phase", "phase", "Manoeuvre in progress, or what the trim is waiting for"],
  ["rate", "source", "Sample rate of the source"],
  ["doubts", "samples", "Why the newest samples do not represent the aircraft"],
  ["lag", "lag", "Age of the newest sample, minus the smallest age of the flight"],
  ["drift", "clock drift", "Drift of the source's clock, at most 100 parts in a million: subtracted from the lag"],
  ["delay", "delay", "Longest time that a sample waits for others"],
  ["lead", "warning lead time", "Warning lead time of the monitor less the delay"],
  ["batches", "batches", "Batches received, without repeated ones"],
  ...KINDS,
  ["malformed", "refused", "Messages that are no valid batch, or lack channels"],
  ["foreign", "foreign", "Datagrams from other senders, or without the key"],
  ["resumed", "restarts", "Times that the flight continued after a killed server"],
  ["unread", "not read", "Names that the source sends and no channel reads: check the names and the mapping"],
];

export function createLivePanel({ line, problem }, { begin, accept, address, events, note }) {
  line.classList.add("live-panel");
  const known = new Set(); // manoeuvres
  const strange = new Set(); // names that no channel reads, already listed
  const failure = errorLine("transport-error");
  const beginButton = h("button", { type: "button", class: "button button-small begin-button", title: "Mark that a manoeuvre begins now, if the surfaces do not show it (key G)", onclick: press, ...needs(BEGIN) }, "Manoeuvre begins ", h("span", { class: "marker-key" }, "[G]"));
  const open = h("button", { type: "button", class: "button button-small", "aria-expanded": "false", title: "Addresses for samples", onclick: () => open.setAttribute("aria-expanded", String(address())) }, "Address");
  const figures = h("div", { class: "live-items" });
  const { items, show: item } = createItems(figures, ITEMS, "live");
  const acceptButton = h("button", { type: "button", class: "button button-small", hidden: true, title: "Accept datagrams from this sender instead of the current one", onclick: () => failure.attempt(() => accept(now.live.other_sender)), ...needs(ACCEPT) });
  line.append(h("strong", { class: "live-word" }, "LIVE"), beginButton, open, acceptButton, failure.element);
  line.after(figures);
  const now = { live: null, lead: 0, why: "", isLinked: false, isStale: false };
  let steps = 0; // of the source's clock, already listed

  const count = (key, n, level = "caution") => item(key, n > 0 ? n.toLocaleString("en") : "", level);

  function show(given) {
    if (Object.entries(given).every(([key, value]) => now[key] === value)) return;
    Object.assign(now, given);
    if (now.live !== null) draw(now);
  }

  function draw({ live, lead, isLinked, isStale }) {
    const { delay, counts, interval, lag } = live;
    const isKnown = isLinked && !isStale;
    item("rate", !isLinked || interval === null ? "–" : `${rate(1 / interval)} Hz`);
    item("lag", isKnown ? `${lag.toFixed(2)} s` : "–", isKnown && lag > LATE ? "caution" : "");
    item("delay", `${Number(delay.toFixed(3))} s`);
    item("lead", `${leadSeconds(lead)} s`);
    item("batches", live.batches.toLocaleString("en"));
    for (const [kind] of KINDS) count(kind, counts[kind], HARMLESS.includes(kind) ? "" : "caution");
    for (const kind of ["malformed", "foreign", "resumed"]) count(kind, live[kind]);
    acceptButton.hidden = !live.other_sender;
    put(acceptButton, `Accept sender ${live.other_sender}`);
    item("doubts", (live.doubts ?? []).join("; "), "caution");
    item("drift", live.drift ? `${live.drift} ppm` : "");
    listUnread(live.unread ?? []);
    listSteps(counts.clock_steps);
    showManoeuvre();
    showProblem(live);
    live.begun.filter(({ number }) => !known.has(number)).forEach(mark);
  }

  function listUnread(names) {
    item("unread", names.join(", "));
    const fresh = names.filter((name) => !strange.has(name));
    fresh.forEach((name) => strange.add(name));
    if (fresh.length > 0) events.add({ t: null, text: `no channel reads these names of the source: ${fresh.join(", ")}`, seen: true });
  }

  function listSteps(n) {
    if (n > steps) events.add({ t: null, text: `the source's clock stepped (${n} in all): after a gap the flight continues by arrival times`, level: "caution", seen: true });
    steps = n;
  }

  function showManoeuvre() {
    const { why, isLinked, live: { trim, manoeuvre } } = now;
    const phase = manoeuvre > 0 ? `manoeuvre ${manoeuvre} in progress` : why.split(":")[0] || "no manoeuvre";
    item("phase", trim === "none" ? "everything is assessed" : phase);
    items.phase.box.title = manoeuvre > 0 ? "Assessed from the trim before it" : why;
    beginButton.hidden = trim === "none";
    beginButton.disabled = !isLinked || manoeuvre > 0;
  }

  function showProblem({ problem: disk, refused = "" }) {
    problem.hidden = disk === "" && refused === "";
    if (refused !== "") put(problem, `◆ REFUSED: the source's newest message: ${refused}`);
    if (disk !== "") put(problem, `◆ NOT DURABLE: the disk cannot be written (${disk}). Samples are shown, but not acknowledged: free some space.`);
  }

  function mark({ number, t }) {
    known.add(number);
    note(beginningNote({ number, t }));
  }

  async function press() {
    if (now.live === null || now.live.trim === "none" || !may(BEGIN)) return;
    beginButton.disabled = true;
    await failure.attempt(begin);
    showManoeuvre();
  }

  return { show, begin: press };
}

export function beginningNote({ number, t }) {
  const word = `manoeuvre ${number}`;
  return { event: { t, text: `${word} begins`, seen: true }, flag: { key: null, t, word, colour: "text", thin: true } };
}

export function trimNotes(trims, channels) {
  const channelOf = ({ channel: key }) => channels.find((channel) => channel.key === key);
  const text = (change) => `${channelOf(change).symbol} ${change.value === null ? "as recorded" : quantity(channelOf(change), change.value)}`;
  const flagOf = ({ t, channel: key }) => ({ key, t, word: "trim", colour: "text", thin: true, cuts: true });
  return [...Map.groupBy(trims, ({ t }) => t)].flatMap(([t, changes]) => {
    const hand = changes.some(({ by_hand: byHand }) => byHand) ? ", begun by hand" : "";
    const event = { t, text: `values count from trim: ${changes.map(text).join(", ")}${hand}`, seen: true };
    return changes.map((change, k) => ({ event: k === 0 && event, flag: flagOf(change) }));
  });
}

export function lossText({ batches, counts, malformed, refused = "", foreign, resumed, late = [], unread = [] }, moments = []) {
  const losses = KINDS.filter(([kind]) => counts[kind] > 0).map(([kind, name]) => `${name}: ${counts[kind].toLocaleString("en")}`);
  const others = [["refused messages", malformed], ["foreign datagrams", foreign], ["restarts of the server", resumed]];
  return [
    `${counted(counts.accepted, "sample")} used, of ${counted(batches, "batch", "batches")}`,
    ...losses,
    ...others.filter(([, n]) => n > 0).map(([name, n]) => `${name}: ${n.toLocaleString("en")}`),
    ...(refused ? [`the newest was refused: ${refused}`] : []),
    ...(late.length > 0 ? [`display stale, samples late: ${lateText(late, moments)}`] : []),
    ...(unread.length > 0 ? [`not read: ${unread.join(", ")}`] : []),
  ];
}

function lateText(late, moments) {
  const isWarned = ({ start, end }) => moments.some((t) => start <= t && (end === null || t <= end));
  const listed = late.toSorted((a, b) => isWarned(b) - isWarned(a)).slice(0, LISTED).sort((a, b) => a.start - b.start);
  const words = listed.map((each) => `${secondsText(each.start)} to ${each.end === null ? "the end" : secondsText(each.end)}${isWarned(each) ? " (with a warning)" : ""}`);
  return `${words.join(", ")}${late.length > LISTED ? ` and ${counted(late.length - LISTED, "more time")}` : ""}`;
}

function rate(hertz) {
  return hertz >= 100 ? hertz.toFixed(0) : hertz.toFixed(1);
}
