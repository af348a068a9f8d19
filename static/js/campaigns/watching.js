/**
 * A page that follows what others decide, and says when it cannot know.
 *
 * Exports
 *   watching(page, look) -> {close()}
 *     page: what is shown; while it may be out of date, it says so at its top and its states are dim
 *     look() -> Promise<string>    asks the server; words of what is out of date, "" for nothing
 */

import { reason } from "../lib/api.js";
import { errorLine } from "../lib/view_states.js";

/** [ms] How often it is asked, and after how long without an answer nothing is known. */
const LOOK_EVERY = 5000;
const SILENCE = 8000;

export function watching(page, look) {
  const line = errorLine();
  line.element.classList.add("stale-line");
  page.prepend(line.element);
  let heard = Date.now();
  let asking = false;
  const timer = setInterval(tick, LOOK_EVERY);
  return { close: () => clearInterval(timer) };

  async function tick() {
    if (Date.now() - heard > SILENCE) unknown("");
    if (asking) return; // a server that hangs is asked once
    asking = true;
    try {
      const words = await look();
      heard = Date.now();
      tell(words);
    } catch (error) {
      unknown(` (${reason(error)})`);
    }
    asking = false;
  }

  function unknown(why) {
    tell(`Not known whether this is the newest: no answer for ${Math.round((Date.now() - heard) / 1000)} s${why}`);
  }

  function tell(words) {
    line.show(words);
    page.toggleAttribute("data-lost", words !== "");
  }
}
