/**
 * Keep a page up to date with others' decisions, and mark it when it may be out of date.
 *
 * page: while it may be out of date, a line at its top and the title say so, and its states are dim
 * look() -> Promise<string>    asks the server; why the page is out of date, or nothing
 * every, silence [ms]   interval of the requests; longest time without an answer
 */

import { reason } from "./api.js";
import { errorLine } from "./dom.js";

export function watching(page, look, { every = 5000, silence = 8000 } = {}) {
  const { title } = document;
  const line = errorLine("stale-line");
  page.prepend(line.element);
  let answered = Date.now();
  let asking = false;
  const timer = setInterval(tick, every);
  return { close: () => clearInterval(timer) };

  async function tick() {
    if (Date.now() - answered > silence) unknown("");
    if (asking) return; // one request at a time
    asking = true;
    try {
      const words = await look();
      answered = Date.now();
      show(words ?? "");
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
    if (page.isConnected) document.title = words ? `◆ OUT OF DATE – ${title}` : title;
  }
}
