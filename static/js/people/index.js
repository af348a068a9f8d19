/** People and audit: who has a token and with which role, and the newest lines of what people did. */

import { labelled, select } from "../forms/controls.js";
import { asksForToken } from "../lib/api.js";
import { empty, errorLine, guideLink, h, loadingView, pageOf, panel, table } from "../lib/dom.js";
import { moment } from "../lib/numbers.js";

const DAY = 86_400_000; // ms
const PERIODS = [["1", "last day"], ["7", "last 7 days"], ["30", "last 30 days"], ["3650", "all"]];
const MOST = 200; // lines

const PEOPLE = [
  ["Name", ({ name }) => name, "name"],
  ["Role", ({ role }) => role],
  ["Token", ({ revoked, expires }) => (revoked ? `revoked ${moment(revoked)}` : expires && new Date(expires) < new Date() ? "expired" : "valid")],
  ["Created", ({ created }) => moment(created), "date"],
  ["Expires", ({ expires }) => (expires ? moment(expires) : "never"), "date"],
  ["Last used", ({ last_used: used }) => (used ? moment(used) : "never"), "date"],
];
const LINES = [
  ["Time [UTC]", ({ time }) => time.slice(0, 19).replace("T", " "), "date"],
  ["Who", ({ who }) => who, "name"],
  ["Role", ({ role }) => role],
  ["Request", ({ method, path }) => `${method} ${path}`],
  ["Answer", ({ status }) => (status === 403 ? "◆ 403, refused" : status), "number"],
  ["Address", ({ address }) => address],
];

export function show(element, { api }) {
  return loadingView(element, { title: "People and audit", text: "Loading people", loads: ["/tokens"], build });

  async function build(_, tokens) {
    const failure = errorLine();
    const lines = h("div", { role: "region", "aria-label": "Audit lines", "aria-live": "polite" });
    const period = select(PERIODS, { onchange: ask });
    period.value = "7";
    const who = h("input", { type: "search", onchange: ask, placeholder: "everyone" });
    const filters = h("div.row", labelled("Period", period).element, labelled("Person", who).element);
    const people = tokens.length
      ? table({ columns: PEOPLE, items: tokens, panel: false })
      : asksForToken()
        ? empty("No person has a token", "The token of the settings (FOREWARN_TOKEN) lets in an admin. Make a person's token with forewarn token create.")
        : empty("No token required", "Everyone who reaches this server is an admin. Make the first token with forewarn token create.");
    await ask();
    return pageOf(
      "People and audit",
      [guideLink("several-people", "people, roles and tokens")],
      panel("People and tokens", people),
      panel("Audit, newest first", [filters, failure.element, lines]),
    );

    function ask() {
      return failure.attempt(async () => {
        const since = new Date(Date.now() - DAY * Number(period.value)).toISOString();
        const query = new URLSearchParams({ since, ...(who.value.trim() && { who: who.value.trim() }) });
        const entries = await api.get(`/audit?${query}`);
        const newest = entries.slice(-MOST).reverse();
        const more = entries.length > MOST ? h("p.hint", `${entries.length.toLocaleString("en")} lines; the newest ${MOST} are shown. Export all with forewarn audit.`) : null;
        lines.replaceChildren(...[newest.length ? table({ columns: LINES, items: newest, panel: false }) : h("p.dim", "No line in this period."), more].filter(Boolean));
      });
    }
  }
}
