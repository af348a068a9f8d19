/**
 * Several scorings side by side, of one recording or several, and two of them overlaid.
 *
 * Exports
 *   showComparedScorings(element, {id, query, api, navigate})
 *     query: compare=sid,rid:sid,...   scorings of recording `id`, or of others
 */

import { aircraftName, kindName, loadCatalog } from "../../lib/catalog.js";
import { h } from "../../lib/dom.js";
import { loadingView } from "../../lib/loading_view.js";
import { followUnits } from "../../lib/units.js";
import { link, pageOf } from "../../lib/view_states.js";
import { readScoring } from "../scoring/source.js";
import { createOverlay } from "./overlay.js";
import { createScoringPicker } from "./scoring_picker.js";
import { compareTable } from "./table.js";

export function showComparedScorings(element, { id, query, api, navigate }) {
  const references = query
    .get("compare")
    .split(",")
    .filter(Boolean)
    .map((text) => referenceOf(text, id));
  return loadingView(element, { title: "Compare", text: "Loading scorings", build });

  async function build({ keep }) {
    const [catalog, recordings, monitors] = await Promise.all([
      loadCatalog(api),
      api.get("/recordings"),
      api.get("/monitors"),
    ]);
    const planned = new Map(monitors.map(({ id, dataset_recipe: { aircraft, maneuver } }) => [
      id,
      `${aircraftName(catalog, aircraft)}, ${kindName(catalog, "maneuver", maneuver)}`,
    ]));
    const names = new Map(recordings.map((recording) => [recording.id, recording.name]));
    const compared = await Promise.all(
      references.map(async ({ recording, scoring }, k) => {
        const [{ mapping }, scored] = await Promise.all([
          api.get(`/recordings/${recording}`),
          readScoring(api, recording, scoring),
        ]);
        return {
          letter: String.fromCharCode(65 + k),
          recordingName: names.get(recording) ?? recording,
          planned: planned.get(scored.monitor) ?? "planned test not recorded",
          scoring: scored,
          mapping,
        };
      }),
    );
    const picker = createScoringPicker({ api, recordings, taken: references, add });
    const overlay = keep(createOverlay({ api, compared }));
    const table = h("div", {});
    const tabulate = () => table.replaceChildren(compareTable(compared, { remove: compared.length > 1 ? remove : null }));
    return pageOf(
      "Compare",
      [link("Recording", `#/recordings/${id}`)],
      followUnits(table, tabulate),
      picker.element,
      overlay.element,
    );
  }

  function add(reference) {
    go([...references, reference]);
  }

  function remove(k) {
    go(references.filter((_, place) => place !== k));
  }

  function go(wanted) {
    const words = wanted.map(({ recording, scoring }) =>
      recording === id ? scoring : `${recording}:${scoring}`,
    );
    navigate(`#/recordings/${id}?compare=${words.join(",")}`);
  }
}

function referenceOf(text, recording) {
  const parts = text.split(":");
  return parts.length > 1
    ? { recording: parts[0], scoring: parts[1] }
    : { recording, scoring: text };
}
