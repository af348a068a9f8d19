/** Manoeuvres marked by hand, with editable times. */

import { textInput } from "../../forms/controls.js";
import { button, errorLine, h, hiddenHead, table } from "../../lib/dom.js";
import { decimal } from "../../lib/numbers.js";

export function createManoeuvreTable({ changed }) {
  let manoeuvres = [];
  const failure = errorLine();
  const shown = h("div");
  const element = h("div.stack-tight", shown, failure.element);
  const none = h("p.dim", "No manoeuvre marked yet: drag over one in the chart, then add it.");
  const field = (content) => h("div.field", content);
  const columns = [
    ["Name", (manoeuvre, k) => field(nameInput(manoeuvre, k))],
    ["From [s]", (manoeuvre, k) => field(timeInput(manoeuvre, k, "start"))],
    ["To [s]", (manoeuvre, k) => field(timeInput(manoeuvre, k, "end"))],
    [hiddenHead("Remove"), removeButton],
  ];
  set([]);
  return {
    element,
    check,
    set,
    add: (manoeuvre) => set([...manoeuvres, manoeuvre]),
    read: () => manoeuvres.map(({ start, end, name }) => ({ start, end, ...(name && { name }) })),
  };

  function set(given) {
    manoeuvres = given.map((manoeuvre) => ({ ...manoeuvre })).sort((a, b) => a.start - b.start);
    const rows = table({ columns, items: manoeuvres, classes: "manoeuvre-rows", panel: false });
    shown.replaceChildren(manoeuvres.length ? rows : none);
    failure.show("");
    changed();
  }

  function nameInput(manoeuvre, k) {
    return textInput({
      value: manoeuvre.name,
      maxlength: 200,
      placeholder: `manoeuvre ${k + 1}`,
      "aria-label": `name of manoeuvre ${k + 1}`,
      onchange: (event) => {
        manoeuvre.name = event.target.value.trim();
        changed();
      },
    });
  }

  function timeInput(manoeuvre, k, key) {
    return textInput({
      inputmode: "decimal",
      value: Number(manoeuvre[key].toFixed(3)),
      "aria-label": `${key} of manoeuvre ${k + 1} in seconds`,
      onchange: ({ target: { value } }) => {
        const given = decimal(value);
        if (Number.isFinite(given)) manoeuvre[key] = given;
        set(manoeuvres);
        if (!Number.isFinite(given)) failure.show(`“${value}” was given: the ${key} is a number of seconds.`);
      },
    });
  }

  function removeButton(manoeuvre, k) {
    const remove = () => set(manoeuvres.filter((other) => other !== manoeuvre));
    return button("Remove", remove, { class: "button button-small", "aria-label": `Remove manoeuvre ${k + 1}` });
  }

  function check() {
    const wrong = wrongOf(manoeuvres);
    failure.show(wrong);
    return wrong === "";
  }
}

function wrongOf(manoeuvres) {
  const overlaps = ({ start }, k) => k > 0 && start < manoeuvres[k - 1].end;
  if (manoeuvres.length === 0) return "Mark at least one manoeuvre, or choose another option.";
  if (manoeuvres.some(({ start, end }) => end <= start)) return "A manoeuvre must end after it begins.";
  return manoeuvres.some(overlaps) ? "Two manoeuvres overlap: end the first before the second begins." : "";
}
