/**
 * Monitors beyond their own page: warnings, the one to begin with, and flying it.
 *
 * Warnings are as the server words them: the problem, a colon, the figures.
 * warningsAt(api, monitor, epsilons) -> Promise<{warnings}>     at these epsilons
 * startFlight({api, navigate}, request) -> Promise    opens the flight's page; asks first where the monitor is of no
 *     use; rejects with the server's sentence, also while the question is open
 * createDisplayChoice(monitors, more) -> {element, adapt(now), chosen() -> [id]}     further monitors of the same test
 *     now: the monitor that raises the alarms.   more: further words about the choice
 */

import { isSimulated } from "./catalog.js";
import { askToConfirm, h } from "./dom.js";
import { capital, leadSeconds, trueMinus } from "./numbers.js";
import { checkWords, lastCheck } from "./session_check.js";

const brief = (text) => text.split(":")[0].replace(/^the monitor (is|was) /, "");

export const sentence = (text) => `${capital(trueMinus(text))}.`;

export function warningWords({ warnings }) {
  return warnings.length ? `◆ ${warnings.map(brief).join(", ")}` : "";
}

export async function warningsAt(api, monitor, epsilons) {
  const isOther = (epsilon) => epsilon !== monitor.epsilon && epsilon > 0 && epsilon < 1;
  const monitors = await Promise.all(
    epsilons.map((epsilon) => (isOther(epsilon) ? api.get(`/monitors/${monitor.id}?epsilon=${epsilon}`).catch(() => monitor) : monitor)),
  );
  return { warnings: [...new Set(monitors.flatMap(({ warnings }) => warnings))] };
}

export function warningMark({ warnings }) {
  if (!warnings.length) return null;
  return h("span.monitor-mark", { title: warnings.map(sentence).join(" ") }, warningWords({ warnings }));
}

export function warningLines({ warnings }) {
  return warnings.map((text) => h("p.monitor-warning", { role: "note" }, sentence(text)));
}

export function fittingMonitor(monitors, fits = isSimulated) {
  const fitting = monitors.filter(fits);
  return fitting.find(({ warnings }) => warnings.length === 0) ?? fitting[0] ?? monitors[0];
}

const USELESS = "urn:forewarn:useless-monitor";

export async function startFlight({ api, navigate }, request) {
  const start = async (order) => {
    const flight = await api.post("/flights", { wait_for_viewer: true, ...order });
    const check = lastCheck();
    if (check !== null || order.source.kind === "live") await noteCheck(api, flight.id, check);
    navigate(`#/fly/${flight.id}`);
  };
  try {
    await start(request);
  } catch (error) {
    const anyway = () => start({ ...request, accept_useless: true });
    if (error.kind === USELESS) askToConfirm("Fly with a monitor that is of no use?", error.message, "Fly anyway", anyway);
    throw error;
  }
}

/** The session check in the record of a flight; a server that does not store it says so on the page of the flight. */
async function noteCheck(api, id, check) {
  await api.post(`/flights/${id}/markers`, { kind: "event", text: checkWords(check) }).catch(() => {});
}

export function createDisplayChoice(monitors, more = "") {
  const boxes = monitors.map((monitor) => ({ monitor, box: h("input", { type: "checkbox", value: monitor.id }) }));
  const lines = boxes.map(({ monitor, box }) => h("label", { class: "display-choice" }, box, `${leadSeconds(monitor.lead)} s ahead: ${monitor.name} `, warningMark(monitor)));
  const element = h("details", {}, h("summary", {}, "Further monitors, for display"),
    h("div", { class: "stack" }, h("p", { class: "hint" }, `For the same aircraft, manoeuvre and sample interval. They show their risk and raise no alarm.${more}`), ...lines));
  const test = ({ dt, dataset_recipe: { aircraft, maneuver } }) => JSON.stringify([dt, aircraft, maneuver]);

  function adapt(now) {
    boxes.forEach(({ monitor, box }, k) => {
      lines[k].hidden = box.disabled = monitor.id === now.id || test(monitor) !== test(now);
      if (box.disabled) box.checked = false;
    });
    element.hidden = boxes.every(({ box }) => box.disabled);
  }

  return { element, adapt, chosen: () => boxes.filter(({ box }) => box.checked).map(({ box }) => box.value) };
}
