/**
 * One channel of a mapping: signal, unit, sign and removed bias.
 *
 * Exports
 *   createMappingRow({target, source, contents, rationale, likely, derivable, state, changed}) -> MappingRow
 *     target: of the catalog.   source: of the mapping, or null.   state: of the whole mapping
 *   MappingRow
 *     element, key, read() -> source | null, show(tiles | null, [warning])
 */

import { createMiniPlot } from "../../charts/mini_plot.js";
import { formatted, h, put } from "../../lib/dom.js";
import { rounded } from "../../lib/numbers.js";
import { followUnits, shownIn } from "../../lib/units.js";
import { button } from "../../lib/view_states.js";
import { confidence } from "./confidence.js";
import { createSignalSelect } from "./signal_select.js";

const PLAIN = { signal: "", unit: "", sign: 1, bias: 0, derivation: "" };
const NOT_RECORDED = "not in this file";

export function createMappingRow({
  target,
  source,
  contents,
  rationale,
  likely,
  derivable,
  state,
  over,
  needed,
  changed,
}) {
  const { key, symbol, label } = target;
  let now = source ? { ...PLAIN, ...source } : null;
  let edited = false;
  const name = `${label} ${symbol}`;
  const plot = createMiniPlot(name, target);
  const signal = createSignalSelect({
    id: `map-${key}`,
    label: `signal of ${name}`,
    ...contents,
    likely,
    derivable,
    none: NOT_RECORDED,
    chosen: chosenOf(now),
    changed: choose,
  });
  const units = h("select", {
    "aria-label": `unit of ${name}`,
    onchange: () => edit({ unit: units.value }),
  });
  const sign = button("", () => edit({ sign: -now.sign }), { class: "button button-small sign" });
  const bias = h("input", {
    type: "number",
    step: "any",
    oninput: () =>
      Number.isFinite(bias.valueAsNumber) && edit({ bias: bias.valueAsNumber / shownIn(target).factor }),
  });
  const inUnit = h("span", { class: "unit" });
  const verdict = h("div", { class: "map-verdict" });
  const warningList = h("ul", { class: "map-warnings", role: "status" });
  const cell = (part, words, ...content) =>
    h(
      "div",
      { class: `map-cell map-${part}` },
      words ? h("span", { class: "map-label" }, words) : null,
      content,
    );
  const element = h(
    "li",
    { class: "map-row", "data-key": key },
    h(
      "div",
      { class: "map-cell map-channel" },
      h("span", { class: "map-symbol" }, formatted(symbol)),
      h("span", {}, label, inUnit),
    ),
    cell("signal", "signal", signal),
    cell("unit", "unit", units),
    cell("sign", "sign", sign),
    cell("bias", "bias removed", bias),
    cell("confidence", "", verdict, warningList),
    cell("plot", "", plot.element),
  );
  followUnits(element, () => {
    const { unit } = shownIn(target);
    put(inUnit, ` [${unit}]`);
    bias.setAttribute("aria-label", `bias removed from ${name} in ${unit}`);
    render(true);
  });

  function choose(value) {
    if (value === "") now = null;
    else if (value.startsWith("derive:")) now = { ...PLAIN, derivation: value.slice(7) };
    else {
      const named = value.slice(7);
      const { unit: recorded } = contents.signals.find((signal) => signal.name === named) ?? {};
      now = { ...PLAIN, signal: named, unit: recorded || now?.unit || target.units[0] };
    }
    signal.value = value;
    edit({});
  }

  function edit(change) {
    if (now) now = { ...now, ...change };
    edited = true;
    render();
    changed();
  }

  function render(anew = false) {
    const measured = now !== null && now.signal !== "";
    const given = measured ? now.unit : target.unit;
    const offered = [...new Set([...target.units, given].filter(Boolean))];
    units.replaceChildren(...offered.map((name) => h("option", { value: name }, name)));
    units.value = given;
    units.disabled = !measured;
    sign.disabled = bias.disabled = now === null;
    const reversed = now?.sign === -1;
    sign.textContent = reversed ? "−" : "+";
    sign.setAttribute("aria-pressed", String(reversed));
    sign.setAttribute(
      "aria-label",
      `sign of ${name}: ${reversed ? "reversed" : "as recorded"}. Press to change.`,
    );
    if (anew || document.activeElement !== bias)
      bias.value = now === null ? "" : rounded(now.bias * shownIn(target).factor);
    element.dataset.source = now === null ? "none" : now.derivation ? "derived" : "measured";
    verdict.replaceChildren(...verdictOf());
  }

  function verdictOf() {
    if (now === null) return missingWords();
    if (now.derivation) {
      const { title = now.derivation, needs = [] } =
        derivable.find(({ key }) => key === now.derivation) ?? {};
      const from = needs.length ? ` (needs ${needs.join(", ")})` : "";
      return [chip("◆ DERIVED", "caution"), h("span", { class: "hint" }, `${title}${from}`)];
    }
    if (edited) return [h("span", { class: "dim" }, "set by you")];
    if (state === "confirmed" && over.length)
      return [
        chip("▲ confirmed over a warning", "caution"),
        h("span", { class: "hint" }, over.join("; ")),
      ];
    if (state === "confirmed") return [chip("✓ confirmed", "ok")];
    return rationale ? [confidence(rationale)] : [];
  }

  function missingWords() {
    const why = rationale?.reasons.length
      ? h("span", { class: "hint" }, rationale.reasons.join("; "))
      : null;
    const offers = derivable.map((derivation) =>
      button(`Derive it: ${derivation.title}`, () => choose(`derive:${derivation.key}`), {
        class: "button button-small",
      }),
    );
    if (!needed && !offers.length) return [h("span", { class: "dim" }, "not mapped")];
    return [needed ? chip("◆ MISSING", "caution") : null, needed ? why : null, ...offers].filter(
      Boolean,
    );
  }

  return {
    key,
    element,
    read: () => now,
    show(tiles, warnings = []) {
      plot.show(now === null ? null : (tiles ?? { min: NaN }));
      const items = warnings.map((text) => h("li", {}, chip("◆ CHECK", "caution"), ` ${text}`));
      warningList.replaceChildren(...items);
      warningList.hidden = items.length === 0;
    },
  };
}

function chosenOf(source) {
  if (source === null) return "";
  return source.derivation ? `derive:${source.derivation}` : `signal:${source.signal}`;
}

function chip(words, level) {
  return h("span", { class: "chip", "data-level": level }, words);
}
