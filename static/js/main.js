/**
 * The page: one address for each view (#/ is the start page, #/demonstration, #/fly, #/fly/{flight},
 * #/recordings/{id}, #/archives/{id}, #/monitors/{id}, #/datasets/{id}, #/campaigns/{id}, #/limits/{id}, #/sets/{id}, #/storage,
 * #/people), its theme.
 *
 * A view's module exports show(element, {id, query, api, navigate}) -> {close()}. `query` holds the part
 * after a question mark (#/fly?monitor=3f9a); navigate("#/fly/3f9a") opens another view.
 */

import { createAddress } from "./lib/address.js";
import { api, beginsBy, loadMe, may, notYours } from "./lib/api.js";
import { chooseTime, clearZero, timeChoice, TIMES, useTime, watchZero } from "./lib/clock.js";
import { createDemonstrationBar, demonstration } from "./lib/demonstration.js";
import { button as buttonOf, h, link, openDialog, pageOf, REFUSED, state } from "./lib/dom.js";
import { capital, chooseUnits, tellUnits, UNIT_SYSTEMS, unitSystem, useUnits } from "./lib/numbers.js";
import { chooseTheme, currentTheme, followTheme } from "./lib/storage.js";

const VIEWS = {
  "": { title: "Start", guide: "", load: () => import("./start/index.js") },
  demonstration: { title: "Demonstration", guide: "what-the-numbers-mean", load: () => import("./start/demonstration.js") },
  fly: { title: "Fly", guide: "first-live-flight", load: () => import("./fly/index.js") },
  campaigns: { title: "Campaigns", guide: "campaigns", load: () => import("./campaigns/index.js") },
  recordings: { title: "Recordings", guide: "first-recording", load: () => import("./recordings/index.js") },
  archives: { title: "Archives", under: "recordings", guide: "first-recording", load: () => import("./recordings/archives.js") },
  monitors: { title: "Monitors", guide: "first-monitor", load: () => import("./monitors/index.js") },
  limits: { title: "Limit sets", guide: "limit-sets", load: () => import("./limits/index.js") },
  sets: { title: "Monitor sets", under: "monitors", guide: "limit-sets", load: () => import("./sets/index.js") },
  people: { title: "People and audit", guide: "several-people", load: () => import("./people/index.js") },
  storage: { title: "Storage", guide: "keeping-data", load: () => import("./storage/index.js") },
  datasets: { title: "Datasets", guide: "first-monitor", load: () => import("./datasets/index.js") },
};

/** In place of a view whose request the role does not allow. */
const REFUSING = { show: (element) => (element.replaceChildren(pageOf("Not allowed", [], state("error", REFUSED, notYours()))), { close: () => {} }) };

/** Of an address that no view has. */
const UNKNOWN = {
  title: "Unknown address",
  guide: "",
  load: async () => ({
    show(element) {
      const text = `There is no page ${location.hash}: check the address, or begin at the start page.`;
      element.replaceChildren(pageOf(UNKNOWN.title, [], h("p", text), h("div.row", link("Start page", "#/", true))));
      return { close: () => {} };
    },
  }),
};

const CHECKED_EVERY = 5000; // ms
/** @returns {any} an element of index.html */
const part = (selector) => document.querySelector(selector);
const page = part("#page");
let shown = { close: () => {} };
let turn = 0;
let place = ""; // path of the view
let hasMoments = false; // in the view
let checking = 0; // timer

function navigate(hash) {
  if (location.hash === hash) open();
  else location.hash = hash;
}

function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text; // a stray %: an unknown address
  }
}

/** Damaged data, a database that lost content and a full disk are shown above every view, also once the check ends. */
async function showDamage() {
  const element = part("#damage");
  clearTimeout(checking);
  try {
    const [{ state: check, damaged, elsewhere, unlisted, older }, { warning }] = await Promise.all([api.get("/integrity"), api.get("/storage/space").catch(() => ({ warning: "" }))]);
    element.textContent = damageWords(damaged) || elsewhereWords(elsewhere) || unlistedWords(unlisted) || (older ? `◆ Data missing: ${older}.` : warning && `◆ Low disk space: ${warning}.`);
    element.hidden = element.textContent === "";
    if (["begun", "checking"].includes(check)) checking = setTimeout(showDamage, CHECKED_EVERY);
  } catch {
    // the view reports that the server does not answer
  }
}

function damageWords([first, ...others]) {
  if (!first) return "";
  const more = others.length ? ` And ${others.length} more: GET /api/v1/integrity lists them.` : "";
  return `◆ Damaged data, not served: ${first.kind} ${first.name}: ${first.detail}.${more}`;
}

const filesOf = (n) => `◆ Files of ${n} ${n === 1 ? "recording or flight" : "recordings or flights"}`;
const elsewhereWords = (n) => (n ? `${filesOf(n)} are in another data directory.` : "");
const unlistedWords = (n) => (n ? `${filesOf(n)} are not in this database: it may be an older one. Serve the newest (--database-url).` : "");

const viewOf = (name) => (Object.hasOwn(VIEWS, name) ? VIEWS[name] : UNKNOWN);

async function open() {
  showDamage();
  const [path, search] = location.hash.replace(/^#?\/?/, "").split("?");
  const [name, id = null] = path.split("/").map(decoded);
  if (name === "guide") return location.replace(["/guide", id].filter(Boolean).join("/"));
  const mine = ++turn;
  const view = viewOf(name);
  const query = new URLSearchParams(search ?? "");
  if (path !== place) hasMoments = false;
  if (path !== place) clearZero();
  place = path;
  useUnits(query.get("units"));
  useTime(query.get("time"));
  showUnits();
  showTime();
  for (const link of document.querySelectorAll(".nav a"))
    link.ariaCurrent = link.getAttribute("href") === `#/${view.under ?? name}` ? "page" : null;
  document.title = `${view.title} – Forewarn`;
  part("#help").href = guideOf(name, id);
  bar.goneTo(location.hash);
  shown.close();
  shown = { close: () => {} };
  page.replaceChildren();
  try {
    const route = beginsBy(location.hash);
    const { show } = route === undefined || may(route) ? await view.load() : REFUSING;
    if (mine !== turn) return;
    shown = show(page, { id: id || null, query, api, navigate });
  } catch (error) {
    console.error(error);
    const text = `${error?.message ?? error}. Reload the page; if that does not help, restart the server.`;
    page.replaceChildren(h("h1.visually-hidden", view.title), state("error", "This view could not be opened", text));
  }
}

/** A flight in progress has its own page: alarms and keys. */
function guideOf(name, id) {
  const page = name === "fly" && id ? "alarms-and-keys" : viewOf(name).guide;
  return ["/guide", page].filter(Boolean).join("/");
}

function showChoice(button, what, name, isPressed) {
  button.replaceChildren(h("span.roomy", `${what}: `), name);
  button.setAttribute("aria-pressed", String(isPressed));
  button.setAttribute("aria-label", `${what}: ${name}. Press to change.`);
}

function bindThemeButton(button) {
  const show = (theme) => showChoice(button, "Theme", theme, theme === "light");
  button.addEventListener("click", () => chooseTheme(currentTheme() === "dark" ? "light" : "dark"));
  followTheme(show);
}

const next = (names, name) => names[(names.indexOf(name) + 1) % names.length];

/** The next system of units; the view is opened again unless that would lose input. */
function bindUnitsButton(button) {
  const show = () => showChoice(button, "Units", unitSystem(), unitSystem() !== UNIT_SYSTEMS[0]);
  button.addEventListener("click", () => {
    chooseUnits(next(UNIT_SYSTEMS, unitSystem()));
    show();
    keepChoices();
    if (!tellUnits(page)) open();
  });
  show();
  return show;
}

/** Test time or time of day, in views that show moments; where the time of day is not known, a press says why. */
function bindTimeButton(button) {
  let why = "";
  button.addEventListener("click", () => {
    if (why !== "") return tell(why);
    chooseTime(next(TIMES, timeChoice()));
    show();
    keepChoices();
    return open();
  });
  watchZero((state) => {
    button.hidden = state === null;
    why = state?.why ?? "";
    show();
    if (state === null || hasMoments) return;
    hasMoments = true;
    keepChoices();
  });
  return show;

  function show() {
    const name = why === "" ? timeChoice() : TIMES[0];
    showChoice(button, "Time", name, name !== TIMES[0]);
    button.ariaDisabled = String(why !== "");
    button.title = why === "" ? "Test time, or time of day" : `Time of day is not available: ${why}`;
    if (why !== "") button.setAttribute("aria-label", `Time: ${name}. ${button.title}.`);
  }
}

function tell(why) {
  const close = buttonOf("Close", () => dialog.close(), { autofocus: true });
  const dialog = openDialog("Time of day is not available", [h("p", `${capital(why)}.`), h("div.row", close)]);
}

/** Units and time in the address of a view with moments, where they are not the usual ones. */
function keepChoices() {
  if (!hasMoments) return;
  const address = createAddress();
  address.set("units", unitSystem() === UNIT_SYSTEMS[0] ? null : unitSystem());
  address.set("time", timeChoice() === TIMES[0] ? null : timeChoice());
  address.write();
}

function showMe(me) {
  part("[data-people]").hidden = !may("GET /tokens");
  part("#version").textContent = me?.version ?? "";
  const element = part("#me");
  element.hidden = me === null || me.name === "local";
  if (!element.hidden) element.textContent = `${me.name} · ${me.role}`;
}

part("[data-skip]").addEventListener("click", (event) => {
  event.preventDefault();
  page.focus();
});
const bar = createDemonstrationBar(part("#preparing"), { navigate });
const showUnits = bindUnitsButton(part("#units"));
const showTime = bindTimeButton(part("#time"));
bindThemeButton(part("#theme"));
part("#logout").hidden = !document.cookie.split("; ").includes("forewarn-page=1");
const [me] = await Promise.all([loadMe(), demonstration.follow(api)]);
showMe(me);
addEventListener("hashchange", open);
open();
