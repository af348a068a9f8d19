/**
 * The next point of a campaign: its state, clearance, checklist and actions.
 *
 * running: its running job, if any.   again(): reloads the campaign
 * isIdle()     nothing is typed or running;   acted() -> Promise     the newest decision is answered
 */

import { checkbox, fold, group, labelled, select, textInput } from "../forms/controls.js";
import { asksForToken, needs, reason } from "../lib/api.js";
import { button, errorLine, factList, formatted, h, link, sentences } from "../lib/dom.js";
import { createJobProgress } from "../lib/job_progress.js";
import { decimal, figure, moment, percent } from "../lib/numbers.js";
import { remember, remembered } from "../lib/storage.js";
import { failedWords, predictedWords, promiseWords, stateChip } from "./states.js";

const NAME_KEY = "forewarn.name";
const JOBS = { clearance: "Clearing", monitor: "Training a monitor for" };
const PRIMARY = { class: "button button-primary" };
const DANGER = { class: "button button-danger" };

export function nextPoint({ api, path, campaign, running, again }) {
  const point = campaign.points.find(({ name }) => name === campaign.next);
  if (!point) {
    const element = h("section.panel", h("h2", "Every point is complete or aborted"));
    return { element, isIdle: () => true, acted: async () => {}, close: () => {} };
  }
  const { name, state, clearing, monitor } = point;
  const { is_first: isFirst, smaller_step: step } = campaign;
  let progress = null;
  let acting = Promise.resolve();
  const failure = errorLine();
  const signed = () => remember(NAME_KEY, by.value.trim());
  const by = textInput({ maxlength: 200, value: remembered(NAME_KEY) ?? "", onchange: signed });
  const byField = labelled("your name", by);
  const why = textInput({ maxlength: 2000 });
  const whyField = labelled("reason", why);
  const boxes = campaign.checklist.map(() => checkbox({ onchange: follow }));
  const flown = flownForm(api, act);
  const pressing = (does) => (word, route, look, more) => button(word, () => does(route, more), { ...look, ...needs(`POST /campaigns/{}/${route}`) });
  const [decide, start] = [pressing(act), pressing(work)];
  const confirm = decide(isFirst ? "Clear" : "Confirm as cleared", "confirm", PRIMARY);
  const compute = start(clearing ? "Compute clearance again" : "Compute clearance", "clearance", clearing ? {} : PRIMARY);
  const together = canBeMonitored(point) && start("Compute with its monitor", "clearance", {}, { with_monitor: true });
  const train = start(monitor ? "Train its monitor again" : "Train a monitor", "monitor");
  const stage = h("div.stack");
  const uncomputed = isFirst
    ? "No flown step to compute from: engineering decision required."
    : "Clearance not computed yet.";
  const element = h(
    "section.panel.stack.campaign-next",
    { "data-state": state, "aria-label": "Next point" },
    h("div.row", h("h2", `Next: ${name}, ${figure(point.peak_deg)} deg`), stateChip(state), last(point)),
    failedBefore(campaign, point),
    clearing ? computed(clearing, point) : h("p", uncomputed),
    step && h("p", `Proposed: fly ${step.name} (${figure(step.peak_deg)} deg) first. Its clearance is computed as for any point.`),
    h("p.hint", passWords(point)),
    state === "on condition" && checklist(campaign.checklist, boxes),
    h("div.field-grid", !asksForToken() && byField.element, whyField.element),
    h(
      "div.row",
      state !== "cleared" && (isFirst || state === "on condition") && confirm,
      !isFirst && compute,
      together,
      step && decide(`Fly ${step.name} first`, "smaller-step", PRIMARY),
      train,
      state === "cleared" && link("Fly live", `#/fly?kind=live${monitor ? `&monitor=${monitor}` : ""}`),
      state !== "hold" && decide("Hold", "hold"),
      decide("Abort", "abort", DANGER),
    ),
    failure.element,
    stage,
    flown.element,
  );
  follow();
  if (running) show(running);
  return { element, isIdle, acted: () => acting, close: () => progress?.close() };

  function isIdle() {
    const isTyping = element.contains(document.activeElement?.closest("input, select"));
    const isTouched = why.value || boxes.some(({ checked }) => checked) || flown.isTouched();
    return progress === null && !isTouched && !isTyping;
  }

  function follow() {
    confirm.disabled = !boxes.every(({ checked }) => checked);
  }

  /** Whether the decision has a name; it is stored with it. */
  function isSigned() {
    if (asksForToken() || by.value.trim()) return true;
    byField.say("No name was given: enter your name, which is stored with the decision.");
    byField.focus();
    return false;
  }

  function act(action, more = {}) {
    acting = post(action, { why: why.value.trim(), ...more }).then((answer) => answer && again());
    return acting;
  }

  async function work(kind, more) {
    const job = await post(kind, more);
    if (job) show(job);
  }

  /** The server's answer; undefined where it refused, or a name is missing. Training is no decision. */
  async function post(action, more) {
    failure.show("");
    const isDecision = action !== "monitor";
    if (isDecision && !isSigned()) return undefined;
    const author = isDecision && !asksForToken() && { by: by.value.trim() };
    try {
      return await api.post(`${path}/${action}`, { point: name, ...author, ...more });
    } catch (error) {
      return refuse(reason(error));
    }
  }

  function refuse(words) {
    if (!/ reason/.test(words)) return failure.show(words);
    whyField.say(words);
    return whyField.focus();
  }

  function show(job) {
    const title = `${JOBS[job.kind]} ${job.request.point}`;
    progress = createJobProgress({ api, job, title, done: again, back });
    stage.replaceChildren(progress.element);
    for (const control of [compute, together, train, confirm].filter(Boolean)) control.disabled = true;
  }

  function back() {
    progress.close();
    progress = null;
    stage.replaceChildren();
    for (const control of [compute, together, train].filter(Boolean)) control.disabled = false;
    follow();
  }
}

/** Whether the point is on hold by its p-value alone, so that its monitor may help. */
function canBeMonitored({ state, clearing }) {
  return state === "hold" && clearing && clearing.p_value !== null && !clearing.monitor_epsilon && !clearing.withdrawn.length;
}

function failedBefore({ points }, { name, condition }) {
  const before = points.slice(0, points.findIndex((point) => point.name === name));
  const step = before.findLast((point) => point.condition === condition && point.flown);
  return step && !step.flown.passed ? h("p.warning", h("strong", failedWords(step))) : null;
}

function passWords({ passes_below: below, criteria }) {
  const words = below < 1 ? `Pass: below ${percent(below, 0)} of each limit.` : "Pass: no limit exceeded.";
  return criteria ? `${words} ${criteria}` : words;
}

function last({ events }) {
  const event = events.at(-1);
  return event ? h("span.dim", `${event.by}, ${moment(event.at)}`) : null;
}

function computed(clearing, { peak_deg: peak }) {
  const { p_value: p, p_error: error, close, clear_below: below, amplitude_deg: amplitude, monitor_epsilon: epsilon, recipe, withdrawn, steps } = clearing;
  const risk = error === null ? figure(p) : `${figure(p)} ± ${figure(error, 1)}`;
  const facts = [
    ["Predicted share of a limit", predictedWords(clearing)],
    ["p-value (high means risk)", p === null || withdrawn.length ? "–" : risk],
    ["Cleared up to p-value", below === null ? "–" : figure(below)],
    ...(epsilon ? [["With its monitor at ε", figure(epsilon, 2)]] : []),
    ["Computed from", steps.join(", ")],
  ];
  return h(
    "div.stack-tight",
    factList(facts),
    withdrawn.length ? h("div.warning", h("strong", "Clearance withdrawn:"), sentences(withdrawn)) : null,
    close && !withdrawn.length && h("p.warning", "Close to the threshold: other random draws may decide otherwise."),
    h("p", promiseWords(clearing)),
    amplitude !== null &&
      h("p", `Largest recommended amplitude: ${figure(amplitude)} deg (this point: ${figure(peak)} deg). A separate promise: at that amplitude at most ${percent(recipe.epsilon)} of aircraft exceed a limit.`),
  );
}

function checklist(items, boxes) {
  const rows = items.map((item, k) => h("label.row.campaign-check", boxes[k], h("span", formatted(item))));
  return h("fieldset.panel.stack-tight", h("legend", "Confirm before flight"), rows);
}

function flownForm(api, send) {
  const choice = select([], {});
  const chosen = labelled("recording", choice);
  const ends = ["start of the trim segment", "end of the manoeuvre"].map((words) => {
    const input = textInput({ inputmode: "decimal", placeholder: "as detected" });
    const read = () => (input.value.trim() ? decimal(input.value) : null);
    return { ...labelled(words, input, { unit: "s" }), input, read };
  });
  const failure = errorLine();
  const element = fold(
    "Attach the flight recording",
    h("div.field-grid", [chosen, ...ends].map((field) => field.element)),
    failure.element,
    h(
      "div.row",
      button("Complete", () => give("flown"), PRIMARY),
      button("Aborted in flight", () => give("abort"), { ...DANGER, ...needs("POST /campaigns/{}/abort") }),
      link("Upload a recording", "#/recordings"),
    ),
  );
  element.addEventListener("toggle", offer);
  if ("data-refused" in needs("POST /campaigns/{}/flown")) element.dataset.refused = true;
  return { element, isTouched: () => choice.value !== "" || ends.some(({ input }) => input.value !== "") };

  /** Load recordings on opening: the point's may be new. */
  async function offer() {
    if (element.open) await failure.attempt(async () => list(await api.get("/recordings?limit=200")));
  }

  function list(recordings) {
    const wordsOf = ({ name, created }) => (name.endsWith(" UTC") ? name : `${name}, ${moment(created)}`);
    const none = h("option", { value: "" }, recordings.length ? "choose a recording" : "no recording yet");
    choice.replaceChildren(none, ...recordings.map((recording) => h("option", { value: recording.id }, wordsOf(recording))));
  }

  function give(action) {
    const problems = [
      [chosen, choice.value ? "" : "No recording is chosen: choose this point's recording, or upload it first."],
      ...ends.map((end) => [end, Number.isNaN(end.read()) ? "Not a number: enter seconds of the recording, or leave it empty." : ""]),
    ];
    if (!group({}, () => problems).check()) return;
    const [start, end] = ends.map(({ read }) => read());
    send(action, { recording: choice.value, start, end });
  }
}
