/**
 * The user's own linear model: pasted as JSON or read from a file.
 *
 * Exports
 *   createModelInput(use) -> element      use(model) with the keys in small letters, once it parses
 */

import { h } from "../lib/dom.js";
import { button, errorLine } from "../lib/view_states.js";

const NEEDED = ["a", "b", "c", "d", "uncertainty"];
const KNOWN = [...NEEDED, "states", "altitude_m", "airspeed_mps"];
const EXAMPLE =
  '{"A": [[...]], "B": [[...]], "C": [[...]], "D": [[...]], "uncertainty": {"spread": 0.1}}';

export function createModelInput(use) {
  const text = h("textarea", {
    rows: 4,
    spellcheck: "false",
    class: "json",
    placeholder: EXAMPLE,
    "aria-label": "your own model as JSON",
  });
  const file = h("input", {
    type: "file",
    accept: ".json,application/json",
    "aria-label": "your own model as a file",
    onchange: read,
  });
  const failure = errorLine();
  return h(
    "div",
    { class: "field model-input" },
    h(
      "p",
      { class: "hint" },
      "Paste the model as JSON, or choose a file; its numbers then appear below.",
    ),
    text,
    h(
      "div",
      { class: "row" },
      button("Use this model", apply, { class: "button button-small" }),
      file,
    ),
    failure.element,
  );

  async function read() {
    if (!file.files.length) return;
    text.value = await file.files[0].text();
    apply();
  }

  function apply() {
    try {
      use(parse(text.value));
    } catch (error) {
      failure.show(error.message);
      text.setAttribute("aria-invalid", "true");
    }
  }
}

function parse(text) {
  let plain;
  try {
    plain = JSON.parse(text);
  } catch (error) {
    throw new Error(`Not JSON (${error.message}): write it like ${EXAMPLE}.`);
  }
  if (typeof plain !== "object" || plain === null || Array.isArray(plain))
    throw new Error("A model is an object with A, B, C, D and uncertainty.");
  const model = Object.fromEntries(
    Object.entries(plain)
      .filter(([key]) => key !== "kind")
      .map(([key, value]) => [key.toLowerCase(), value]),
  );
  const missing = NEEDED.filter((key) => !(key in model)).map((key) => (key.length > 1 ? key : key.toUpperCase()));
  const strange = Object.keys(model).filter((key) => !KNOWN.includes(key));
  if (missing.length)
    throw new Error(`The model lacks ${missing.join(", ")}: it needs A, B, C, D and uncertainty.`);
  if (strange.length)
    throw new Error(`The model has unknown keys: ${strange.join(", ")}. Leave them out.`);
  if (!model.states) model.states = [];
  return model;
}
