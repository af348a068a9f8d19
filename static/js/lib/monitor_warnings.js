/** What speaks against relying on a monitor, as the server says it. Exports  warningLines(monitor) -> elements. */

import { h } from "./dom.js";

export function warningLines({ warnings }) {
  return warnings.map((text) => h("p", { class: "monitor-warning", role: "note" }, text[0].toUpperCase() + text.slice(1)));
}
