/**
 * Stretches marked by hand, to be corrected by their numbers.
 *
 * Exports
 *   createSpanTable({changed}) -> {element, add(span), set(spans), read() -> [{start, end, name}], check()}
 */

import { decimal } from "../../forms/decimals.js";
import { h } from "../../lib/dom.js";
import { hiddenHead, tableHead } from "../../lib/lists.js";
import { button, errorLine } from "../../lib/view_states.js";

export function createSpanTable({ changed }) {
  let spans = [];
  const body = h("tbody", {});
  const failure = errorLine();
  const empty = h(
    "p",
    { class: "dim" },
    "None is marked yet: drag over a manoeuvre in the chart, then add the stretch.",
  );
  const table = h(
    "table",
    { class: "table span-table-rows" },
    tableHead([["Name"], ["From [s]"], ["To [s]"], hiddenHead("Remove it")]),
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
    spans.sort((a, b) => a.start - b.start);
    body.replaceChildren(...spans.map(row));
    empty.hidden = spans.length > 0;
    table.hidden = spans.length === 0;
    failure.show("");
    changed();
  }

  function row(span, k) {
    const number = (key, words) =>
      h("input", {
        type: "text",
        inputmode: "decimal",
        value: Number(span[key].toFixed(3)),
        "aria-label": `${words} of stretch ${k + 1} in seconds`,
        onchange: (event) => {
          const { value } = event.target;
          const given = decimal(value);
          if (Number.isFinite(given)) span[key] = given;
          render();
          if (!Number.isFinite(given)) say(`The ${words} is a number of seconds; “${value}” was given.`);
        },
      });
    const name = h("input", {
      type: "text",
      value: span.name,
      maxlength: 200,
      placeholder: `stretch ${k + 1}`,
      "aria-label": `name of stretch ${k + 1}`,
      onchange: (event) => {
        span.name = event.target.value.trim();
        changed();
      },
    });
    const remove = () => {
      spans = spans.filter((one) => one !== span);
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
          "aria-label": `Remove stretch ${k + 1}`,
        }),
      ),
    );
  }

  function check() {
    const wrong =
      spans.length === 0
        ? "Mark at least one stretch, or choose another way."
        : spans.some(({ start, end }) => end <= start)
          ? "A stretch must end after it begins."
          : spans.some(({ start }, k) => k > 0 && start < spans[k - 1].end)
            ? "Two stretches overlap: end the first before the second begins."
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
    add: (span) => {
      spans.push({ ...span });
      render();
    },
    set: (given) => {
      spans = given.map((span) => ({ ...span }));
      render();
    },
    read: () => spans.map(({ start, end, name }) => ({ start, end, ...(name && { name }) })),
  };
}
