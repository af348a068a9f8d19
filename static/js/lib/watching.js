/**
 * Keep a page up to date by the server's events, and mark it while it may be out of date.
 *
 * watching(page, {list: look}) -> {close()}
 *     page: while it may be out of date, a line at its top and the title say so, and its states are dim
 *     list: "flights", ...; look() -> Promise<string>     asks for the list; why the page is out of date, or nothing
 */

import { api, reason } from "./api.js";
import { errorLine } from "./dom.js";

const SILENCE = 5000; // ms without a word that the page is up to date; the server sends one every 2 s
const CHECK = 500; // ms

export function watching(page, looks) {
  const { title } = document;
  const line = errorLine("stale-line");
  page.prepend(line.element);
  const shown = {}; // revision of each list on the page
  const words = {}; // why it is out of date, by list
  let newest = {};
  let upToDate = Date.now();
  let why = "";
  let asking = false;
  const events = api.watchLists({ changed, lost: () => unknown("connection lost") });
  const timer = setInterval(() => (why || Date.now() - upToDate > SILENCE) && unknown(why), CHECK);
  return {
    close: () => {
      events.close();
      clearInterval(timer);
    },
  };

  function next() {
    return Object.keys(looks).find((list) => shown[list] !== newest[list]);
  }

  async function changed(revisions) {
    newest = revisions;
    if (asking) return;
    asking = true;
    try {
      for (let list = next(); list !== undefined; list = next()) {
        const revision = newest[list];
        words[list] = await looks[list]();
        shown[list] = revision;
      }
      [upToDate, why] = [Date.now(), ""];
      show(Object.values(words).filter(Boolean).join(" "));
    } catch (error) {
      unknown(reason(error));
    }
    asking = false;
  }

  function unknown(given) {
    why = given;
    show(`Display is stale: no answer for ${Math.round((Date.now() - upToDate) / 1000)} s${why && ` (${why})`}`);
  }

  function show(text) {
    line.show(text);
    page.toggleAttribute("data-lost", text !== "");
    if (page.isConnected) document.title = text ? `◆ OUT OF DATE – ${title}` : title;
  }
}
