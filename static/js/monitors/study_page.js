/**
 * A study of many monitors: its form with past studies, the running job, its result.
 *
 * Exports
 *   showStudyPage(element, {query, api, navigate}, page)     query: job (a past study)
 *     page: { title, guide, address, loading, working, another, form, result }
 *     guide: section of the guide.   form(context) -> nodes, context: {catalog, api, query, navigate}     result(job, catalog) -> nodes
 *   pastStudies(jobs, {title, address, words, none}) -> section     words(request); none: [title, text]
 *   figureFiles(job, hint) -> section
 */

import { loadCatalog } from "../lib/catalog.js";
import { h } from "../lib/dom.js";
import { guideLink } from "../lib/guide_link.js";
import { createJobProgress } from "../lib/job_progress.js";
import { loadingView } from "../lib/loading_view.js";
import { moment } from "../lib/numbers.js";
import { empty, link, pageOf } from "../lib/view_states.js";

export function showStudyPage(element, { query, api, navigate }, page) {
  const { title, guide, address, loading, working, another, form, result } = page;
  return loadingView(element, { title, text: loading, build });

  async function build({ keep, again }) {
    const catalog = await loadCatalog(api);
    const id = query.get("job");
    if (!id) return pageOf(title, [guideLink(guide, title)], await form({ catalog, api, query, navigate }));
    const job = await api.get(`/jobs/${id}`);
    const actions = [link(another, address), guideLink(guide, title)];
    if (job.status === "done") return pageOf(title, actions, result(job, catalog));
    const progress = createJobProgress({ api, job, title: working, done: again, back: () => navigate(address) });
    return pageOf(title, actions, keep(progress).element);
  }
}

export function pastStudies(jobs, { title, address, words, none }) {
  const rows = jobs.map(({ id, status, created, request }) =>
    h("li", {}, h("a", { href: `${address}?job=${id}` }, moment(created)), ` ${status}, ${words(request)}`),
  );
  const content = rows.length ? h("ul", {}, rows) : empty(...none);
  return h("section", { class: "panel stack" }, h("h2", { class: "panel-title" }, title), content);
}

export function figureFiles({ id, result }, hint = null) {
  const files = Object.entries(result.figures).map(([name, address]) =>
    h("li", {}, h("a", { href: address, download: name }, name)),
  );
  return h(
    "section",
    { class: "panel" },
    h("h2", { class: "panel-title" }, "For a report"),
    hint && h("p", { class: "hint" }, hint),
    h("ul", { "data-job": id }, files),
  );
}
