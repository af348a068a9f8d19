/**
 * Where the manoeuvres of a flight begin, for what is drawn from there on.
 *
 * createStarts({api, source, live, start}) -> () => [{t [s], from}]
 *     source: of the flight.   live(): state of its live source, or null.   start: of its time [s]
 *     from: "onset", "trim" segment before it, or start of the "rollout"
 */

import { scoringStarts } from "../../recordings/scoring/events.js";

export function createStarts({ api, source, live, start }) {
  let scored = [];
  if (source.kind === "recording" && source.scoring) {
    const path = `/recordings/${source.recording}/scorings/${source.scoring}`;
    api.get(path).then((scoring) => (scored = scoringStarts(scoring)), () => {}); // nothing is drawn then
  }
  return () => {
    const known = live();
    if (known) return (known.begun ?? []).map(({ t }) => ({ t, from: "onset" }));
    return ["simulated", "replay"].includes(source.kind) ? [{ t: start, from: "rollout" }] : scored;
  };
}
