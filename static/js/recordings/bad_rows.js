/**
 * Rows of a file that could not be read.
 *
 * Exports
 *   badRows({n, share, rows}) -> element | null     folded, with their number; null if there are none
 *   badRowsTable(rows) -> element                   [{line, reason, text}]
 */

import { h } from "../lib/dom.js";
import { tableHead } from "../lib/lists.js";
import { percent } from "../lib/numbers.js";

export function badRows({ n, share, rows }) {
  if (!n) return null;
  const more =
    n > rows.length ? h("p", { class: "hint" }, `First ${rows.length} of ${n}.`) : null;
  return h(
    "details",
    { class: "fold bad-rows" },
    h(
      "summary",
      {},
      h(
        "span",
        { class: "chip", "data-level": "caution" },
        `◆ ${n} bad ${n === 1 ? "row" : "rows"}`,
      ),
      ` skipped, ${percent(share, share < 0.001 ? 3 : 1)} of the file: lines and reasons`,
    ),
    badRowsTable(rows),
    more,
  );
}

export function badRowsTable(rows) {
  const head = ["Line", "Reason", "Text"];
  return h(
    "div",
    { class: "table-scroll bad-rows-table" },
    h(
      "table",
      { class: "table" },
      tableHead(head.map((words, k) => [words, k === 0])),
      h(
        "tbody",
        {},
        rows.map(({ line, reason, text }) =>
          h(
            "tr",
            {},
            h("th", { scope: "row", class: "number" }, line.toLocaleString("en")),
            h("td", {}, reason),
            h("td", {}, h("code", {}, text)),
          ),
        ),
      ),
    ),
  );
}
