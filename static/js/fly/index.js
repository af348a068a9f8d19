/** Fly: start a flight, watch one in progress, read the record of one that has ended. */

import { reason } from "../lib/api.js";
import { setZero } from "../lib/clock.js";
import { h, state } from "../lib/dom.js";
import { NO_CLOCK } from "../recordings/words.js";
import { showLiveFlight } from "./live_flight.js";
import { liveZero } from "./panels.js";
import { showFlightRecord } from "./record.js";
import { showSessionCheck } from "./session_check.js";
import { showFlightStart } from "./start.js";

const AGAIN = 1000; // ms between attempts to reach a server that does not answer
const SOON = 300; // ms between looks at a flight whose record is being completed
const LOOKS = 10; // then the record is shown as far as it goes

export function show(element, context) {
  const { id, api } = context;
  if (id === null) return showFlightStart(element, context);
  if (id === "check") return showSessionCheck(element, context);
  let part = { close: () => {} };
  let closed = false;
  let timer = 0;
  let looks = 0;

  function show(content) {
    element.replaceChildren(h("h1", { class: "visually-hidden" }, "Flight"), content);
  }

  function replace(view, more) {
    part.close();
    part = view(element, { ...context, ...more });
  }

  async function open(why = "") {
    if (!why) show(state("loading", "Opening the flight", "Asking the server."));
    try {
      const flight = await api.get(`/flights/${encodeURIComponent(id)}`);
      if (closed) return;
      if (flight.progress === "ending" && looks++ < LOOKS) {
        timer = setTimeout(open, SOON, why); // its record is being completed
        return;
      }
      setZero(...(await zeroOf(api, flight)));
      if (closed) return;
      if (flight.progress === "running") replace(showLiveFlight, { over: open });
      else replace(showFlightRecord, { flight, why, reopen: open });
    } catch (error) {
      if (!closed) fail(error, why);
    }
  }

  function fail(error, why) {
    if (error.status === 0) {
      if (!why) show(state("error", "No connection", `${reason(error)} The page tries again by itself.`));
      timer = setTimeout(open, AGAIN, why);
      return;
    }
    const back = h("a", { class: "button button-primary", href: "#/fly" }, "Flights");
    show(state("error", "This flight cannot be shown", reason(error), back));
  }

  open();
  return {
    close: () => {
      closed = true;
      clearTimeout(timer);
      part.close();
    },
  };
}

/** When its time is 0, and why that is not known. */
async function zeroOf(api, { source, live }) {
  if (source.kind === "live") return liveZero(live);
  if (!["recording", "journal"].includes(source.kind)) return ["", "the flight is simulated"];
  try {
    if (source.kind === "journal") return liveZero((await api.get(`/flights/${source.flight_id}`)).live);
    const { time_zero: zero } = await api.get(`/recordings/${source.recording}/scorings/${source.scoring}`);
    return [zero, NO_CLOCK];
  } catch (error) {
    return ["", `what is replayed could not be read (${reason(error)})`];
  }
}
