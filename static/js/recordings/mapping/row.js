/** One channel of a mapping: signal, scale, unit, sign and removed bias.   state: of the whole mapping */

import { createMiniPlot } from "../../charts/mini_plot.js";
import { button, chip, formatted, guideLink, h, put } from "../../lib/dom.js";
import { followUnits, rounded, shownIn } from "../../lib/numbers.js";
import { cell, channelCell, confidence, setByYou } from "./cells.js";
import { PLAIN, scaledWords } from "./changes.js";
import { createSignalSelect } from "./signal_select.js";

const hint = (words) => h("span.hint", words);

export function createMappingRow(row) {
  const { target, source, contents, rationale, likely, derivable, state, over, needed, changed } = row;
  const { key, symbol, label } = target;
  let now = source ? { ...PLAIN, ...source } : null;
  let isEdited = false;
  const name = `${label} ${symbol}`;
  const plot = createMiniPlot(name, target);
  const signal = createSignalSelect({
    id: `map-${key}`,
    label: `signal of ${name}`,
    ...contents,
    likely,
    derivable,
    none: "not in this file",
    chosen: chosenOf(now),
    changed: choose,
  });
  const units = h("select", { "aria-label": `unit of ${name}`, onchange: () => edit({ unit: units.value }) });
  const sign = button("", () => edit({ sign: -now.sign }), { class: "button button-small sign" });
  const bias = h("input", { type: "number", step: "any", oninput: editBias });
  const inUnit = h("span.unit");
  const scaled = h("summary");
  const fields = ["scale", "offset", "bits"].map(countsInput);
  const counts = h(
    "details.map-counts",
    { "data-keeps-input": true },
    scaled,
    fields.map(({ part, input }) => h("label", h("span", part), input)),
    guideLink("first-recording#raw-counts", "raw counts"),
  );
  const verdict = h("div.map-verdict");
  const warningList = h("ul.map-warnings", { role: "status" });
  const element = h(
    "li.map-row",
    { "data-key": key },
    channelCell(formatted(symbol), label, inUnit),
    cell("signal", "signal", signal, counts),
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
  return { key, element, read: () => now, show };

  function choose(value) {
    const [kind, named] = [value.slice(0, 7), value.slice(7)];
    if (value === "") now = null;
    else if (kind === "derive:") now = { ...PLAIN, derivation: named };
    else {
      const { unit: recorded, scale = 1, offset = 0 } = contents.signals.find((known) => known.name === named) ?? {};
      now = { ...PLAIN, signal: named, unit: recorded || now?.unit || target.units[0], scale, offset };
    }
    signal.value = value;
    edit({});
  }

  function editBias() {
    if (Number.isFinite(bias.valueAsNumber)) edit({ bias: bias.valueAsNumber / shownIn(target).factor });
  }

  /** An input of the scale, the offset or the bits of raw counts. */
  function countsInput(part) {
    const look = { "aria-label": `${part} of ${name}`, placeholder: part === "bits" ? "5-16 signed" : "" };
    const number = part === "bits" ? { type: "text", spellcheck: false } : { type: "number", step: "any" };
    const input = h("input", { ...look, ...number, oninput: change });
    return { part, input };

    function change() {
      const value = part === "bits" ? input.value.trim() : input.valueAsNumber;
      if (part === "bits" || Number.isFinite(value)) edit({ [part]: value });
    }
  }

  function edit(change) {
    if (now) now = { ...now, ...change };
    isEdited = true;
    render();
    changed();
  }

  function render(isAnew = false) {
    const isMeasured = now !== null && now.signal !== "";
    const given = isMeasured ? now.unit : target.unit;
    const offered = [...new Set([...target.units, given].filter(Boolean))];
    units.replaceChildren(...offered.map((unit) => h("option", { value: unit }, unit)));
    units.value = given;
    units.disabled = !isMeasured;
    sign.disabled = bias.disabled = now === null;
    const isReversed = now?.sign === -1;
    sign.textContent = isReversed ? "−" : "+";
    sign.setAttribute("aria-pressed", String(isReversed));
    sign.setAttribute("aria-label", `sign of ${name}: ${isReversed ? "reversed" : "as recorded"}. Press to change.`);
    if (isAnew || document.activeElement !== bias)
      bias.value = now === null ? "" : rounded(now.bias * shownIn(target).factor);
    counts.hidden = !isMeasured;
    scaled.textContent = scaledWords(now ?? PLAIN) || "numbers as recorded";
    for (const { part, input } of fields) if (isAnew || document.activeElement !== input) input.value = now?.[part] ?? "";
    element.dataset.source = now === null ? "none" : now.derivation ? "derived" : "measured";
    verdict.replaceChildren(...verdictOf());
  }

  function verdictOf() {
    if (now === null) return missingWords();
    if (now.derivation) {
      const { title = now.derivation, needs = [] } = derivable.find((known) => known.key === now.derivation) ?? {};
      return [chip("◆ DERIVED", "caution"), hint(`${title}${needs.length ? ` (needs ${needs.join(", ")})` : ""}`)];
    }
    if (isEdited) return [setByYou()];
    if (state !== "confirmed") return rationale ? [confidence(rationale)] : [];
    if (!over.length) return [chip("✓ confirmed", "ok")];
    return [chip("▲ confirmed over a warning", "caution"), hint(over.join("; "))];
  }

  function missingWords() {
    const offers = derivable.map(({ key: derivation, title }) =>
      button(`Derive it: ${title}`, () => choose(`derive:${derivation}`), { class: "button button-small" }),
    );
    if (!needed) return offers.length ? offers : [h("span.dim", "not mapped")];
    const why = rationale?.reasons ?? [];
    return [chip("◆ MISSING", "caution"), ...(why.length ? [hint(why.join("; "))] : []), ...offers];
  }

  function show(tiles, warnings = []) {
    plot.show(now === null ? null : (tiles ?? { min: NaN }));
    warningList.replaceChildren(...warnings.map((text) => h("li", chip("◆ CHECK", "caution"), ` ${text}`)));
    warningList.hidden = warnings.length === 0;
  }
}

function chosenOf(source) {
  if (source === null) return "";
  return source.derivation ? `derive:${source.derivation}` : `signal:${source.signal}`;
}
