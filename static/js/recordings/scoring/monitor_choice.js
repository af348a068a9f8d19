/**
 * Choose monitors, each with one epsilon or several. The newest monitor that fits the recording is preselected.
 *
 * Exports
 *   createMonitorChoice({api, recording, monitors, used, catalog, changed, none}) -> {element, ready, first() -> id | null, check(), close()}
 *     used: Set of ids that are preselected.   none(): no monitor fits
 *     ready: Promise, until a monitor was looked for.   first: id of the first monitor chosen.   check() -> [{monitor, epsilon}]; null if an entry is wrong, with the reason shown
 */

import { decimals } from "../../forms/decimals.js";
import { reason } from "../../lib/api.js";
import { aircraftName, kindName, limitWords } from "../../lib/catalog.js";
import { formatted, h } from "../../lib/dom.js";
import { warningMark, warningsAt } from "../../lib/monitor_warnings.js";
import { figure } from "../../lib/numbers.js";
import { followUnits } from "../../lib/units.js";
import { errorLine } from "../../lib/view_states.js";

const MOST_TRIED = 20; // monitors, the newest first

export function createMonitorChoice({ api, recording, monitors, used, catalog, changed, none }) {
  let touched = false;
  const failure = errorLine();
  const rows = monitors.map((monitor) => rowOf(monitor, used.has(monitor.id)));
  const status = h("p", { class: "hint", role: "status" });
  const element = h(
    "fieldset",
    { class: "stack-tight" },
    h("legend", {}, "Monitors"),
    rows.length
      ? h(
          "ul",
          { class: "monitor-choice" },
          rows.map((row) => row.element),
        )
      : h("p", { class: "dim" }, "No monitor yet."),
    status,
    failure.element,
  );
  const ready = rows.some(({ box }) => box.checked) ? Promise.resolve() : preselect();

  /** Choose the newest monitor that finds its manoeuvre in the recording. */
  async function preselect() {
    for (const row of rows.slice(0, MOST_TRIED)) {
      if (touched) return;
      const manoeuvres = await manoeuvresFor(row);
      if (touched) return;
      if (manoeuvres.length) {
        row.turn(true);
        return;
      }
    }
    status.textContent = rows.length ? "No monitor here fits this recording." : "";
    none();
  }

  async function manoeuvresFor({ monitor, refused }) {
    try {
      return await api.get(`/recordings/${recording.id}/manoeuvres?monitor=${monitor.id}`);
    } catch (error) {
      if (error.status === 422) refused.textContent = `◆ ${reason(error)}`;
      return [];
    }
  }

  function rowOf(monitor, checked) {
    const { aircraft, maneuver, limits } = monitor.dataset_recipe;
    const box = h("input", {
      type: "checkbox",
      id: `choose-${monitor.id}`,
      checked,
      onchange: () => {
        touched = true;
        turn(box.checked);
      },
    });
    const epsilons = h("input", {
      type: "text",
      inputmode: "decimal",
      class: "narrow",
      value: monitor.epsilon,
      disabled: !checked,
      "aria-label": `epsilons of ${monitor.name}, separated by spaces`,
      oninput: () => {
        epsilons.removeAttribute("aria-invalid");
        warn();
      },
    });
    const marks = h("span", {}, warningMark(monitor));
    /** Warnings depend on epsilon: show those of the epsilons that are typed. */
    const warn = async () => {
      const asked = epsilons.value;
      const warned = await warningsAt(api, monitor, decimals(asked).map(Number));
      if (asked === epsilons.value) marks.replaceChildren(...[warningMark(warned)].filter(Boolean));
    };
    const refused = h("span", { class: "monitor-refused" });
    const turn = (chosen) => {
      box.checked = chosen;
      epsilons.disabled = !chosen;
      failure.show("");
      changed();
    };
    const limitCell = h("span", {});
    followUnits(limitCell, () => limitCell.replaceChildren(formatted(limitWords(catalog, limits))));
    return {
      monitor,
      box,
      epsilons,
      refused,
      turn,
      element: h(
        "li",
        {},
        h("label", { class: "monitor-name", for: box.id }, box, h("span", {}, monitor.name)),
        h(
          "span",
          { class: "hint monitor-about" },
          `${aircraftName(catalog, aircraft)}, ${kindName(catalog, "maneuver", maneuver)}, `,
          limitCell,
          `; ${figure(monitor.lead)} s ahead, every ${figure(monitor.dt)} s`,
          marks,
          refused,
        ),
        h("span", { class: "field field-inline" }, h("span", {}, "ε"), epsilons),
      ),
    };
  }

  function check() {
    const chosen = rows.filter(({ box }) => box.checked);
    const requests = [];
    let wrong = chosen.length ? "" : "Choose at least one monitor.";
    for (const { monitor, epsilons } of chosen) {
      const given = decimals(epsilons.value);
      const bad = given.find((text) => !(Number(text) > 0 && Number(text) < 1));
      const small = given.find((text) => Number(text) < monitor.smallest_epsilon * (1 - 1e-9));
      if (!given.length || bad)
        wrong = `${monitor.name}: ${given.length ? `“${epsilons.value.trim()}”` : "no ε"} was given; enter numbers between 0 and 1.`;
      else if (small)
        wrong = `${monitor.name}: ${small} was given, and its ${monitor.n_unsafe} failures are enough for ε ≥ ${figure(monitor.smallest_epsilon)}. Raise ε, or train on more failures.`;
      if (!given.length || bad || small) {
        epsilons.setAttribute("aria-invalid", "true");
        epsilons.focus();
        break;
      }
      for (const text of new Set(given)) requests.push({ monitor, epsilon: Number(text) });
    }
    failure.show(wrong);
    if (wrong) failure.element.scrollIntoView({ block: "center" });
    return wrong ? null : requests;
  }

  return {
    element,
    check,
    ready,
    close: () => {
      touched = true;
    },
    first: () => rows.find(({ box }) => box.checked)?.monitor.id ?? null,
  };
}
