/**
 * The next point of a campaign: its state, clearance, checklist and actions.
 *
 * Exports
 *   nextPoint({api, path, campaign, running, again}) -> {element, isIdle(), close()}
 *     running: its running job, if any.   again(): reloads the campaign.   isIdle(): nothing is typed or running
 */

import { decimal } from "../forms/decimals.js";
import { ApiError, reason } from "../lib/api.js";
import { h } from "../lib/dom.js";
import { createJobProgress } from "../lib/job_progress.js";
import { factList, sentences } from "../lib/lists.js";
import { asksForToken, needs } from "../lib/me.js";
import { figure, moment, percent } from "../lib/numbers.js";
import { remember, remembered } from "../lib/storage.js";
import { button, errorLine, link } from "../lib/view_states.js";
import { predictedWords, promiseWords, stateChip } from "./states.js";

const NAME_KEY = "forewarn.name";
const JOBS = { clearance: "Clearing", monitor: "Training a monitor for" };

export function nextPoint({ api, path, campaign, running, again }) {
  const point = campaign.points.find(({ name }) => name === campaign.next);
  if (!point)
    return { element: h("section", { class: "panel" }, h("h2", {}, "Every point is complete or aborted")), isIdle: () => true, close: () => {} };
  const { name, state, clearing } = point;
  let progress = null;
  const failure = errorLine();
  const by = h("input", { type: "text", id: "decided-by", maxlength: 200, value: remembered(NAME_KEY) ?? "", onchange: () => remember(NAME_KEY, by.value.trim()) });
  const why = h("input", { type: "text", id: "decided-why", maxlength: 2000 });
  const boxes = campaign.checklist.map((_, k) => h("input", { type: "checkbox", id: `confirmed-${k}`, onchange: follow }));
  const flown = flownForm(api, act);
  const confirm = button(campaign.is_first ? "Clear" : "Confirm as cleared", () => act("confirm"), { class: "button button-primary", ...needs("POST /campaigns/{}/confirm") });
  const compute = button(clearing ? "Compute clearance again" : "Compute clearance", () => work("clearance", signed), { class: clearing ? "button" : "button button-primary", ...needs("POST /campaigns/{}/clearance") });
  const train = button(point.monitor ? "Train its monitor again" : "Train a monitor", () => work("monitor", () => ({ point: name })), { class: "button", ...needs("POST /campaigns/{}/monitor") });
  const stage = h("div", { class: "stack" });
  const element = h(
    "section",
    { class: "panel stack campaign-next", "data-state": state, "aria-label": "Next point" },
    h("div", { class: "row" }, h("h2", {}, `Next: ${name}, ${figure(point.peak_deg)} deg`), stateChip(state), last(point)),
    clearing ? computed(clearing, point) : null,
    clearing ? null : h("p", {}, campaign.is_first ? "No flown step to compute from: engineering decision required." : "Clearance not computed yet."),
    h("p", { class: "hint" }, passWords(point)),
    state === "on condition" ? checklist(campaign.checklist, boxes) : null,
    h(
      "div",
      { class: "field-grid" },
      asksForToken() ? null : h("div", { class: "field" }, h("label", { for: by.id }, "your name"), by),
      h("div", { class: "field" }, h("label", { for: why.id }, "reason"), why),
    ),
    h(
      "div",
      { class: "row" },
      state !== "cleared" && (campaign.is_first || state === "on condition") ? confirm : null,
      campaign.is_first ? null : compute,
      train,
      state === "cleared" ? link("Fly live", `#/fly?kind=live${point.monitor ? `&monitor=${point.monitor}` : ""}`) : null,
      state === "hold" ? null : button("Hold", () => act("hold"), needs("POST /campaigns/{}/hold")),
      button("Abort", () => act("abort"), { class: "button button-danger", ...needs("POST /campaigns/{}/abort") }),
    ),
    failure.element,
    stage,
    flown.element,
  );
  follow();
  if (running) show(running);
  return {
    element,
    isIdle: () => progress === null && !why.value && !boxes.some(({ checked }) => checked) && !flown.isTouched() && !element.contains(document.activeElement?.closest("input, select")),
    close: () => progress?.close(),
  };

  function follow() {
    confirm.disabled = !boxes.every(({ checked }) => checked);
  }

  function signed() {
    if (asksForToken()) return { point: name };
    if (by.value.trim()) return { point: name, by: by.value.trim() };
    by.focus();
    throw new ApiError("No name was given: enter your name, which is stored with the decision.", 422);
  }

  async function act(action, more = {}) {
    failure.show("");
    try {
      await api.post(`${path}/${action}`, { ...signed(), why: why.value.trim(), ...more });
      again();
    } catch (error) {
      failure.show(reason(error));
    }
  }

  async function work(what, asked) {
    failure.show("");
    try {
      show(await api.post(`${path}/${what}`, asked()));
    } catch (error) {
      failure.show(reason(error));
    }
  }

  function show(job) {
    const title = `${JOBS[job.kind]} ${job.request.point}`;
    progress = createJobProgress({ api, job, title, done: again, back });
    stage.replaceChildren(progress.element);
    for (const control of [compute, train, confirm]) control.disabled = true;
  }

  function back() {
    progress.close();
    progress = null;
    stage.replaceChildren();
    for (const control of [compute, train]) control.disabled = false;
    follow();
  }
}

function passWords({ passes_below: below, criteria }) {
  const words = below < 1 ? `Pass: below ${percent(below, 0)} of each limit.` : "Pass: no limit exceeded.";
  return criteria ? `${words} ${criteria}` : words;
}

function last({ events }) {
  const event = events.at(-1);
  return event ? h("span", { class: "dim" }, `${event.by}, ${moment(event.at)}`) : null;
}

function computed(clearing, { peak_deg: peak }) {
  const { p_value: p, clear_below: below, amplitude_deg: amplitude, recipe, withdrawn, steps } = clearing;
  const facts = [
    ["Predicted share of a limit", predictedWords(clearing)],
    ["p-value (high means risk)", p === null || withdrawn.length ? "–" : figure(p)],
    ["Cleared up to", below === null ? "–" : figure(below)],
    ["Computed from", steps.join(", ")],
  ];
  return h(
    "div",
    { class: "stack-tight" },
    factList(facts),
    withdrawn.length ? h("div", { class: "warning" }, h("strong", {}, "Clearance withdrawn:"), sentences(withdrawn)) : null,
    h("p", {}, promiseWords(clearing)),
    amplitude === null
      ? null
      : h("p", {}, `Largest recommended amplitude: ${figure(amplitude)} deg (this point: ${figure(peak)} deg). A separate promise: at that amplitude at most ${percent(recipe.epsilon)} of aircraft exceed a limit.`),
  );
}

function checklist(items, boxes) {
  return h(
    "fieldset",
    { class: "panel stack-tight" },
    h("legend", {}, "Confirm before flight"),
    items.map((item, k) => h("label", { class: "row campaign-check", for: boxes[k].id }, boxes[k], item)),
  );
}

function flownForm(api, send) {
  const choice = h("select", { id: "flown-recording" });
  const ends = ["start", "end"].map((key) => h("input", { type: "text", inputmode: "decimal", id: `flown-${key}`, placeholder: "as detected" }));
  const failure = errorLine();
  const element = h(
    "details",
    { class: "fold", ontoggle: offer, ...needs("POST /campaigns/{}/flown") },
    h("summary", {}, "Attach the flight recording"),
    h(
      "div",
      { class: "field-grid" },
      h("div", { class: "field" }, h("label", { for: choice.id }, "recording"), choice),
      ["start of the trim segment", "end of the manoeuvre"].map((words, k) => h("div", { class: "field" }, h("label", { for: ends[k].id }, `${words} `, h("span", { class: "unit" }, "[s]")), ends[k])),
    ),
    failure.element,
    h("div", { class: "row" }, button("Complete", () => give("flown"), { class: "button button-primary" }), button("Aborted in flight", () => give("abort"), { class: "button button-danger", ...needs("POST /campaigns/{}/abort") }), link("Upload a recording", "#/recordings")),
  );
  return { element, isTouched: () => choice.value !== "" || ends.some(({ value }) => value !== "") };

  /** Load recordings on opening: the point's may be new. */
  async function offer() {
    if (!element.open) return;
    failure.show("");
    try {
      const recordings = await api.get("/recordings");
      choice.replaceChildren(
        h("option", { value: "" }, recordings.length ? "choose a recording" : "no recording yet"),
        ...recordings.map(({ id, name, created }) => h("option", { value: id }, name.endsWith(" UTC") ? name : `${name}, ${moment(created)}`)),
      );
    } catch (error) {
      failure.show(reason(error));
    }
  }

  function give(action) {
    failure.show("");
    if (!choice.value) {
      failure.show("No recording is chosen: choose this point's recording, or upload it first.");
      return;
    }
    const [start, end] = ends.map(({ value }) => (value.trim() ? decimal(value) : null));
    if (Number.isNaN(start) || Number.isNaN(end)) {
      failure.show("Start or end is not a number: enter seconds of the recording, or leave both empty.");
      return;
    }
    send(action, { recording: choice.value, start, end });
  }
}
