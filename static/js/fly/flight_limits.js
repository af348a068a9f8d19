/**
 * The limits of a flight: the line that names them, and the dialog that changes them.
 *
 * createFlightLimits(element, {api, path}) -> {show(limits, channels, set)}    as hello has them; limits null: those of
 *     the monitor, or of the monitor set what its monitors share while none is in use
 * limitsNote(limits) -> {event, flag}
 * whyUnknown(limits) -> text     of limits that are unknown
 * declared(fixed) -> ", declared mach 0.9"     values of the flight condition; empty for none
 * putLines(put) -> elements    limit sets that were put in force during an ended flight
 * createLimitChoice(api, own) -> {element, ready, chosen() -> {limit_set, condition} or {}, adapt(isSet)}
 *     own: label of the choice without a limit set; null where one must be chosen
 *     isSet: whether the flight is on a monitor set: its condition alone is chosen
 */

import { labelled, numberInput, select } from "../forms/controls.js";
import { may } from "../lib/api.js";
import { loadCatalog } from "../lib/catalog.js";
import { secondsText } from "../lib/clock.js";
import { askToConfirm, formatted, h } from "../lib/dom.js";
import { limitsInWords, withLimits } from "../lib/limits.js";

const CHANGE = "PUT /flights/{}/limits";
const NONE = "No limit is known: the monitor learned from labelled flights. It shows risk only; exceedances cannot be detected.";

const BETWEEN = "no monitor of the set is in use.";

export function createFlightLimits(element, { api, path }) {
  element.classList.add("flight-limits");
  element.hidden = true;
  const words = h("span", { class: "flight-limits-words" });
  const change = h("button", { type: "button", class: "button button-small", onclick: ask, hidden: true }, "Change limits");
  element.replaceChildren(words, change);
  if (may(CHANGE)) offer();

  /** Only where the server has limit sets. */
  async function offer() {
    const sets = await api.get("/limit-sets").catch(() => []);
    change.hidden = sets.length === 0;
    element.hidden = element.hidden && change.hidden;
  }

  function ask() {
    const choice = createLimitChoice(api, null);
    const dialog = askToConfirm(
      "Change the limits of this flight?",
      "From the next sample on. A monitor trained for other limits is not applicable from then on; the page names one that is.",
      "Put in force",
      () => {
        const { limit_set: set, condition } = choice.chosen();
        return api.put(`${path}/limits`, { limit_set: set, fixed: condition });
      },
    );
    dialog.querySelector("p").after(choice.element);
  }

  function show(limits, channels, set = null) {
    const known = limitsInWords(channels);
    const between = limits === null && known === "" && set !== null;
    const unknown = between || (limits !== null && limits.limits === null);
    element.hidden = limits === null && change.hidden && known !== "";
    element.toggleAttribute("data-unknown", unknown);
    const beyond = unknown ? beyondAll(channels, ...(between ? [set.widest, "monitor"] : [limits.widest, "case"])) : "";
    if (between) {
      words.replaceChildren(h("strong", {}, "◆ LIMITS UNKNOWN: "), `${BETWEEN} `, formatted(beyond));
      return;
    }
    if (limits === null) {
      words.replaceChildren(formatted(known === "" ? NONE : `Limits: the monitor's own, ${known}`));
      return;
    }
    const version = `${limits.name} version ${limits.version}`;
    const title = `Put in force by ${limits.by}, ${limits.created.slice(0, 19).replace("T", " ")} UTC${declared(limits.fixed)}`;
    words.title = title;
    words.replaceChildren(
      h("strong", {}, unknown ? "◆ LIMITS UNKNOWN: " : "Limits in force: "),
      formatted(unknown ? `${whyUnknown(limits)}. ${beyond} · ${version}` : `${version}, ${limits.case}: ${known}`),
      h("span", { class: "dim" }, ` · put in force by ${limits.by} at ${secondsText(limits.t)}`),
    );
  }

  return { show };
}

function beyondAll(channels, limits, member) {
  const widest = limitsInWords(withLimits(channels, limits));
  if (widest === "") return `The ${member}s of the set limit no channel in common: exceedances are not detected.`;
  return `Exceedances are detected beyond the limit of every ${member} of the set: ${widest}.`;
}

export function limitsNote(inForce) {
  const { name, version, case: condition, by, limits, t, since } = inForce;
  const [words, level] = limits === null ? [`limits unknown, ${whyUnknown(inForce)}`, "caution"] : [`limits in force: ${condition}`];
  const text = `${words} (${name} version ${version}, put in force by ${by})`;
  const flag = { key: null, t: since ?? t, word: limits === null ? "limits unknown" : "limits", colour: "caution" };
  return { event: { t: since, text, level, seen: true }, flag };
}

export const whyUnknown = ({ reason }) => reason.replace(/^limits unknown: /, "");

export function putLines(put) {
  return put.map(({ name, version, by, t, created, fixed }) =>
    h("p", { class: "ahead-summary" }, h("strong", {}, "Limits: "), `${name} version ${version}${declared(fixed)}, put in force by ${by} at ${secondsText(t)}, ${created.slice(11, 19)} UTC.`));
}

export function declared(fixed) {
  const values = Object.entries(fixed).map(([key, value]) => `${key} ${value}`);
  return values.length === 0 ? "" : `, declared ${values.join(", ")}`;
}

export function createLimitChoice(api, own) {
  const sets = select([own !== null && ["", own]], { onchange: () => adapt() });
  let inputs = [];
  const fields = h("div.stack", h("p.hint", "Declare the flight condition, or leave it empty if a live source sends it."));
  const stored = ["Limits by flight condition are stored as ", h("a", { href: "#/limits" }, "limit sets"), ", with author and date of each version."];
  const limits = labelled("Limits", sets, { hint: own !== null && stored }).element;
  const element = h("div.stack.form", limits, fields);
  let onSet = false;
  const ready = load();

  async function load() {
    const [{ conditions }, stored] = await Promise.all([loadCatalog(api), api.get("/limit-sets").catch(() => [])]);
    inputs = conditions.map(({ key }) => ({ key, input: numberInput() }));
    fields.append(...conditions.map(({ label, unit }, k) => labelled(label, inputs[k].input, { unit }).element));
    sets.append(...stored.map(({ id, name, newest }) => h("option", { value: id }, `${name}, version ${newest}`)));
    adapt();
    return stored.length;
  }

  function adapt(isSet = onSet) {
    onSet = isSet;
    limits.hidden = onSet;
    fields.hidden = !onSet && sets.value === "";
  }

  function chosen() {
    if (!onSet && sets.value === "") return {};
    const given = inputs.filter(({ input }) => input.value !== "");
    const condition = Object.fromEntries(given.map(({ key, input }) => [key, Number(input.value)]));
    return onSet ? { condition } : { limit_set: sets.value, condition };
  }

  return { element, ready, chosen, adapt };
}
