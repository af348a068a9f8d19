/**
 * Several monitors, each at one epsilon or at several.
 *
 * Exports
 *   createMonitorChoice({api, monitors, used, catalog, changed}) -> {element, first() -> id | null, check()}
 *     used: Set of ids, chosen from the start.   first: the one chosen first in the list.   check() -> [{monitor, epsilon}], or null where the
 *     reason stands beside what is wrong
 */

import { decimals } from "../../forms/decimals.js";
import { aircraftName, kindName, limitWords } from "../../lib/catalog.js";
import { formatted, h } from "../../lib/dom.js";
import { warningMark, warningsAt } from "../../lib/monitor_warnings.js";
import { figure } from "../../lib/numbers.js";
import { followUnits } from "../../lib/units.js";
import { errorLine, link } from "../../lib/view_states.js";

export function createMonitorChoice({ api, monitors, used, catalog, changed }) {
  const failure = errorLine();
  const rows = monitors.map((monitor) =>
    rowOf(monitor, monitors.length === 1 || used.has(monitor.id)),
  );
  const none = h(
    "div",
    { class: "state-empty" },
    h("h2", {}, "No monitor yet"),
    h(
      "p",
      {},
      "A recording is scored by a monitor that was trained for its aircraft and its manoeuvre.",
    ),
    link("Train a monitor", "#/monitors/new", true),
  );
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
      : none,
    failure.element,
  );

  function rowOf(monitor, checked) {
    const { aircraft, maneuver, limits } = monitor.dataset_recipe;
    const box = h("input", {
      type: "checkbox",
      id: `choose-${monitor.id}`,
      checked,
      onchange: () => turn(),
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
    /** What speaks against the monitor does so at an epsilon: those that are typed. */
    const warn = async () => {
      const asked = epsilons.value;
      const told = await warningsAt(api, monitor, decimals(asked).map(Number));
      if (asked === epsilons.value) marks.replaceChildren(...[warningMark(told)].filter(Boolean));
    };
    const turn = () => {
      epsilons.disabled = !box.checked;
      failure.show("");
      changed();
    };
    const limitCell = h("span", {});
    followUnits(limitCell, () => limitCell.replaceChildren(formatted(limitWords(catalog, limits))));
    return {
      monitor,
      box,
      epsilons,
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
        wrong = `${monitor.name}: an ε is a number between 0 and 1; ${given.length ? `“${epsilons.value.trim()}”` : "none"} was given.`;
      else if (small)
        wrong = `${monitor.name}: its ${monitor.n_unsafe} failures serve an ε of ${figure(monitor.smallest_epsilon)} or more; ${small} was given.`;
      if (!given.length || bad || small) {
        epsilons.setAttribute("aria-invalid", "true");
        epsilons.focus();
        break;
      }
      for (const text of new Set(given)) requests.push({ monitor, epsilon: Number(text) });
    }
    failure.show(wrong);
    return wrong ? null : requests;
  }

  return {
    element,
    check,
    first: () => rows.find(({ box }) => box.checked)?.monitor.id ?? null,
  };
}
