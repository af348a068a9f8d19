/**
 * The Recordings page: #/recordings lists and uploads; #/recordings/{id} is one recording,
 * with ?monitor={mid} chosen to score it, with ?scoring={sid} one of its scorings, with ?compare={sid},{rid}:{sid} several side by side.
 *
 * Exports  show(element, {id, query, api, navigate}) -> {close()}
 */

import { showComparedScorings } from "./compare/index.js";
import { showRecordings } from "./list.js";
import { showRecording } from "./page.js";
import { showScoring } from "./scoring/page.js";

export function show(element, context) {
  const query = context.query ?? new URLSearchParams();
  const given = { ...context, query };
  if (!context.id) return showRecordings(element, given);
  if (query.get("scoring")) return showScoring(element, given);
  if (query.get("compare")) return showComparedScorings(element, given);
  return showRecording(element, given);
}
