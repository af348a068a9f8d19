/**
 * Manoeuvres marked by hand, with editable times.
 *
 * Exports
 *   createManoeuvreTable({changed}) -> {element, add(manoeuvre), set(manoeuvres), read() -> [{start, end, name}], check()}
 */

import { decimal } from "../../forms/decimals.js";
import { h } from "../../lib/dom.js";
import { hiddenHead, tableHead } from "../../lib/lists.js";
import { button, errorLine } from "../../lib/view_states.js";

export function createManoeuvreTable({ changed }) {
  let manoeuvres = [];
  const body = h("tbody", {});
  const failure = errorLine();
  const empty = h(
    "p",
    { class: "dim" },
    "No manoeuvre marked yet: drag over one in the chart, then add it.",
  );
  const table = h(
    "table",
    { class: "table manoeuvre-rows" },
    tableHead([["Name"], ["From [s]"], ["To [s]"], hiddenHead("Remove")]),
    body,
  );
  const element = h(
    "div",
    { class: "stack-tight" },
    empty,
    h("div", { class: "table-scroll" }, table),
    failure.element,
  );
  render();

  function render() {
    manoeuvres.sort((a, b) => a.start - b.start);
    body.replaceChildren(...manoeuvres.map(row));
    empty.hidden = manoeuvres.length > 0;
    table.hidden = manoeuvres.length === 0;
    failure.show("");
    changed();
  }

  function row(manoeuvre, k) {
    const number = (key, words) =>
      h("input", {
        type: "text",
        inputmode: "decimal",
        value: Number(manoeuvre[key].toFixed(3)),
        "aria-label": `${words} of manoeuvre ${k + 1} in seconds`,
        onchange: (event) => {
          const { value } = event.target;
          const given = decimal(value);
          if (Number.isFinite(given)) manoeuvre[key] = given;
          render();
          if (!Number.isFinite(given))
            say(`“${value}” was given: the ${words} is a number of seconds.`);
        },
      });
    const name = h("input", {
      type: "text",
      value: manoeuvre.name,
      maxlength: 200,
      placeholder: `manoeuvre ${k + 1}`,
      "aria-label": `name of manoeuvre ${k + 1}`,
      onchange: (event) => {
        manoeuvre.name = event.target.value.trim();
        changed();
      },
    });
    const remove = () => {
      manoeuvres = manoeuvres.filter((other) => other !== manoeuvre);
      render();
    };
    const cell = (content) => h("td", {}, h("div", { class: "field" }, content));
    return h(
      "tr",
      {},
      cell(name),
      cell(number("start", "start")),
      cell(number("end", "end")),
      h(
        "td",
        {},
        button("Remove", remove, {
          class: "button button-small",
          "aria-label": `Remove manoeuvre ${k + 1}`,
        }),
      ),
    );
  }

  function check() {
    const wrong =
      manoeuvres.length === 0
        ? "Mark at least one manoeuvre, or choose another option."
        : manoeuvres.some(({ start, end }) => end <= start)
          ? "A manoeuvre must end after it begins."
          : manoeuvres.some(({ start }, k) => k > 0 && start < manoeuvres[k - 1].end)
            ? "Two manoeuvres overlap: end the first before the second begins."
            : "";
    say(wrong);
    return wrong === "";
  }

  function say(wrong) {
    failure.show(wrong);
  }

  return {
    element,
    check,
    add: (manoeuvre) => {
      manoeuvres.push({ ...manoeuvre });
      render();
    },
    set: (given) => {
      manoeuvres = given.map((manoeuvre) => ({ ...manoeuvre }));
      render();
    },
    read: () => manoeuvres.map(({ start, end, name }) => ({ start, end, ...(name && { name }) })),
  };
}
