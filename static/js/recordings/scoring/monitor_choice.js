/**
 * Choose monitors, each with one epsilon or several, and monitor sets, each with the flight condition that was not
 * recorded. The newest monitor that fits the recording is preselected.
 *
 * used: Set of ids that are preselected.   none(): no monitor fits.   first() -> id of the first monitor chosen | null
 * requests() -> [{words, body}]    of scorings, without trim and manoeuvres
 */

import { checkbox, textInput } from "../../forms/controls.js";
import { reason } from "../../lib/api.js";
import { limitsOfMonitor, testWords } from "../../lib/catalog.js";
import { errorLine, formatted, h } from "../../lib/dom.js";
import { warningMark, warningsAt } from "../../lib/monitors.js";
import { decimals, figure, followUnits } from "../../lib/numbers.js";

const MOST_TRIED = 20; // monitors, the newest first

export function createMonitorChoice({ api, recording, monitors, sets, used, catalog, changed, none }) {
  let isTouched = false;
  const failure = errorLine();
  const rows = monitors.map((monitor) => rowOf(monitor, used.has(monitor.id)));
  const setRows = sets.map(setRowOf);
  const status = h("p.hint", { role: "status" });
  const list = rows.length ? h("ul.monitor-choice", [...rows, ...setRows].map((row) => row.element)) : h("p.dim", "No monitor yet.");
  const element = h("fieldset.stack-tight", h("legend", "Monitors"), list, status, failure.element);
  const chosen = () => rows.filter(({ box }) => box.checked);
  const chosenSets = () => setRows.filter(({ box }) => box.checked);
  const ready = chosen().length ? Promise.resolve() : preselect();
  return {
    element,
    ready,
    check,
    requests: () => [...chosen().flatMap(requestsOf), ...chosenSets().map((row) => row.request())],
    first: () => chosen()[0]?.monitor.id ?? chosenSets()[0]?.first ?? null,
    close: () => {
      isTouched = true;
    },
  };

  /** Choose the newest monitor that finds its manoeuvre in the recording. */
  async function preselect() {
    for (const row of rows.slice(0, MOST_TRIED)) {
      const isFitting = (await manoeuvresFor(row)).length > 0;
      if (isTouched) return undefined;
      if (isFitting) return row.turn(true);
    }
    status.textContent = rows.length ? "No monitor here fits this recording." : "";
    return none();
  }

  function manoeuvresFor({ monitor, refused }) {
    return api.get(`/recordings/${recording.id}/manoeuvres?monitor=${monitor.id}`).catch((error) => {
      if (error.status === 422) refused.textContent = `◆ ${reason(error)}`;
      return [];
    });
  }

  function rowOf(monitor, isChecked) {
    const box = checkbox({ id: `choose-${monitor.id}`, checked: isChecked, onchange: choose });
    const epsilons = textInput({
      inputmode: "decimal",
      class: "narrow",
      value: monitor.epsilon,
      disabled: !isChecked,
      "aria-label": `epsilons of ${monitor.name}, separated by spaces`,
      oninput: warn,
    });
    const marks = h("span", warningMark(monitor));
    const refused = h("span.monitor-refused");
    const limitCell = h("span");
    followUnits(limitCell, () => limitCell.replaceChildren(formatted(limitsOfMonitor(catalog, monitor))));
    const test = `${testWords(catalog, monitor)}, limits: `;
    const times = `; ${figure(monitor.lead)} s ahead, every ${figure(monitor.dt)} s`;
    const item = h(
      "li",
      h("label.monitor-name", { for: box.id }, box, h("span", monitor.name)),
      h("span.hint.monitor-about", test, limitCell, times, marks, refused),
      h("span.field.field-inline", h("span", "ε"), epsilons),
    );
    return { monitor, box, epsilons, refused, turn, element: item, given: () => decimals(epsilons.value) };

    /** Warnings depend on epsilon: show those of the epsilons that are typed. */
    async function warn() {
      epsilons.removeAttribute("aria-invalid");
      const asked = epsilons.value;
      const warned = await warningsAt(api, monitor, decimals(asked).map(Number));
      if (asked === epsilons.value) marks.replaceChildren(...[warningMark(warned)].filter(Boolean));
    }

    function choose() {
      isTouched = true;
      turn(box.checked);
    }

    function turn(isChosen) {
      box.checked = isChosen;
      epsilons.disabled = !isChosen;
      failure.show("");
      changed();
    }
  }

  function setRowOf({ id, name, cases }) {
    const box = checkbox({
      id: `choose-${id}`,
      onchange: () => {
        isTouched = true;
        declared.hidden = !box.checked;
        failure.show("");
        changed();
      },
    });
    const needed = catalog.conditions.filter(({ key }) => cases.some(({ ranges }) => key in ranges));
    const inputs = needed.map(({ key, label }) => h("input.narrow", { type: "number", step: "any", name: key, oninput: ({ target }) => target.removeAttribute("aria-invalid"), "aria-label": `${label} for ${name}` }));
    const declared = h(
      "span.field.field-inline",
      { hidden: true },
      h("span.hint", "Flight condition, where it was not recorded:"),
      needed.map(({ label, unit }, k) => [h("span", label, h("span.unit", unit && ` [${unit}]`)), inputs[k]]),
    );
    const about = cases.map(({ name: condition, monitor_name: monitor }) => `${condition}: ${monitor}`).join("; ");
    const element = h(
      "li",
      h("label.monitor-name", { for: box.id }, box, h("span", name)),
      h("span.hint.monitor-about", `monitor set by flight condition, each at its own ε: ${about}`),
      declared,
    );
    return { box, element, inputs, first: cases[0].monitor, request };

    function request() {
      const given = inputs.filter(({ value }) => value !== "").map((input) => [input.name, Number(input.value)]);
      return { words: `monitor set ${name}`, body: { monitor_set: id, condition: Object.fromEntries(given) } };
    }
  }

  async function check() {
    await ready;
    const wrong = chosen().find((row) => wrongOf(row));
    const bad = wrong ? wrong.epsilons : chosenSets().flatMap(({ inputs }) => inputs).find(({ validity }) => validity.badInput);
    const isNone = chosen().length + chosenSets().length === 0;
    const ofSet = bad ? `${bad.ariaLabel}: no number was given; enter one, or leave the field empty.` : "";
    const words = wrong ? `${wrong.monitor.name}: ${wrongOf(wrong)}` : isNone ? "Choose at least one monitor." : ofSet;
    failure.show(words);
    bad?.setAttribute("aria-invalid", "true");
    bad?.focus();
    if (words) failure.element.scrollIntoView({ block: "center" });
    return words === "";
  }
}

function wrongOf({ monitor, epsilons, given }) {
  const numbers = given();
  const isBad = numbers.some((text) => !(Number(text) > 0 && Number(text) < 1));
  if (!numbers.length || isBad)
    return `${numbers.length ? `“${epsilons.value.trim()}”` : "no ε"} was given; enter numbers between 0 and 1.`;
  const small = numbers.find((text) => Number(text) < monitor.smallest_epsilon * (1 - 1e-9));
  if (small === undefined) return "";
  return `${small} was given, and its ${monitor.n_unsafe} failures are enough for ε ≥ ${figure(monitor.smallest_epsilon)}. Raise ε, or train on more failures.`;
}

function requestsOf({ monitor, given }) {
  return [...new Set(given())].map((text) => {
    const epsilon = Number(text);
    return { words: `${monitor.name} at ε ${epsilon}`, body: { monitor: monitor.id, epsilon } };
  });
}
