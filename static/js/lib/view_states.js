/**
 * Pages without content: loading, empty, failed, each with the next step.
 *
 * Exports
 *   loading(text), empty(title, text, ...actions), failure(error, again) -> element
 *   state(kind, title, text, ...actions) -> section    of a panel; kind "empty" | "loading" | "error"
 *   pageOf(title, ...) -> element        a scrolling page with its heading
 *   link(text, hash, primary), button(text, pressed, attributes)
 *   panel(title, content, attributes) -> section    with its heading
 *   chip(words, level, title) -> element
 *   deleteButton({api, path, what, consequence, done, short}) -> <button>     asks first; done() after the deletion
 *     path: of the resource.   what: "monitor “card 7”".   short: its name, for a small button in a list
 *   errorLine() -> {element, show(words)}     hidden while there are no words
 *   askToConfirm(question, consequence, word, act, stay) -> open dialog; it shows why act() failed
 */

import { reason } from "./api.js";
import { h } from "./dom.js";
import { needs } from "./me.js";

export function loading(text) {
  return h("div", { class: "state-loading", role: "status" }, h("p", {}, text));
}

export function empty(title, text, ...actions) {
  return state("empty", title, text, ...actions);
}

export function failure(error, again) {
  const actions = again ? [button("Try again", again)] : [];
  return state("error", "This could not be shown", reason(error), ...actions);
}

export function state(kind, title, text, ...actions) {
  const role = kind === "error" ? "alert" : "status";
  const row = actions.length > 0 ? h("div", { class: "row" }, actions) : null;
  return h("section", { class: `state-${kind}`, role }, h("h2", {}, title), h("p", {}, text), row);
}

export function pageOf(title, actions, ...content) {
  const head = h(
    "header",
    { class: "page-head" },
    h("h1", {}, title),
    h("div", { class: "row page-actions" }, actions),
  );
  return h("div", { class: "page" }, h("div", { class: "page-body stack" }, head, content));
}

export function link(text, hash, primary = false) {
  return h("a", { class: primary ? "button button-primary" : "button", href: hash }, text);
}

export function button(text, pressed, attributes = {}) {
  return h("button", { type: "button", class: "button", onclick: pressed, ...attributes }, text);
}

export function panel(title, content, attributes = {}) {
  return h("section", { class: "panel stack-tight", ...attributes }, h("h2", { class: "panel-title" }, title), content);
}

export function chip(words, level, title = null) {
  return h("span", { class: "chip", "data-level": level, title }, words);
}

export function deleteButton({ api, path, what, consequence, done, short = "" }) {
  const route = `DELETE ${path.replace(/(\/[^/]+)\/[^/]+/g, "$1/{}")}`;
  const look = short
    ? { class: "button button-small", "aria-label": `Delete ${short}` }
    : { class: "button button-danger" };
  return button("Delete", ask, { ...look, ...needs(route) });

  function ask() {
    askToConfirm(`Delete the ${what}?`, consequence, "Delete permanently", async () => {
      await api.delete(path);
      await done();
    });
  }
}

export function errorLine() {
  const element = h("p", { class: "error", role: "alert", hidden: true });
  const show = (words) => {
    element.textContent = words;
    element.hidden = words === "";
  };
  return { element, show };
}

export function askToConfirm(question, consequence, word, act, stay = "Cancel") {
  const failure = errorLine();
  const yes = button(word, perform, { class: "button button-danger" });
  const no = button(stay, () => dialog.close(), { autofocus: true });
  const dialog = h(
    "dialog",
    { class: "dialog", "aria-labelledby": "dialog-title" },
    h("h2", { id: "dialog-title" }, question),
    h("p", {}, consequence),
    failure.element,
    h("div", { class: "row" }, yes, no),
  );
  dialog.addEventListener("close", () => dialog.remove());
  document.querySelector("#page").append(dialog);
  dialog.showModal();
  return dialog;

  async function perform() {
    yes.disabled = true;
    try {
      await act();
      dialog.close();
    } catch (error) {
      failure.show(reason(error));
      yes.disabled = false;
      no.focus();
    }
  }
}
