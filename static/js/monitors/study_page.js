/**
 * A study of many monitors: its form with past studies, the running job, its result.   query: job (a past study), dataset
 *
 * page: {title, kind, guide, address, requestWords(request), form, result, hint}
 *     guide: section of the guide.   kind: of its jobs.   hint: about the figures' files
 *     form({catalog, api, datasets, chosen}) -> {path, word, fields, content, beside, read()}     chosen: id of a dataset
 *     result(job, catalog) -> nodes
 */

import { createForm } from "../forms/controls.js";
import { isSimulated, loadCatalog } from "../lib/catalog.js";
import { empty, guideLink, h, link, loadingView, pageOf, panel } from "../lib/dom.js";
import { createJobProgress } from "../lib/job_progress.js";
import { moment } from "../lib/numbers.js";

export function showStudyPage(element, { query, api, navigate }, page) {
  const { title, kind, guide, address, requestWords, form, result, hint } = page;
  return loadingView(element, { title, text: "Loading past studies", loads: [loadCatalog], build });

  async function build({ keep, again }, catalog) {
    const help = guideLink(guide, title);
    const id = query.get("job");
    if (!id) return pageOf(title, [help], await begin(catalog));
    const job = await api.get(`/jobs/${id}`);
    const actions = [link("New study", address), help];
    if (job.status === "done") return pageOf(title, actions, result(job, catalog), figureFiles(job, hint));
    const progress = createJobProgress({ api, job, title: "Training and testing the monitors", done: again, back: () => navigate(address) });
    return pageOf(title, actions, keep(progress).element);
  }

  async function begin(catalog) {
    const [datasets, jobs] = await Promise.all([api.get("/datasets"), api.get(`/jobs?kind=${kind}`)]);
    const simulated = datasets.filter(isSimulated);
    const { path, read, beside, ...parts } = form({ catalog, api, datasets: simulated, chosen: query.get("dataset") });
    const send = async () => {
      const job = await api.post(path, read());
      navigate(`${address}?job=${job.id}`);
    };
    const made = createForm({ title, ...parts, route: `POST ${path}`, send, beside: h("span.hint", beside) });
    return [made.element, pastStudies(jobs)];
  }

  function pastStudies(jobs) {
    const rows = jobs.map(({ id, status, created, request }) =>
      h("li", h("a", { href: `${address}?job=${id}` }, moment(created)), ` ${status}, ${requestWords(request)}`),
    );
    const none = empty("No study yet", "The first one takes about a minute with the numbers above.");
    return panel("Past studies", rows.length ? h("ul", rows) : none);
  }
}

function figureFiles({ id, result }, hint = null) {
  const files = Object.entries(result.figures).map(([name, address]) =>
    h("li", h("a", { href: address, download: name }, name)),
  );
  return panel("For a report", [hint && h("p.hint", hint), h("ul", { "data-job": id }, files)]);
}
