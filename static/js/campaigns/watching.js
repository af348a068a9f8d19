/**
 * Keep a page up to date with others' decisions, and mark it when it may be out of date.
 *
 * page: while it may be out of date, a line at its top says so and its states are dim
 * look() -> Promise<string>    asks the server; why the page is out of date, or ""
 */

import { reason } from "../lib/api.js";
import { errorLine } from "../lib/dom.js";

/** [ms] Interval of the requests, and longest time without an answer. */
const LOOK_EVERY = 5000;
const SILENCE = 8000;

export function watching(page, look) {
  const line = errorLine();
  line.element.classList.add("stale-line");
  page.prepend(line.element);
  let answered = Date.now();
  let asking = false;
  const timer = setInterval(tick, LOOK_EVERY);
  return { close: () => clearInterval(timer) };

  async function tick() {
    if (Date.now() - answered > SILENCE) unknown("");
    if (asking) return; // one request at a time
    asking = true;
    try {
      const words = await look();
      answered = Date.now();
      show(words);
    } catch (error) {
      unknown(` (${reason(error)})`);
    }
    asking = false;
  }

  function unknown(why) {
    show(`Display is stale: no answer for ${Math.round((Date.now() - answered) / 1000)} s${why}`);
  }

  function show(words) {
    line.show(words);
    page.toggleAttribute("data-lost", words !== "");
  }
}
