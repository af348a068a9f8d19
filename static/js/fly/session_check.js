/**
 * The session check before the first point: program, monitor, limits, clock, link, sound, and a drill with an alert.
 *
 * Its result is printed, and becomes an event of the flights that this browser starts in the next hours.
 *
 * showSessionCheck(element, {query, api}) -> {close()}     query: monitor, chosen at first
 */

import { labelled, select } from "../forms/controls.js";
import { needs, reason } from "../lib/api.js";
import { isSimulated, limitsOfMonitor } from "../lib/catalog.js";
import { button, empty, errorLine, formatted, h, link, loadingView, pageOf, put } from "../lib/dom.js";
import { fittingMonitor } from "../lib/monitors.js";
import { storeCheck, worstOf } from "../lib/session_check.js";
import { CALLOUTS } from "./alarms/tone.js";
import { showLiveFlight, tone } from "./live_flight.js";

const TRIPS = 10; // requests that measure link and clock
const SLOW = 250; // ms, the age from which on a display is stale
const WRONG = 500; // ms between the clocks
const SEEDS = 10; // flights in which one with an alert is looked for
const LOOK = 100; // ms
const DRILL = 60_000; // ms
const UNHEARD = "tone not played";
const LEVELS = { passed: "ok", failed: "alert", "not done": "caution" };
const NAMES = { program: "program", monitor: "monitor", limits: "limits", clock: "clock", link: "link", sound: "sound", drill: "alert drill" };

export function showSessionCheck(element, { query, api }) {
  let drill = null;
  let unsubscribe = () => {}; // from the tone
  const view = loadingView(element, { title: "Session check", text: "Looking for monitors and limits", loads: ["/monitors", "/limit-sets", "/catalog", "/me"], build });
  return {
    close: () => {
      drill?.close();
      unsubscribe();
      view.close();
    },
  };

  async function build(_, monitors, sets, catalog, me) {
    if (monitors.length === 0) return pageOf("Session check", [], empty("No monitor yet", "The check needs a monitor.", link("Train a monitor", "#/monitors/new", true)));
    const results = new Map(Object.keys(NAMES).map((key) => [key, { result: "not done", text: key === "sound" ? UNHEARD : "" }]));
    const monitor = select(monitors.map(({ id, name }) => [id, name]), { value: query.get("monitor") ?? fittingMonitor(monitors).id, onchange: again });
    const set = select([["", "the monitor's own"], ...sets.map(({ id, name, newest }) => [id, `${name}, version ${newest}`])], { onchange: again });
    const chosen = () => monitors.find(({ id }) => id === monitor.value);
    const failure = errorLine();
    const kept = h("span.dim", { role: "status" });
    const head = h("p.check-head", { role: "status" });
    const rows = new Map([...results.keys()].map((key) => [key, row(key)]));
    const small = { class: "button button-small" };
    const flying = needs("POST /flights");
    const heard = h("span.row", { hidden: true }, button("I heard it", () => sound(true), small), button("I heard nothing", () => sound(false), small));
    const voice = h("input", { type: "checkbox", checked: tone.voice, onchange: chooseVoice });
    const callouts = h("span.row", { hidden: !tone.voice }, CALLOUTS.map((name) => button(`“${name}”`, () => play(name), { ...small, "aria-label": `Play the callout ${name}` })));
    rows.get("sound").acts.append(button("Play the tone", () => play(), small), h("label.row", voice, "spoken callouts after the tone"), callouts, heard);
    rows.get("drill").acts.append(button("Start the drill", startDrill, { ...small, ...flying }));
    rows.get("link").acts.append(button("Measure again", measure, small));
    const page = h("div.page", h("div.panel.session-check",
      h("h1", "Session check"),
      h("p.hint", "Do this before the first point. Flights started in this browser then record the result, with all that failed or was not done."),
      h("div.row", labelled("Monitor", monitor).element, labelled("Limits", set).element),
      head,
      h("table.check-table", h("caption.visually-hidden", "Checks"), h("tbody", [...rows.values()].map(({ element: each }) => each))),
      failure.element,
      h("div.row", button("Store the result", store, { class: "button button-primary", ...flying }), button("Print", () => window.print()), h("a.button", { href: "#/fly", ...flying }, "Start a flight"), kept)));
    again();
    return page;

    function row(key) {
      const result = h("strong.chip");
      const text = h("span");
      const acts = h("span.row");
      return { element: h("tr", { "data-check": key }, h("th", { scope: "row" }, NAMES[key]), h("td", result), h("td", text, acts)), result, text, acts };
    }

    function say(key, isPassed, text) {
      results.set(key, { result: isPassed === null ? "not done" : isPassed ? "passed" : "failed", text });
      const check = checked();
      for (const [each, { result, text: words }] of results) {
        put(rows.get(each).result, result);
        rows.get(each).result.dataset.level = LEVELS[result];
        rows.get(each).text.replaceChildren(formatted(words));
      }
      const worst = worstOf(check);
      put(head, `${worst === "passed" ? "✓ Session check passed" : `◆ Session check ${worst === "failed" ? "FAILED" : "NOT COMPLETE"}`}, ${check.at.slice(0, 19).replace("T", " ")} UTC, by ${me.name}`);
      head.dataset.level = LEVELS[worst];
    }

    function checked() {
      return { at: new Date().toISOString(), by: me.name, checks: [...results].map(([key, value]) => ({ name: NAMES[key], ...value })) };
    }

    function store() {
      storeCheck(checked());
      put(kept, "Stored: flights started in this browser in the next 12 hours record it.");
    }

    /** All that needs nobody, for the chosen monitor and limits; sound and drill stay as they are but for another monitor. */
    function again() {
      const { name, digest, version, warnings } = chosen();
      say("monitor", warnings.length === 0, `${name}, sha-256 ${digest.slice(0, 12)}, trained by ${version}${warnings.length > 0 ? `; ${warnings.join("; ")}` : ""}`);
      say("drill", null, isSimulated(chosen()) ? "not flown" : "not possible: this monitor's test cannot be simulated");
      attempt("limits", readLimits);
      attempt("program", readProgram);
      measure();
    }

    async function attempt(key, act) {
      try {
        const [isPassed, text] = await act();
        say(key, isPassed, text);
      } catch (error) {
        say(key, false, reason(error));
      }
    }

    async function readLimits() {
      if (set.value === "") return [true, `the monitor's own: ${limitsOfMonitor(catalog, chosen())}`];
      const [newest] = await api.get(`/limit-sets/${set.value}`);
      const hash = await digestOf(newest.cases);
      return [true, `${newest.name}, version ${newest.version}, ${newest.cases.length} conditions, ${hash}`];
    }

    async function readProgram() {
      const answer = await fetch("/readyz");
      const { version, detail } = await answer.json();
      return [answer.ok, answer.ok ? `Forewarn ${version}, ready to store` : `Forewarn ${me.version}: ${detail}`];
    }

    async function measure() {
      const trips = [];
      try {
        for (let n = 0; n < TRIPS; n++) {
          const [sent, wall] = [performance.now(), Date.now()];
          const { server_time: time } = await api.get("/me");
          const took = performance.now() - sent;
          trips.push({ took, apart: Date.parse(time) - (wall + took / 2) });
        }
      } catch (error) {
        for (const key of ["link", "clock"]) say(key, false, reason(error));
        return;
      }
      trips.sort((a, b) => a.took - b.took);
      const [best, worst] = [trips[0], trips.at(-1)];
      say("link", worst.took <= SLOW, `round trip ${trips[TRIPS / 2].took.toFixed(0)} ms, longest ${worst.took.toFixed(0)} ms of ${TRIPS} (at most ${SLOW} ms)`);
      say("clock", Math.abs(best.apart) - best.took / 2 <= WRONG, `server ${(best.apart / 1000).toFixed(2).replace(/^-0\.00$/, "0.00").replace("-", "−")} s against this browser, ± ${(best.took / 2000).toFixed(2)} s (at most ${WRONG / 1000} s)`);
    }

    function chooseVoice() {
      tone.setVoice(voice.checked);
      callouts.hidden = !voice.checked;
      say("sound", null, UNHEARD);
    }

    function play(callout) {
      const tell = () => say("sound", blocked() === "" ? null : false, blocked() || `${tone.callout ? `“${tone.callout}”` : "tone"} played: was it heard?`);
      unsubscribe();
      unsubscribe = tone.subscribe(tell);
      tone.unlock();
      tone.caution(callout);
      heard.hidden = false;
      tell();
    }

    /** Why the tone makes no sound, or the voice; empty where they do. */
    function blocked() {
      if (tone.state === "on" && tone.voice && tone.hasWords === false) return "the spoken words could not be read from the server: reload the page";
      return { muted: "muted in this browser: press M on the page of a flight", blocked: "the browser blocks sound: press the button again", unavailable: "this browser has no sound" }[tone.state] ?? "";
    }

    function sound(isHeard) {
      unsubscribe();
      heard.hidden = true;
      say("sound", isHeard && blocked() === "", isHeard ? blocked() || `tone ${tone.voice ? "and voice " : ""}heard` : `tone not heard${blocked() ? `: ${blocked()}` : ""}`);
      store();
    }

    async function startDrill() {
      failure.show("");
      const flown = chosen();
      const isStarted = await failure.attempt(async () => {
        drill = await flyDrill(element, { api, monitor: flown });
      });
      if (!isStarted) {
        say("drill", false, failure.element.textContent);
        store();
        return;
      }
      const { isPassed, text } = await drill.ended;
      drill = null;
      element.replaceChildren(page);
      say("drill", isPassed, text);
      store();
    }
  }
}

async function digestOf(value) {
  if (globalThis.crypto?.subtle === undefined) return "no hash: the browser needs https";
  const bytes = await crypto.subtle.digest("SHA-256", new TextEncoder().encode(JSON.stringify(value)));
  return `sha-256 ${[...new Uint8Array(bytes)].slice(0, 6).map((byte) => byte.toString(16).padStart(2, "0")).join("")}`;
}

/** Flies a failing flight in place of the page, until its alert was shown and everything is acknowledged. */
async function flyDrill(element, { api, monitor }) {
  const order = { monitor: monitor.id, epsilon: monitor.epsilon, name: "alert drill", wait_for_viewer: true, accept_useless: true };
  const seed = await seedWithAlert(api, order);
  const { id } = await api.post("/flights", { ...order, source: { kind: "simulated", outcome: "unsafe", seed } });
  const host = h("div.drill-flight");
  const stop = button("Stop the drill", () => finish(false, "stopped before it was passed"), { class: "button button-small" });
  element.replaceChildren(h("div.drill", h("p.drill-head", { role: "status" }, h("strong", "ALERT DRILL. "), "A simulated flight alerts and exceeds its limit. Acknowledge each alarm: press K, or the button.", stop), host));
  const { promise: ended, resolve } = Promise.withResolvers();
  const view = showLiveFlight(host, { id, api, over: () => finish(false, "the drill's flight ended before it was passed") });
  const shown = { alert: false, limit: false };
  const began = performance.now();
  let asking = false;
  let isOver = false;
  const timer = setInterval(look, LOOK);
  const observer = new MutationObserver(notice);
  observer.observe(host, { subtree: true, childList: true, characterData: true });

  /** An exceedance may take the alert's place in the line at once; the list has both. */
  function notice() {
    const shows = (selector, words) => [...host.querySelectorAll(selector)].some((each) => each.checkVisibility() && words.test(each.textContent));
    shown.alert ||= shows(".alarm-banner", /\bALERT (at|first)/) || shows('.event[data-level="alert"]', /alert, risk/);
    shown.limit ||= shows(".alarm-banner", /LIMIT EXCEEDED/);
  }

  async function look() {
    if (performance.now() - began > DRILL) return finish(false, `not passed within ${DRILL / 1000} s: ${lackWords(shown)}`);
    if (!shown.alert || !shown.limit || asking) return;
    asking = true;
    const alarms = await api.get(`/flights/${id}/alarms`).catch(() => []);
    asking = false;
    const warnings = alarms.filter(({ level }) => level === "warning");
    const isWhole = ["risk", "limit"].every((kind) => warnings.some((alarm) => alarm.kind === kind));
    if (isWhole && warnings.every(({ acknowledged }) => acknowledged !== null)) finish(true, `alert and exceedance shown and acknowledged (flight ${id})`);
  }

  async function finish(isPassed, text) {
    if (isOver) return;
    await close();
    resolve({ isPassed, text });
  }

  function close() {
    isOver = true;
    clearInterval(timer);
    observer.disconnect();
    view.close();
    return api.post(`/flights/${id}/end`).catch(() => {}); // it may have ended
  }

  return { ended, close };
}

const lackWords = ({ alert, limit }) => (alert && limit ? "not everything was acknowledged" : `${alert ? "the exceedance" : "the alert"} was not shown`);

/** A seed with which the monitor alerts; without one the monitor cannot be drilled. */
async function seedWithAlert(api, order) {
  for (let seed = 1; seed <= SEEDS; seed++) {
    const { id } = await api.post("/flights", { ...order, source: { kind: "simulated", outcome: "unsafe", seed } });
    const alerts = await api.post(`/flights/${id}/transport`, { action: "next_alert", value: null }).then(() => true, () => false);
    await api.post(`/flights/${id}/end`);
    await api.delete(`/flights/${id}`).catch(() => {});
    if (alerts) return seed;
  }
  throw new Error(`the monitor alerted on none of ${SEEDS} failing flights`);
}
